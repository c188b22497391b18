"""`skin decode`: recorded logs into forces."""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from skin.cli import options
from skin.cli.table import end, progress
from skin.io.record import is_recording

if TYPE_CHECKING:
    from collections.abc import Iterator

    from topology import Topology

__all__ = ["decode"]

FILES = (".csv", ".npz", ".parquet")


def decode(
    paths: Annotated[
        tuple[str, ...], tyro.conf.Positional, options.arg("[TOPOLOGY] LOG [LOG ...]")
    ],
    /,
    *,
    output: Annotated[Path | None, options.arg("DIR|FILE", "-o")] = None,
    want: Annotated[tuple[str, ...], options.arg("NAME [NAME ...]")] = (),
    jobs: int = 1,
    format: Literal["parquet", "csv", "npz"] = "parquet",
    map: options.Map = (),
    json: options.Json = False,
) -> int:
    """Decode recorded CAN logs (candump, BLF, ASC, TRC, …), and what `skin run` has recorded.

    Each log gives three tables, with the columns of docs/reference/columns.md in every format: a
    row for each cycle, in FILE itself; for each contact in a cycle, in FILE.contacts; for each
    interval in which a unit is not valid, in FILE.faults. Every number is that of the live skin, by
    the defaults of `skin.open` or as in the run that was recorded; `decode_logs` of Python takes
    other options. The report and all files but .csv state them.

    Into a folder go the tables of any number of logs (docs/guides/bulk.md). A log whose Parquet
    files were made by the same topology, calibration and options is left out.

    Exits with 1 if a log holds no cycle or no valid reading of this skin, is damaged, lacks SYNC or
    a bus, has time that runs back, or could not be decoded; all that can be decoded is.

    Parameters
    ----------
    paths
        topology file, or the name of a ready-made one, and recorded CAN logs or recordings;
        recordings alone have their own
    output
        where to write: a folder for any number of logs; of one log FILE.parquet, .csv or .npz
        (arrays)
    want
        what to decode; forces, temperatures, contacts and slip otherwise; of recordings as their
        runs
    jobs
        logs that are decoded side by side
    format
        of the files in a folder
    """
    from skin.errors import OptionError, check_number
    from skin.io.bulk import decode_logs

    loaded, logs = _named(paths)
    own = is_recording(paths[0])
    asked: dict[str, Any] = {"want": want} if want else {}
    mapped = options.mapped(map, *logs)
    check_number("--jobs", jobs, 1, 256, whole=True)
    if output is not None and (output.is_dir() or not output.suffix):
        if not output.is_dir():
            options.check_folder("--output", output)
        done = count(1)
        with _pool(min(jobs, len(logs))) as executor:
            report = decode_logs(
                loaded, logs, output, executor=executor, format=format, recalibrate=not own,
                **mapped, **asked,
                on_log=lambda one: progress(next(done), len(logs), Path(one["log"]).name),
            )  # fmt: skip
        report["output"] = str(output.resolve())
    elif len(logs) > 1:
        raise OptionError(f"--output: must be a folder for several logs; got {output}")
    elif format != "parquet":
        raise OptionError(f"--format: must be given with a folder as --output; got {output}")
    else:
        report = _into_file(loaded, logs[0], output, options=asked, recalibrate=not own, **mapped)
    if len(report["logs"]) == 1 and not json:
        end(report["logs"][0] | {"output": report["output"]}, json)
    else:
        end(report, json)
    options.note(note for one in report["logs"] for note in one.get("notes", ()))
    sys.stderr.writelines(f"{fault}\n" for fault in report["faults"])
    return int(bool(report["faults"]))


def _into_file(loaded: Topology, log: Path, output: Path | None, **how: Any) -> dict[str, Any]:
    """Decode one log into one file and its further tables; the report."""
    from skin.errors import OptionError
    from skin.io.bulk import decode_one
    from skin.io.export.tables import beside

    if output is not None and output.suffix not in FILES:
        raise OptionError(f"--output: must end in .csv, .npz or .parquet; got {output.name!r}")
    options.check_folder("--output", output)
    one = decode_one(loaded, log, None if output is None else beside(output), **how)
    written = str(output.resolve()) if output is not None and one["cycles"] else None
    return {"topology": loaded.name, "logs": [one], "cycles": one["cycles"],
            "faults": one["faults"], "output": written}  # fmt: skip


def _named(paths: tuple[str, ...]) -> tuple[Topology, list[Path]]:
    """The topology and the logs that are named; that of a recording that comes first."""
    from skin.errors import OptionError
    from topology import load

    given = list(paths)
    if given and is_recording(given[0]):
        from skin.io.record.replay import recorded_topology

        loaded = recorded_topology(given[0])
    elif len(given) < 2:
        raise OptionError("decode: must be given a topology and a log, or a recording; got "
                          f"{' '.join(given) or 'none'}")  # fmt: skip
    else:
        loaded = load(given.pop(0))
    for log in given:
        if Path(log).is_dir():
            raise OptionError(f"{log}: must be a log; got a folder: name its logs, as {log}/*.log")
    return loaded, [Path(log) for log in given]


@contextmanager
def _pool(jobs: int) -> Iterator[ProcessPoolExecutor | None]:
    """Processes that end with this one, however it ends."""
    if jobs < 2:
        yield None
        return
    # spawned, not forked, so that they inherit no thread or lock
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, context, initializer=_end_with_parent)
    try:
        yield pool
    except BaseException:
        for child in multiprocessing.active_children():
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """Processes of a pool wait for ever for one that was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()
