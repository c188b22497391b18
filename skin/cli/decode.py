"""`skin decode`: recorded logs into forces."""

from __future__ import annotations

import json as json_text
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from skin.cli import options
from skin.io.record import is_recording

if TYPE_CHECKING:
    from skin.io.bulk.progress import ProgressReport
    from topology import Topology

__all__ = ["decode"]

Paths = Annotated[
    tuple[str, ...],
    tyro.conf.Positional,
    tyro.conf.arg(
        metavar="[TOPOLOGY] LOG [LOG ...]",
        help="topology file, or the name of a ready-made one, and recorded CAN logs or "
        "recordings; logs alone with --topology, recordings alone by their own",
    ),
]
Output = Annotated[
    Path | None,
    options.quiet(
        "where to write: a folder for any number of logs; of one log .csv (a row for each "
        "cycle and unit), .npz (arrays) or .parquet (a row for each cycle)",
        metavar="DIR|FILE",
        aliases=["-o"],
    ),
]


def decode(
    paths: Paths,
    /,
    *,
    topology: Annotated[
        str | None,
        options.quiet(f"{options.FILE_HELP}; then all that comes first are logs", metavar="FILE"),
    ] = None,
    output: Output = None,
    want: Annotated[
        tuple[str, ...],
        options.quiet("what to decode into a folder; forces, temperatures, contacts and slip "
                      "otherwise; of recordings as their runs", metavar="NAME [NAME ...]"),
    ] = (),
    sweeps: options.Sweeps = None,
    dtype: options.DType = None,
    jobs: Annotated[
        int, tyro.conf.arg(metavar="N", help="logs that are decoded side by side")
    ] = 1,
    format: Annotated[
        Literal["parquet", "npz"], tyro.conf.arg(help="of the files in a folder")
    ] = "parquet",
    shard: Annotated[
        str | None,
        options.quiet("every N-th log only, from the I-th on, for one of N machines",
                      metavar="I/N"),
    ] = None,
    cluster: Annotated[
        str | None,
        options.quiet("decode on the dask cluster of this scheduler", metavar="ADDRESS"),
    ] = None,
    map: options.Map = (),
    force: Annotated[
        bool, options.quiet("decode logs into a folder that have not changed, too")
    ] = False,
    json: options.Json = False,
) -> int:  # fmt: skip
    """Decode recorded CAN logs (candump, BLF, ASC, TRC, MF4, …) and recordings of `skin record`.

    Into a folder go Parquet files in parts: cycles, contacts, and fault intervals of units
    (docs/guides/bulk.md). Every number is
    that of the live skin, into a folder or a file: logs are decoded by the defaults of `skin.open`,
    but for --sweeps and --dtype, as the report and all files but .csv state. A log that was decoded
    before and has not changed is left out; after an interruption the same call goes on.

    A .csv has a row for each cycle and unit; next to it are FILE.wrench.csv with a row for each
    cycle, FILE.contacts.csv with one for each cycle and contact, and FILE.events.csv with what
    happened to contacts: born, resumed, merged, split, ended, stick, incipient, gross. 1 is the
    limit of a test_ratio (field against model); whole is 0 where a silent unit may touch.

    The arrays of an .npz are time_s (t), temperature_c (t, n), force_n (t, 3, n), status (t, n),
    test_ratio (t, n), wrench (t, 6), centroid_m (t, 3), …, and unit (n); of k contacts in all
    cycles contact_cycle (an index of t), contact_id, contact_load_n, contact_centroid_m (k, 3), …;
    of e events event_time_s, event_contact and event. The contact of a unit is the identity of what
    touches it, 0 for nothing; _options are those of decoding, as JSON. A .parquet has a row for
    each cycle. All have the columns of docs/reference/columns.md.

    Exits with 1 if a log holds no cycle of this skin, is damaged, lacks SYNC or a bus, or has time
    that runs back, or could not be decoded; all that can be decoded is.
    """
    from skin.cli.decode_file import decode_file
    from skin.errors import OptionError

    loaded, logs = _named(paths, topology)
    mapped = options.mapped(map, *logs)
    asked = options.chosen(want=want or None, sweeps=sweeps, dtype=dtype)
    into_file = output is not None and output.suffix != "" and not output.is_dir()
    _refuse_folders(logs)
    if len(logs) == 1 and (output is None or into_file):
        _refuse_of_folders(output, want=want, jobs=jobs != 1, format=format != "parquet",
                           shard=shard, cluster=cluster, force=force)  # fmt: skip
        return decode_file(logs[0], topology=loaded, output=output, asked=asked | mapped, json=json)
    if output is None or into_file:
        raise OptionError(f"--output: must be a folder for several logs; got {output}")
    return _into_folder(
        _shared(logs, shard), loaded, output, json,
        {"options": asked, "jobs": jobs, "format": format, "force": force, "cluster": cluster,
         **mapped},
    )  # fmt: skip


