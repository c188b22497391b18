"""`skin calibrate`: from a bench to a calibration file."""

from __future__ import annotations

import json as json_text
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro

from skin.cli import options
from skin.cli.table import end, progress, table

__all__ = ["SUBCOMMANDS", "calibrate", "check", "crosstalk", "plan"]

SUBCOMMANDS = ("plan", "check", "crosstalk")
"""Words that stand for commands of their own."""

UNTOUCHED_S = 2.0
"""Of the tare, at the beginning of the log of a touched skin."""
RESULTS = ("unit", "serial", "lag_s", "lag_sigma_s", "force_rmse_n", "displacement_rms_mm", "kept")
SCORES = ("unit", "serial", "force_rmse_n", "tangential", "normal", "temperature", "rest_hz",
          "faults")  # fmt: skip
"""Columns that people see; of errors over sigma `tangential`, `normal` and `temperature`."""

Bench = Annotated[
    Path, tyro.conf.Positional, tyro.conf.arg(metavar="BENCH", help="BENCH file of the recordings")
]


def calibrate(
    bench: Bench,
    /,
    *,
    output: options.Calibration = None,
    report: Annotated[
        Path | None,
        options.quiet("report with plots to write, one HTML file", metavar="FILE"),
    ] = None,
    json: options.Json = False,
) -> int:
    """Fit units to the recordings of a bench and write their calibration file.

    Also: `skin calibrate plan FILE` prints what to record, `skin calibrate check FILE BENCH` scores
    an old calibration on new recordings, `skin calibrate crosstalk FILE LOG STENCIL` learns the
    stray fields of neighbours from a finger. docs/guides/calibrate.md has the formats.

    Recordings are judged first, and what was found is checked on them at the end. If anything is
    wrong, it is named, nothing is written and the exit status is 1.
    """
    from skin.calibrate.bench.run import calibrate_bench
    from skin.compiling import announcer
    from skin.errors import SkinError
    from skin.view.calibration import REPORT, write_report

    options.check_folder("--report", report, REPORT)
    if output is not None and not output.is_dir():
        options.check_folder("--output", output)
    announcer()
    outcome = calibrate_bench(bench, progress=progress)
    for fault in outcome.faults:
        print(fault, file=sys.stderr)
    files: dict[str, Path] = {}
    stencil: Path | None = None
    if not outcome.faults:
        if not outcome.results and outcome.learned is None:
            raise SkinError("\n".join([f"{bench}: must fix a parameter of a unit; got none",
                                       *outcome.notes]))  # fmt: skip
        files = outcome.write(output)
        stencil = outcome.write_stencil(output)
    if report is not None and outcome.results:
        write_report(report, outcome)
        print(f"report: written to {report}")
    rows = [
        {"unit": one.unit, "serial": outcome.serials.get(one.unit, "")} | one.goodness
        | ({"force_rmse_n": score.force_rmse_n} if score else {}) | {"kept": list(one.kept)}
        for one in outcome.results for score in (outcome.scores.get(one.unit),)
    ]  # fmt: skip
    print(table(rows, *RESULTS))
    written = options.named_in_file(outcome.topology, files)
    options.note(f"not learned: {text}" for text in outcome.notes)
    if stencil is not None and (learned := outcome.learned) is not None:
        print(f"{stencil}: stray fields within {learned.sigma_ut:.1f} µT")
        if learned.missing:
            print(f"not pressed: {', '.join(learned.missing)}")
    if outcome.faults:
        print("nothing was written", file=sys.stderr)
    if json:
        found = {"topology": outcome.topology.name, "units": len(outcome.results),
                "faults": list(outcome.faults), "notes": list(outcome.notes),
                "stencil": None if stencil is None else str(stencil.resolve()),
                "results": {r.unit: {"goodness": r.goodness, "kept": r.kept, "left": r.left,
                                     "range": r.range} for r in outcome.results},
                "report": None if report is None else str(report.resolve())}  # fmt: skip
        print(json_text.dumps(found | written))
    return int(bool(outcome.faults))


