"""`skin doctor`: listen to the buses of a topology, and say what is wrong and why."""

from __future__ import annotations

import json as json_text
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from skin.cli import options
from skin.cli.table import counted

if TYPE_CHECKING:
    from bus.diagnose import Finding
    from bus.discover import Survey
    from bus.logs import LogReader
    from skin.offline import LogWatch
    from topology import Topology

__all__ = ["doctor"]


def doctor(
    file: options.File,
    log: options.Log = None,
    /,
    *,
    seconds: options.Listening = 5.0,
    bus: options.Bus = None,
    sync: options.Sync = "host",
    map: options.Map = (),
    json: options.Json = False,
) -> int:
    """Listen to the buses of a topology, and compare what is heard with what the file expects; or
    what a log holds.

    Each finding comes with its likely cause: missing units, silent branches, swapped buses, wrong
    identifiers, lengths and rates, two units of one address, boards without heartbeats, with one
    serial number or with different firmware, losses by where they happen, errors of the bus. Exits
    with 0 if all is well, and with 1 if there are findings.
    """
    from bus.diagnose import diagnose
    from bus.diagnose_boards import identities
    from bus.discover import Survey
    from bus.logs import buses_of, read
    from skin.compiling import announcer
    from skin.offline import LogWatch

    options.check_seconds(seconds)
    if log is not None:
        options.refuse_both("a log", "--bus", bus)
    announcer()
    loaded = options.load(file, bus)
    mapped = options.mapped(map, log)
    buses = {} if log is None else buses_of(loaded, log, **mapped)
    frames = None if log is None else read(log, buses=buses, strict=False)
    survey = Survey(loaded)
    found = list(_of_this_host())
    if frames is not None:
        watch = LogWatch(loaded)
        for batch in frames:
            survey.feed(batch.frames)
            watch.take(batch.frames)
        survey.finish()
        found = [*_of_log(frames, watch), *diagnose(survey), *found]
    else:
        found = _listen(survey, seconds, sync) + found
    counters = {name: count for name, count in asdict(survey.counters).items() if count}
    named = identities(survey)
    unchecked = options.lacking(loaded, np.array([name in named for name in loaded.unit_names]))
    report = {
        "topology": loaded.name,
        "units": loaded.n,
        "units_heard": int((survey.age >= 0).sum()),
        "cycles": survey.cycles,
        "counters": counters,
        "left_out": {} if frames is None else frames.left_out,
        **options.without(loaded),
        "identity_unchecked": unchecked,
        "findings": [asdict(finding) for finding in found],
        "healthy": not found,
    }
    hints = [*options.hints(file, loaded), *_unchecked(file, loaded, unchecked)]
    print(_table(loaded, report, found, hints))
    if json:
        print(json_text.dumps(report))
    return 1 if found else 0


def _unchecked(file: str, topology: Topology, names: list[str]) -> Iterator[str]:
    """A line about units of which nothing shows that they are those of their addresses."""
    if names:
        units = f"unit {names[0]} is" if len(names) == 1 else f"{len(names)} units are"
        how = "calibration files with serial numbers (skin calibrate), and heartbeats on the bus"
        if any(topology.serials):
            how = "heartbeats on the bus, or in the log, whose serial numbers the files have"
        yield (
            f"{units} known by address only, which two exchanged units keep: to have that checked, "
            f"give {how}; or press one after the other in: skin view {file}"
        )


def _listen(survey: Survey, seconds: float, sync: Literal["host", "bus"]) -> list[Finding]:
    from bus.diagnose import diagnose
    from bus.discover import listen
    from bus.open import open_transport

    with ExitStack() as opened:
        transports = [
            opened.enter_context(open_transport(bus, i))
            for i, bus in enumerate(survey.topology.buses)
        ]
        print(f"listening for {seconds:g} s …", file=sys.stderr, flush=True)
        listen(survey, transports, seconds, sync=sync)
        return diagnose(survey, transports)


def _of_log(frames: LogReader, watch: LogWatch) -> Iterator[Finding]:
    """What is wrong with the log itself."""
    from bus.diagnose import Finding

    for code, fault, cause in (
        ("damaged-log", str(frames.damage or ""), "a full disk, a loss of power, or a hand"),
        ("lossy-log", frames.loss, "a busy machine, or a slow disk"),
        *(("clock-jump", text, "the clock of the logger was set") for text in watch.jumps),
    ):
        if fault:
            yield Finding(code, "error", "log", 1, fault, cause)
    if frames.lacking and frames.left_out:
        yield Finding(
            "other-channels",
            "error",
            "log",
            sum(frames.left_out.values()),
            frames.lacking,
            "a logger that counts or names the channels otherwise than the topology",
        )


def _of_this_host() -> Iterator[Finding]:
    """What is wrong with the installation."""
    from bus.compiled import places
    from bus.diagnose import Finding

    folder = places.wanted()
    if folder is None or not _is_writable(folder):
        where = "this user's caches: there is no home" if folder is None else folder
        yield Finding(
            "no-cache", "warning", "host", 1,
            f"compiled code cannot be kept in {where}, only among temporary files if at all: a "
            "start may have to compile again",
            "a read-only installation; set NUMBA_CACHE_DIR to a folder that can be written",
        )  # fmt: skip
    elif folder.exists() and (fault := places.fault_of(folder)) is not None:
        yield Finding(
            "unsafe-cache", "warning", "host", 1,
            f"compiled code in {folder} is not used: {fault}",
            f"a folder that was made by hand; chmod go-w {folder}, or remove it",
        )  # fmt: skip


def _is_writable(folder: Path) -> bool:
    """Whether a folder, or the nearest one above that exists, can be written."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return os.access(folder, os.W_OK)


def _table(loaded: Topology, report: dict[str, Any], found: list[Finding], hints: list[str]) -> str:
    lines = [
        f"{loaded.name}: {report['units_heard']} of {loaded.n} units heard in {report['cycles']} "
        "cycles",
        f"frames: {counted(report['counters'])}",
        *([f"frames of other channels: {counted(left)}"] if (left := report["left_out"]) else []),
        *hints,
    ]
    for finding in found:
        lines += [
            "",
            f"{finding.severity}: {finding.subject}: {finding.text}",
            f"    likely cause: {finding.likely_cause}",
        ]
    lines += ["", _verdict(found)]
    return "\n".join(lines)


def _verdict(found: list[Finding]) -> str:
    from bus.finding import some

    if not found:
        return "all is well"
    errors = sum(finding.severity == "error" for finding in found)
    return f"findings: {some(errors, 'error')}, {some(len(found) - errors, 'warning')}"