def _refuse_folders(logs: list[Path]) -> None:
    from skin.errors import OptionError

    for log in logs:
        if log.is_dir():
            raise OptionError(f"{log}: must be a log; got a folder: name its logs, as {log}/*.log")


def _named(paths: tuple[str, ...], topology: str | None) -> tuple[Topology, list[Path]]:
    """The topology and the logs that are named; that of the first recording, where it comes first
    and no other is given."""
    from skin.errors import OptionError
    from topology import load

    given = list(paths)
    if topology is None:
        if given and is_recording(given[0]):
            from skin.io.record.replay import recorded_topology

            return recorded_topology(given[0]), [Path(log) for log in given]
        if len(given) < 2:
            raise OptionError("decode: must be given a topology and a log, or a recording; got "
                              f"{' '.join(given) or 'none'}")  # fmt: skip
        topology, *given = given
    return load(topology), [Path(log) for log in given]


def _refuse_of_folders(output: Path | None, **given: object) -> None:
    """Options that a single file, or none, would leave out without a word."""
    from skin.errors import OptionError

    for name, value in given.items():
        if value:
            raise OptionError(f"--{name}: must be given with a folder as --output; got {output}")


def _shared(logs: list[Path], shard: str | None) -> list[Path]:
    """The logs of one of several machines, the same on all of them."""
    if shard is None:
        return logs
    from skin.errors import OptionError

    first, _, count = shard.partition("/")
    if not (first.isdecimal() and count.isdecimal() and 1 <= int(first) <= int(count)):
        raise OptionError(f"--shard: must be I/N with I from 1 to N; got {shard!r}")
    return sorted(logs)[int(first) - 1 :: int(count)]


def _into_folder(
    logs: list[Path], topology: Topology, output: Path, json: bool, how: dict[str, Any]
) -> int:
    """Decode logs into a folder."""
    from skin.io.bulk.job import Job
    from skin.io.bulk.run import run

    if not output.is_dir():
        options.check_folder("--output", output)
    channels = how.get("channels", {})
    job = Job(topology, output, how["options"], how["format"], how["force"], channels=channels)
    if not logs:
        print(json_text.dumps({"logs": []}) if json else "no log for this shard")
        return 0
    bar = _Bar()
    if how["cluster"] is None:
        report = run(job, logs, jobs=how["jobs"], on_progress=bar)
    else:
        from skin.io.bulk.cluster import run_on

        report = run_on(how["cluster"], job, logs, on_progress=bar)
    bar.end()
    report["output"] = str(output.resolve())
    print(json_text.dumps(report) if json else _table(report))
    for one in report["logs"]:
        for note in one.get("notes", ()):
            print(f"note: {note}", file=sys.stderr)
    for fault in report["faults"]:
        print(fault, file=sys.stderr)
    return int(bool(report["faults"]))


def _table(report: dict[str, Any]) -> str:
    from skin.cli.table import counted

    lines = []
    for one in report["logs"]:
        text = f"{one['log']}: {one['state']}: {one.get('cycles', 0)} cycles"
        if "valid_share" in one:
            text += (f", valid {options.percent(one['valid_share'])}, {one['contacts']} contacts, "
                     f"{one['slips']} slips")  # fmt: skip
        if one.get("cycles_missing"):
            text += f", {one['cycles_missing']} cycles missing"
        if one.get("left_out"):
            text += f"; other channels: {counted(one['left_out'])}"
        if "counters" in one:
            text += f"; frames: {counted(one['counters'])}"
        lines.append(text)
    lines.append(
        f"{report['decoded']} decoded, {report['unchanged']} unchanged, {report['failed']} failed; "
        f"{report['wall_s']:.1f} s, {report['frames_per_s'] / 1e6:.2f} M frames/s"
    )
    return "\n".join([*lines, f"written: {report['output']}"])


class _Bar:
    """A line of progress on standard error, where a terminal shows it."""

    EVERY_S = 10.0

    def __init__(self) -> None:
        self._live, self._shown_at, self._width = sys.stderr.isatty(), time.monotonic(), 0

    def __call__(self, progress: ProgressReport) -> None:
        text, now = str(progress), time.monotonic()
        if self._live:
            bar = "█" * round(20 * progress.fraction)
            line = f"{bar:<20} {text}"
            print(f"\r{line:<{self._width}}", end="", file=sys.stderr, flush=True)
            self._width = len(line)
        elif now - self._shown_at > self.EVERY_S:
            self._shown_at = now
            print(text, file=sys.stderr, flush=True)

    def end(self) -> None:
        if self._live and self._width:
            print(file=sys.stderr)
