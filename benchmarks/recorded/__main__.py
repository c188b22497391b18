"""Score the slip detector and the usual ones on recordings of others.

Files: slip sets of ARQ (uSkin of 18 or 24 taxels, HDF5) and tables of Contactile's PapillArray
(CSV). `docs/explanation/recorded.md` says what is read, what is assumed, and what the figures are.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.__main__ import machine
from benchmarks.recorded.array import Array, load
from benchmarks.recorded.detect import FIGURES, watch
from benchmarks.recorded.read import read
from benchmarks.recorded.recording import LeftOut, Recording, RecordingError
from benchmarks.recorded.score import at_most, judge, score
from skin.errors import SkinError

OURS = "this detector"
HEADS = ("caught", "before gross", "ms median", "ms p90", "false a minute", "quiet with alarm")


def main(arguments: Sequence[str] | None = None) -> int:
    """Score FILEs; exit status 2 if one is not what it must be."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.recorded", description=__doc__)
    parser.add_argument("files", nargs="+", metavar="FILE", type=Path)
    parser.add_argument(
        "--array", metavar="TOML", type=Path,
        help="what the files do not say: positions_mm, mm_per_reading, n_per_mm, rest, press",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="end with one JSON object")
    options = parser.parse_args(arguments)
    try:
        found, left_out = gather(options.files, options.array)
    except SkinError as error:
        print(error, file=sys.stderr)
        return 2
    figures = measure(found, left_out)
    print(table(figures))
    if options.json:
        print(json.dumps({"benchmark": "recorded", **figures, "machine": machine()}))
    return 0


def gather(
    files: Sequence[Path], description: Path | None = None
) -> tuple[list[Recording], list[LeftOut]]:
    """Recordings of all files, and those that cannot be scored.

    Raises
    ------
    RecordingError
        A file is not what it must be, or nothing can be scored.
    LibraryError
        h5py is not installed, and a file needs it.
    """
    array = Array() if description is None else load(description)
    found: list[Recording] = []
    left_out: list[LeftOut] = []
    for file in files:
        recordings, others = read(file, array)
        found += recordings
        left_out += others
    if not found:
        why = "".join(f"\n  {one.name}: {one.why}" for one in left_out)
        raise RecordingError(f"{files[0]}: must hold a recording that can be scored; got none{why}")
    return found, left_out


def measure(found: Sequence[Recording], left_out: Sequence[LeftOut]) -> dict[str, Any]:
    """Figures of all detectors, by kind of array and of labels."""
    arrays: dict[str, Any] = {}
    for array in sorted({one.array for one in found}):
        some = [one for one in found if one.array == array]
        verdicts = [judge(one, watch(one)) for one in some]
        false = sum(one.false for one in verdicts)
        arrays[array] = {OURS: score(verdicts)}
        for name, figure in FIGURES.items():
            limit, others = at_most(some, [figure(one) for one in some], false)
            arrays[array][name] = {**score(others), "limit": limit}
    return {"arrays": arrays, "left_out": [{"name": one.name, "why": one.why} for one in left_out]}


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = []
    for array, rows in figures["arrays"].items():
        ours = rows[OURS]
        lines += [
            f"{array}: {ours['recordings']} recordings, {ours['slips']} slips, "
            f"{ours['hold_minutes']:.2f} minutes without",
            f"{'':<20}" + "".join(f"{head:>22}" for head in HEADS),
        ]
        lines += [f"{name:<20}" + "".join(f"{cell:>22}" for cell in _cells(row))
                  for name, row in rows.items()]  # fmt: skip
        lines.append("")
    lines.append(
        "in brackets: 95 % intervals; -: never, or not asked. The usual detectors have the limit "
        f"that catches most\nwith no more false alarms than {OURS}, found on these very files."
    )
    left_out = figures["left_out"]
    lines += [f"left out: {one['name']}: {one['why']}" for one in left_out]
    return "\n".join(lines)


def _cells(row: dict[str, Any]) -> list[str]:
    late, p90 = row["latency_ms_median"], row["latency_ms_p90"]
    return [
        _shown(row["caught"], "rate", 100.0, " %"),
        _shown(row["caught_before_gross"], "rate", 100.0, " %"),
        _shown(late, "median"),
        "-" if p90 is None else f"{p90:.0f}",
        _shown(row["false_alarms_per_minute"], "rate", digits=2),
        _shown(row["quiet_recordings_with_alarm"], "rate", 100.0, " %"),
    ]


def _shown(
    found: dict[str, Any] | None, name: str, times: float = 1.0, unit: str = "", digits: int = 0
) -> str:
    if found is None or found[name] is None:
        return "-"
    shown = f"{times * found[name]:.{digits}f}{unit}"
    if found["lower"] is None and found["upper"] is None:
        return shown
    ends = ["-" if found[end] is None else f"{times * found[end]:.{digits}f}"
            for end in ("lower", "upper")]  # fmt: skip
    return f"{shown} ({' to '.join(ends)})"


if __name__ == "__main__":
    sys.exit(main())