def plan(file: options.File, /, *, json: options.Json = False) -> int:
    """Print what to record of the units of a topology, in which order and for how long.

    `unit`: each unit on a bench; `array`: all units in their places. A reference has the time, and
    any of force (N), displacement (mm) and temperature (°C); the laws of a missing quantity stay
    those of the model, and are listed. docs/guides/calibrate.md has the formats.
    """
    from skin.calibrate.bench.plan import steps
    from topology import load

    loaded = load(file)
    unit, array = ([step._asdict() for step in protocol] for protocol in steps(loaded))
    end({"topology": loaded.name, "unit": unit, "array": array}, json)
    return 0


def check(
    calibration: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE", help="calibration file")
    ],
    bench: Bench,
    /,
    *,
    json: options.Json = False,
) -> int:
    """Score a calibration on new recordings, and name the units that drifted or were swapped.

    Exits with 1 if a unit has.
    """
    from skin.calibrate.bench.run import check_bench
    from skin.compiling import announcer

    announcer()
    checked = check_bench(calibration, bench, progress)
    units = {name: entry | ({"score": asdict(entry["score"])} if "score" in entry else {})
             for name, entry in checked.items()}  # fmt: skip
    rows = ({"unit": name} | entry | (score := entry.get("score", {})) | score.get("over_sigma", {})
            | {"faults": entry["faults"]} for name, entry in units.items())  # fmt: skip
    print(table(rows, *SCORES))
    faults = [fault for entry in checked.values() for fault in entry["faults"]]
    for fault in faults:
        print(fault, file=sys.stderr)
    if json:
        print(json_text.dumps({"calibration": str(calibration), "units": units}))
    return int(bool(faults))


def crosstalk(
    file: options.File,
    log: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG", help="recorded log of that skin")
    ],
    stencil: Annotated[
        Path,
        tyro.conf.Positional,
        tyro.conf.arg(metavar="STENCIL.npz", help="file to write what was learned to"),
    ],
    /,
    *,
    json: options.Json = False,
) -> int:
    """Learn the stray field of every film from a log of a touched skin (`skin run FILE --record`).

    Nothing touches the skin for the first two seconds of it. Then each unit is pressed and sheared
    for a second, in all directions, and its neighbours are left alone. Zeros are written to the
    calibration files that the topology names, or next to it. Exit status 1, and nothing is written,
    if the skin could not be tared or no press was seen.
    """
    import numpy as np

    from skin.calibrate.bench.file import KINDS
    from skin.calibrate.bench.neighbours import Touched, learn_stencil
    from skin.calibrate.bench.series import read_counts
    from skin.calibrate.tare import calibration_files, chosen
    from skin.cli.tare import refused
    from skin.compiling import announcer
    from skin.errors import ScanError
    from skin.physics.stencil import STENCIL_FILE

    options.check_folder("STENCIL", stencil, STENCIL_FILE)
    announcer()
    loaded = options.load(file, allow_no_calibration=True)
    calibration_files(loaded, chosen(loaded))  # refused before, not after
    try:
        counts = read_counts(loaded, log)
        touched = (counts.time_s >= UNTOUCHED_S).astype(int)
        kinds = np.array([KINDS.index("tare"), KINDS.index("neighbours")])
        learned = learn_stencil(loaded, Touched(counts, kinds[touched], touched))
    except ScanError as error:
        return refused(str(error), loaded, json)
    files = learned.zeros.write()
    learned.stencil.save(stencil)
    print(f"{stencil}: stray fields within {learned.sigma_ut:.1f} µT")
    written = options.named_in_file(loaded, files)
    if learned.missing:
        print(f"not pressed: {', '.join(learned.missing)}")
    if json:
        report = {"topology": loaded.name, "units": loaded.n, "missing": learned.missing,
                  "refused": [], "sigma_ut": learned.sigma_ut,
                  "stencil": str(stencil.resolve())}  # fmt: skip
        print(json_text.dumps(report | written))
    return 0
