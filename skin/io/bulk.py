"""Many logs into tables, each on a processor or machine of its own.

Logs are independent of each other; within a log the filters depend on the cycles before. A log is a
task of any executor of `concurrent.futures`. Its files take their places when they are complete,
and say by which topology, calibration, options and log they were made, so that a finished log is
left out by the next call.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor, as_completed
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

import topology as topology_package
from bus.errors import BusError
from bus.logs import buses_of, read
from skin.blocks import blocks_of
from skin.contact.record import Event
from skin.errors import OptionError, SkinError, check_choice
from skin.io.export.provenance import provenance_of
from skin.io.export.tables import FORMATS, Tables, report_in
from skin.io.record import is_recording
from skin.offline import decode_log, prefetch
from skin.options import Options
from topology import Topology

if TYPE_CHECKING:
    from skin.blocks import Block

__all__ = ["decode_logs", "decode_one"]

WANT = ("temperature", "force", "sigma", "test_ratio", "wrench", "centroid", "contacts", "slip")
"""Quantities that are decoded by default."""
BLOCKS_AHEAD = 2

OnLog = Callable[[dict[str, Any]], object]


def decode_logs(
    source: Topology | str | Path, logs: Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str], *, executor: Executor | None = None, format: str = "parquet",
    channels: Mapping[str, str] | None = None, recalibrate: bool = True,
    on_log: OnLog | None = None, **options: Any,
) -> dict[str, Any]:  # fmt: skip
    """Decode recorded logs, and recordings of `skin run --record`, into tables in a folder.

    Parameters
    ----------
    source : Topology, str or Path
        A loaded topology, a file, or the name of a built-in one.
    logs : iterable of path
    out : path
        The folder: files are ``out/TABLE/skin=NAME/log=LOG/TABLE.parquet``, of the tables cycles,
        contacts and faults.
    executor : concurrent.futures.Executor, optional
        Takes a log as a task: a ``ProcessPoolExecutor(4)``, or that of a cluster
        (``distributed.Client(…).get_executor()``), whose machines share topology, logs and folder.
        Without it logs are decoded in this process, with threads that read and write.
    format : "parquet", "csv" or "npz"
        Logs whose Parquet files say the same provenance are not decoded again.
    channels : mapping of str to str, optional
        As of `skin.decode_log`.
    recalibrate : bool
        Recordings get the calibration of `source`, not that of their run.
    on_log : function, optional
        Called with the report of each log as it ends.
    **options
        Of `skin.options.Options`. A recording has those of its run where none are given.

    Returns
    -------
    dict
        ``logs``, the report of each (`decode_one`, or ``state`` "failed"), in their order; how many
        were ``decoded``, ``unchanged`` and ``failed``; ``cycles``; ``faults`` of all; ``wall_s``.

    Raises
    ------
    topology.TopologyError, OptionError, bus.LogError
        Topology, options or channels cannot be; there is no log, the same twice, or of an unknown
        format. What one log alone cannot do is in its report.

    Examples
    --------
    >>> with ProcessPoolExecutor(4) as pool:  # doctest: +SKIP
    ...     report = decode_logs("hand.toml", Path("logs").glob("*.blf"), "decoded", executor=pool)
    """
    begun = time.monotonic()
    loaded = source if isinstance(source, Topology) else topology_package.load(source)
    check_choice("format", format, FORMATS)
    Options(**options)
    buses_of(loaded, None, channels)
    keys = _keys(map(Path, logs))
    calls = {
        log: partial(
            _attempt, loaded, log, places_in(Path(out), loaded.name, key, format),
            channels=channels, recalibrate=recalibrate, threads=executor is None, options=options,
        )
        for key, log in keys.items()
    }  # fmt: skip
    done = {}
    for log, report in _reports(calls, executor):
        done[log] = report
        if on_log is not None:
            on_log(report)
    found = [done[log] for log in keys.values()]
    states = [one["state"] for one in found]
    return {
        "topology": loaded.name, "logs": found,
        **{state: states.count(state) for state in ("decoded", "unchanged", "failed")},
        "cycles": sum(one.get("cycles", 0) for one in found),
        "faults": [fault for one in found for fault in one["faults"]],
        "wall_s": time.monotonic() - begun,
    }  # fmt: skip


def _reports(
    calls: Mapping[Path, Callable[[], dict[str, Any]]], executor: Executor | None
) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Reports as the logs end; the largest ones start first, to shorten the whole."""
    if executor is None:
        for log, call in calls.items():
            yield log, call()
        return
    largest_first = sorted(calls, key=lambda log: -log.stat().st_size)
    futures = {executor.submit(calls[log]): log for log in largest_first}
    try:
        for future in as_completed(futures):
            log = futures[future]
            try:
                yield log, future.result()
            except Exception as error:  # a process that dies; a cluster may raise anything
                yield log, _failed(log, f"{log}: must be decoded by a worker; got {error!r}")
    finally:
        for future in futures:
            future.cancel()


def _attempt(topology: Topology, log: Path, *given: Any, **how: Any) -> dict[str, Any]:
    """As `decode_one`, but what one log cannot do keeps none of the others away."""
    try:
        return decode_one(topology, log, *given, **how)
    except OSError as error:  # of writing: the file and the reason
        return _failed(log, f"{error.filename or log}: {error.strerror or error}")
    except (BusError, SkinError) as error:
        return _failed(log, str(error))


