"""`skin calibrate`: from a bench to a calibration file."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro

from skin.cli import options
from skin.cli.table import end, progress

__all__ = ["SUBCOMMANDS", "calibrate", "check", "crosstalk", "plan"]

SUBCOMMANDS = ("plan", "check", "crosstalk")
"""Words that stand for commands of their own."""

UNTOUCHED_S = 2.0
"""Of the tare, at the beginning of the log of a touched skin."""

Bench = Annotated[
    Path, tyro.conf.Positional, options.arg("BENCH", help="BENCH file of the recordings")
]


def calibrate(
    bench: Bench,
    /,
    *,
    output: options.Calibration = None,
    report: Annotated[Path | None, options.arg("FILE")] = None,
    json: options.Json = False,
) -> int:
    """Fit units to the recordings of a bench and write their calibration file.

    Also: `skin calibrate plan FILE` prints what to record, `skin calibrate check FILE BENCH` scores
    an old calibration on new recordings, `skin calibrate crosstalk FILE LOG STENCIL` learns the
    stray fields of neighbours from a finger. docs/guides/calibrate.md has the formats.

    Recordings are judged first, and what was found is checked on them at the end. If anything is
    wrong, it is named, nothing is written and the exit status is 1.

    Parameters
    ----------
    report
        report with plots to write, one HTML file
    """
    from skin.calibrate.bench.run import calibrate_bench
    from skin.compiling import announce
    from skin.errors import SkinError
    from skin.view.calibration import REPORT, write_report

    options.check_folder("--report", report, REPORT)
    if output is not None and not output.is_dir():
        options.check_folder("--output", output)
    announce()
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
    else:
        print("nothing was written", file=sys.stderr)
    drawn = report is not None and bool(outcome.results)
    if report is not None and drawn:
        write_report(report, outcome)
    options.note(f"not learned: {text}" for text in outcome.notes)
    learned, scores = outcome.learned, outcome.scores
    found = {
        "topology": outcome.topology.name, "units": len(outcome.results),
        "faults": list(outcome.faults), "notes": list(outcome.notes),
        "stencil": None if stencil is None else str(stencil.resolve()),
        "stencil_sigma_ut": None if learned is None else learned.sigma_ut,
        "not_pressed": [] if learned is None else learned.missing,
        "report": str(report.resolve()) if report is not None and drawn else None,
        "results": {
            one.unit: {
                "serial": outcome.serials.get(one.unit, ""),
                "force_rmse_n": scores[one.unit].force_rmse_n if one.unit in scores else None,
                "lag_s": one.goodness.get("lag_s"), "goodness": one.goodness, "kept": one.kept,
                "left": one.left, "range": one.range,
            } for one in outcome.results
        },
    }  # fmt: skip
    end(found | options.named_in_file(outcome.topology, files), json)
    return int(bool(outcome.faults))


def plan(file: options.File, /, *, json: options.Json = False) -> int:
    """Print what to record of the units of a topology, in which order and for how long.

    `unit`: each unit on a bench; `array`: all units in their places. A reference has the time, and
    any of force (N), displacement (mm) and temperature (°C); the laws of a missing quantity stay
    those of the model, and are listed. docs/guides/calibrate.md has the formats.
    """
    from skin.calibrate.bench.file import steps
    from topology import load

    loaded = load(file)
    unit, array = ([step._asdict() for step in protocol] for protocol in steps(loaded))
    end({"topology": loaded.name, "unit": unit, "array": array}, json)
    return 0


def check(
    calibration: Annotated[Path, tyro.conf.Positional, options.arg("FILE")],
    bench: Bench,
    /,
    *,
    json: options.Json = False,
) -> int:
    """Score a calibration on new recordings, and name the units that drifted or were swapped.

    Exits with 1 if a unit has.

    Parameters
    ----------
    calibration
        calibration file
    """
    from skin.calibrate.bench.run import check_bench
    from skin.compiling import announce

    announce()
    checked = check_bench(calibration, bench, progress)
    units = {name: {"serial": one["serial"], "faults": one["faults"]}
             | (asdict(one["score"]) if "score" in one else {})
             for name, one in checked.items()}  # fmt: skip
    end({"calibration": str(calibration), "units": units}, json)
    faults = [fault for entry in checked.values() for fault in entry["faults"]]
    for fault in faults:
        print(fault, file=sys.stderr)
    return int(bool(faults))


def crosstalk(
    file: options.File,
    log: Annotated[Path, tyro.conf.Positional, options.arg("LOG")],
    stencil: Annotated[Path, tyro.conf.Positional, options.arg("STENCIL.npz")],
    /,
    *,
    json: options.Json = False,
) -> int:
    """Learn the stray field of every film from a log of a touched skin (`skin run FILE --record`).

    Nothing touches the skin for the first two seconds of it. Then each unit is pressed and sheared
    for a second, in all directions, and its neighbours are left alone. Zeros are written to the
    calibration files that the topology names, or next to it. Exit status 1, and nothing is written,
    if the skin could not be tared or no press was seen.

    Parameters
    ----------
    log
        recorded log of that skin
    stencil
        file to write what was learned to
    """
    import numpy as np

    from skin.calibrate.bench.file import KINDS
    from skin.calibrate.bench.series import read_counts
    from skin.calibrate.crosstalk import learn_stencil
    from skin.calibrate.files import calibration_files
    from skin.calibrate.tare import chosen
    from skin.cli.tare import refused
    from skin.compiling import announce
    from skin.errors import ScanError
    from skin.physics.stencil import STENCIL_FILE

    options.check_folder("STENCIL", stencil, STENCIL_FILE)
    announce()
    loaded = options.load(file, allow_no_calibration=True)
    calibration_files(loaded, chosen(loaded))  # refused before, not after
    try:
        counts = read_counts(loaded, log)
        touched = (counts.time_s >= UNTOUCHED_S).astype(int)
        kinds = np.array([KINDS.index("tare"), KINDS.index("neighbours")])
        learned = learn_stencil(loaded, counts, kinds[touched], touched)
    except ScanError as error:
        return refused(str(error), loaded, json)
    files = learned.zeros.write()
    learned.stencil.save(stencil)
    report = {"topology": loaded.name, "units": loaded.n, "missing": learned.missing,
              "refused": [], "sigma_ut": learned.sigma_ut,
              "stencil": str(stencil.resolve())}  # fmt: skip
    end(report | options.named_in_file(loaded, files), json)
    return 0
