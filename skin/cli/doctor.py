"""`skin doctor`: listen to the buses of a topology, and say what is wrong and why."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from typing import TYPE_CHECKING, Literal

import numpy as np

from skin.cli import options
from skin.cli.table import end

if TYPE_CHECKING:
    from bus.diagnose import Finding
    from bus.discover import Survey
    from bus.logs import LogReader
    from skin.offline import LogWatch

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
    identifiers, lengths and rates, two units of one address, boards without heartbeats or with the
    calibration of another one, losses by where they happen, errors of the bus. Exits with 0 if all
    is well, and with 1 if there are findings.
    """
    from bus.diagnose import diagnose
    from bus.diagnose_bus import identities
    from bus.discover import Survey
    from bus.logs import buses_of, read
    from skin.compiling import announce
    from skin.offline import LogWatch

    options.check_seconds(seconds)
    if log is not None:
        options.refuse_both("a log", "--bus", bus)
    announce()
    loaded = options.load(file, bus)
    mapped = options.mapped(map, log)
    survey, left_out = Survey(loaded), {}
    if log is None:
        found = _listen(survey, seconds, sync)
    else:
        frames = read(log, buses=buses_of(loaded, log, **mapped), strict=False)
        watch = LogWatch(loaded)
        for batch in frames:
            survey.feed(batch.frames)
            watch.take(batch.frames)
        survey.finish()
        found = [*_of_log(frames, watch), *diagnose(survey)]
        left_out = frames.left_out
    named = identities(survey)
    unchecked = options.lacking(loaded, np.array([name in named for name in loaded.unit_names]))
    by_address = (
        "no serial number in both calibration file and heartbeats, and an exchange of two is not "
        f"seen: calibrate (skin calibrate), or press one after the other in: skin view {file}"
    )
    options.note(options.hints(file, loaded, more=[(unchecked, by_address)]))
    if not json:
        for finding in found:
            print(f"{finding.severity}: {finding}\n")
    kinds = Counter(finding.severity for finding in found)
    report = {
        "topology": loaded.name,
        "units": loaded.n,
        "units_heard": int((survey.age >= 0).sum()),
        "cycles": survey.cycles,
        "counters": {name: count for name, count in asdict(survey.counters).items() if count},
        "left_out": left_out,
        **options.without(loaded),
        "identity_unchecked": unchecked,
        "findings": [asdict(finding) for finding in found] if json else dict(kinds),
        "healthy": not found,
    }
    end(report, json)
    return 1 if found else 0


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
        ("other-channels", frames.lacking if frames.left_out else "",
         "a logger that counts or names the channels otherwise than the topology"),
    ):  # fmt: skip
        if fault:
            yield Finding(code, "error", "log", 1, fault, cause)