def _failed(log: Path, message: str) -> dict[str, Any]:
    return {"log": str(log), "state": "failed", "faults": [message]}


def decode_one(
    topology: Topology, log: Path, places: Mapping[str, Path] | None, *,
    channels: Mapping[str, str] | None = None, recalibrate: bool = True, threads: bool = True,
    options: Mapping[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """Decode one log or recording into tables.

    Parameters
    ----------
    topology : Topology
    log : Path
    places : mapping of str to Path, or None
        Of the tables, see `skin.io.export.tables`; None: nothing is written.
    channels, recalibrate, options
        As of `decode_logs`.
    threads : bool
        Whether threads read, decode and write at the same time.

    Returns
    -------
    dict
        ``log``, ``state`` ("decoded", or "unchanged" with the report of the call before),
        ``cycles``, ``cycles_missing``, ``valid_share`` (None where no unit can be valid),
        ``peak_force_n``, ``contacts``, ``slips``, ``counters`` of frames, ``left_out`` channels,
        ``skipped`` lines, ``options``, ``notes`` and ``faults``.

    Raises
    ------
    bus.BusError, SkinError, OSError
        The log cannot be decoded, or a file not be written.
    """
    played: Any
    if is_recording(log):
        from skin.io.record.replay import replay

        played = replay(log, topology, recalibrate=recalibrate, **options)
        blocks = blocks_of(played, played.pipeline)
    else:
        played = decode_log(topology, log, channels=channels, **{"want": WANT} | dict(options))
        blocks = played.blocks(threads=threads)
    used = played.pipeline.options
    provenance = provenance_of(played.topology, used) | _provenance_of_log(log, channels)
    if places is not None and (before := report_in(places["faults"], provenance)):
        return before | {"log": str(log), "state": "unchanged"}
    tally = _Tally(topology)
    with ExitStack() as files:
        tables = None if places is None else Tables(places, topology, provenance, files)
        for block in prefetch(blocks, BLOCKS_AHEAD) if threads else blocks:
            tally.add(block)
            if tables is not None:
                tables.add(block)
        faults = [*played.faults]
        if not tally.cycles and not faults:
            faults.append(f"{log}: must hold cycles of the skin {topology.name!r}; got none")
        report = {
            "log": str(log), "state": "decoded", **tally.report(),
            "counters": asdict(played.counters), "left_out": getattr(played, "left_out", {}),
            "skipped": getattr(played, "skipped", {}), "options": used.report(),
            "notes": getattr(played, "notes", []), "faults": faults,
        }  # fmt: skip
        if tables is not None:
            tables.finish(report)
    return report


class _Tally:
    """Totals over the blocks of a log."""

    def __init__(self, topology: Topology) -> None:
        self._feels = int(topology.feels.sum())
        self.cycles = self._valid = self._missing = self._contacts = self._slips = 0
        self._peak_n: float | None = None

    def add(self, block: Block) -> None:
        self.cycles += len(block)
        self._valid += int(np.count_nonzero(block.units.valid))
        self._missing = int(block.overruns[-1])
        if block.wrench is not None:
            most = float(np.linalg.norm(block.wrench[:, :3], axis=1).max())
            self._peak_n = max(most, self._peak_n or 0.0)
        if block.contacts is not None:
            found = block.contacts
            self._contacts += int(np.count_nonzero(found["event"] & int(Event.BORN)))
            began = (found["onset_ns"] != 0) & (found["onset_ns"] == found["seen_ns"])
            self._slips += int(np.count_nonzero(began))

    def report(self) -> dict[str, Any]:
        readings = self.cycles * self._feels
        return {
            "cycles": self.cycles, "cycles_missing": self._missing,
            "valid_share": self._valid / max(1, readings) if self._feels else None,
            "peak_force_n": self._peak_n, "contacts": self._contacts, "slips": self._slips,
        }  # fmt: skip


# -- names and places of logs ----------------------------------------------------------------------


def places_in(out: Path, skin: str, key: str, format: str) -> dict[str, Path]:
    """Paths of the tables of a log in a folder, which tools for Parquet read as columns ``skin``
    and ``log`` (Hive)."""
    return {
        table: out / table / f"skin={quote(skin, safe='')}" / f"log={key}" / f"{table}.{format}"
        for table in ("cycles", "contacts", "faults")
    }


def _keys(logs: Iterable[Path]) -> dict[str, Path]:
    """Logs by their names in a folder of tables: that of the file, and a hash of its folder, so
    that logs of several days may have the same name."""
    found: dict[str, Path] = {}
    for log in logs:
        if not is_recording(log):
            read(log)  # looks at its name, and whether it is there
        stem = log.name.removesuffix(".gz").rpartition(".")[0] or log.name
        folder = hashlib.sha256(os.fsencode(log.absolute().parent)).hexdigest()
        key = f"{quote(stem, safe='')}-{folder[:8]}"
        if key in found:
            raise OptionError(f"{log}: must be another log than {found[key]}; got the same name "
                              "and folder")  # fmt: skip
        found[key] = log
    if not found:
        raise OptionError("logs: must be at least one; got none")
    return found


def _provenance_of_log(log: Path, channels: Mapping[str, str] | None) -> dict[str, str]:
    with log.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    named = json.dumps(dict(channels or {}), sort_keys=True)
    return {"log": log.name, "log_sha256": digest, "channels": named}
