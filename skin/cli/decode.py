"""`skin decode`: recorded logs into forces."""

from __future__ import annotations

import json as json_text
import multiprocessing
import os
import sys
import threading
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from skin.cli import options
from skin.cli.table import counted
from skin.io.record import is_recording

if TYPE_CHECKING:
    from collections.abc import Iterator

    from topology import Topology

__all__ = ["decode"]

FILES = (".csv", ".npz", ".parquet")


Paths = Annotated[
    tuple[str, ...],
    tyro.conf.Positional,
    tyro.conf.arg(
        metavar="[TOPOLOGY] LOG [LOG ...]",
        help="topology file, or the name of a ready-made one, and recorded CAN logs or "
        "recordings; logs alone with --topology, recordings alone by their own",
    ),
]
TopologyFile = Annotated[
    str | None,
    options.quiet(f"{options.FILE_HELP}; then all that comes first are logs", metavar="FILE"),
]
Output = Annotated[
    Path | None,
    options.quiet(
        "where to write: a folder for any number of logs; of one log FILE.parquet, .csv or .npz "
        "(arrays)",
        metavar="DIR|FILE",
        aliases=["-o"],
    ),
]
Want = Annotated[
    tuple[str, ...],
    options.quiet(
        "what to decode; forces, temperatures, contacts and slip otherwise; of recordings as "
        "their runs",
        metavar="NAME [NAME ...]",
    ),
]
Jobs = Annotated[int, tyro.conf.arg(metavar="N", help="logs that are decoded side by side")]
Format = Annotated[Literal["parquet", "csv", "npz"], tyro.conf.arg(help="of the files in a folder")]


def decode(
    paths: Paths,
    /,
    *,
    topology: TopologyFile = None,
    output: Output = None,
    want: Want = (),
    sweeps: options.Sweeps = None,
    dtype: options.DType = None,
    jobs: Jobs = 1,
    format: Format = "parquet",
    map: options.Map = (),
    json: options.Json = False,
) -> int:
    """Decode recorded CAN logs (candump, BLF, ASC, TRC, MF4, …), and what `skin run` has recorded.

    Each log gives three tables, with the columns of docs/reference/columns.md in every format: a
    row for each cycle, in FILE itself; for each contact in a cycle, in FILE.contacts; for each
    interval in which a unit is not valid, in FILE.faults. Every number is that of the live skin:
    logs are decoded by the defaults of `skin.open`, but for --want, --sweeps and --dtype, as the
    report and all files but .csv state.

    Into a folder go the tables of any number of logs (docs/guides/bulk.md). A log whose Parquet
    files were made by the same topology, calibration and options is left out.

    Exits with 1 if a log holds no cycle or no valid reading of this skin, is damaged, lacks SYNC or
    a bus, has time that runs back, or could not be decoded; all that can be decoded is.
    """
    from skin.errors import OptionError, SkinError, check_number
    from skin.io.bulk import decode_logs, decode_one
    from skin.io.export.tables import beside

    loaded, logs = _named(paths, topology)
    mapped = options.mapped(map, *logs)
    asked = options.chosen(want=want or None, sweeps=sweeps, dtype=dtype)
    check_number("--jobs", jobs, 1, 256, whole=True)
    if output is not None and output.suffix and not output.is_dir():
        if output.suffix not in FILES:
            raise SkinError(f"--output: must end in .csv, .npz or .parquet; got {output.name!r}")
        if format != "parquet":
            raise OptionError(f"--format: must be given with a folder as --output; got {output}")
    elif output is not None:
        if not output.is_dir():
            options.check_folder("--output", output)
        with _pool(min(jobs, len(logs))) as executor:
            report = decode_logs(loaded, logs, output, executor=executor, format=format,
                                 on_log=None if json else _show, **mapped, **asked)  # fmt: skip
        return _end(report | {"output": str(output.resolve())}, json)
    if len(logs) > 1:
        raise OptionError(f"--output: must be a folder for several logs; got {output}")
    options.check_folder("--output", output)
    places = None if output is None else beside(output)
    one = decode_one(loaded, logs[0], places, options=asked, **mapped)
    written = str(output.resolve()) if output is not None and one["cycles"] else None
    if not json:
        _show(one)
    return _end({"topology": loaded.name, "logs": [one], "cycles": one["cycles"],
                 "faults": one["faults"], "output": written}, json)  # fmt: skip


def _named(paths: tuple[str, ...], topology: str | None) -> tuple[Topology, list[Path]]:
    """The topology and the logs that are named; that of the first recording, where it comes first
    and no other is given."""
    from skin.errors import OptionError
    from topology import load

    given = list(paths)
    if topology is None and given and is_recording(given[0]):
        from skin.io.record.replay import recorded_topology

        loaded = recorded_topology(given[0])
    elif topology is None and len(given) < 2:
        raise OptionError("decode: must be given a topology and a log, or a recording; got "
                          f"{' '.join(given) or 'none'}")  # fmt: skip
    else:
        loaded = load(given.pop(0) if topology is None else topology)
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


def _show(one: dict[str, Any]) -> None:
    """What became of a log, in a line or a few."""
    if one["state"] == "failed":
        print(f"{one['log']}: failed", flush=True)
        return
    text = f"{one['log']}: {one['state']}: {one['cycles']} cycles"
    text += f", valid readings {options.percent(one['valid_share'])}"
    if one["peak_force_n"] is not None:
        text += f", peak force {one['peak_force_n']:.2f} N"
    text += f", {one['contacts']} contacts, {one['slips']} slips"
    if one["cycles_missing"]:
        text += f", {one['cycles_missing']} cycles missing"
    text += f"; frames: {counted(one['counters'])}"
    for key, name in (("left_out", "frames of other channels"), ("skipped", "not decoded")):
        if one[key]:
            text += f"\n  {name}: {counted(one[key])}"
    print(text, flush=True)


def _end(report: dict[str, Any], json: bool) -> int:
    """Print the totals, and what is wrong; the exit status."""
    if json:
        print(json_text.dumps(report))
    else:
        if "wall_s" in report:
            print("{decoded} decoded, {unchanged} unchanged, {failed} failed; {wall_s:.1f} s"
                  .format(**report))  # fmt: skip
        if report["output"]:
            print(f"written: {report['output']}")
    notes = [f"note: {note}" for one in report["logs"] for note in one.get("notes", ())]
    sys.stderr.writelines(f"{line}\n" for line in (*notes, *report["faults"]))
    return int(bool(report["faults"]))
