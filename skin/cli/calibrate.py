"""`skin calibrate`: from a bench to a calibration file."""

from __future__ import annotations

import json as json_text
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from skin.cli import options
from skin.cli.table import columns, progress

if TYPE_CHECKING:
    from skin.calibrate.bench.run import Outcome

__all__ = ["SUBCOMMANDS", "calibrate", "check", "crosstalk", "plan"]

SUBCOMMANDS = {
    "plan": "skin.cli.calibrate:plan",
    "check": "skin.cli.calibrate:check",
    "crosstalk": "skin.cli.calibrate:crosstalk",
}
"""Words that stand for commands of their own: module and function."""

UNTOUCHED_S = 2.0
"""Of the tare, at the beginning of the log of a touched skin."""

Bench = Annotated[
    Path, tyro.conf.Positional, tyro.conf.arg(metavar="BENCH", help="BENCH file of the recordings")
]


def calibrate(
    bench: Bench,
    /,
    *,
    output: options.Calibration = None,
    write: options.Write = False,
    report: Annotated[
        Path | None,
        options.quiet("report with plots to write, one HTML file", metavar="FILE"),
    ] = None,
    map: options.Map = (),
    force: Annotated[
        bool, options.quiet("fit and write although recordings or results have faults")
    ] = False,
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
    from skin.view.calibration import REPORT

    options.check_folder("--report", report, REPORT)
    if output is not None and not output.is_dir():
        options.check_folder("--output", output)
    announcer()
    outcome = calibrate_bench(bench, force=force, progress=progress, **options.mapped(map))
    for fault in outcome.faults:
        print(fault, file=sys.stderr)
    files: dict[str, Path] = {}
    stencil: Path | None = None
    refused = bool(outcome.faults) and not force
    if not refused:
        if not outcome.results and outcome.learned is None:
            raise SkinError("\n".join([f"{bench}: must fix a parameter of a unit; got none",
                                       *outcome.notes]))  # fmt: skip
        files = outcome.write(output)
        stencil = outcome.write_stencil(output)
    if report is not None and outcome.results:
        from skin.view.calibration import write_report

        write_report(report, outcome)
        print(f"report: written to {report}")
    print(_table(outcome))
    written = options.named_in_file(outcome.topology, files, write)
    for note in outcome.notes:
        print(f"not learned: {note}", file=sys.stderr)
    if stencil is not None and (learned := outcome.learned) is not None:
        print(f"{stencil}: stray fields within {learned.sigma_ut:.1f} µT")
        if learned.missing:
            print(f"not pressed: {', '.join(learned.missing)}")
    if refused:
        print("nothing was written (--force writes all the same)", file=sys.stderr)
    if json:
        found = {"topology": outcome.topology.name, "units": len(outcome.results),
                "faults": list(outcome.faults), "notes": list(outcome.notes),
                "stencil": None if stencil is None else str(stencil.resolve()),
                "results": {r.unit: {"goodness": r.goodness, "kept": r.kept, "left": r.left,
                                     "range": r.range} for r in outcome.results},
                "report": None if report is None else str(report.resolve())}  # fmt: skip
        print(json_text.dumps(found | written))
    return int(refused)


def plan(file: options.File, /, *, json: options.Json = False) -> int:
    """Print what to record of the units of a topology, in which order and for how long."""
    from skin.calibrate.bench.plan import steps
    from topology import load

    loaded = load(file)
    unit, array = steps(loaded)
    for head, protocol in (("each unit on a bench", unit), ("all units in their places", array)):
        minutes = sum(step.seconds for step in protocol) / 60.0
        print(f"{head}, {minutes:.0f} min:")
        rows = [(step.kind, f"{step.seconds:g} s", step.text) for step in protocol]
        print("\n".join(f"  {line}" for line in columns(("segment", "time", "what"), rows)))
    print(
        "\nReference: time, and any of force (N), displacement (mm), temperature (°C). The laws of "
        "a missing quantity\nstay those of the model, and are listed. The formats: "
        "docs/guides/calibrate.md."
    )
    if json:
        found = {"topology": loaded.name, "unit": [step._asdict() for step in unit],
                "array": [step._asdict() for step in array]}  # fmt: skip
        print(json_text.dumps(found))
    return 0


def check(
    calibration: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE", help="calibration file")
    ],
    bench: Bench,
    /,
    *,
    map: options.Map = (),
    json: options.Json = False,
) -> int:
    """Score a calibration on new recordings, and name the units that drifted or were swapped.

    Exits with 1 if a unit has.
    """
    from skin.calibrate.bench.run import check_bench
    from skin.compiling import announcer

    announcer()
    checked = check_bench(calibration, bench, progress, **options.mapped(map))
    rows = []
    for name, entry in checked.items():
        score = entry.get("score")
        over = score.over_sigma if score else {}
        rows.append(
            (
                name,
                entry["serial"],
                f"{score.force_rmse_n:.4f}" if score else "-",
                *(
                    f"{over[q]:.2f}" if q in over else "-"
                    for q in ("tangential", "normal", "temperature")
                ),
                f"{score.rest_hz:.1f}" if score else "-",
                "drifted" if entry["faults"] else "holds",
            )
        )
    head = ("unit", "serial", "force rmse / N", "Ft / sigma", "Fz / sigma", "T / sigma",
            "rest / Hz", "")  # fmt: skip
    print("\n".join(columns(head, rows)))
    faults = [fault for entry in checked.values() for fault in entry["faults"]]
    for fault in faults:
        print(fault, file=sys.stderr)
    if json:
        units = {name: entry | ({"score": asdict(entry["score"])} if "score" in entry else {})
                 for name, entry in checked.items()}  # fmt: skip
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
    output: options.Calibration = None,
    write: options.Write = False,
    map: options.Map = (),
    json: options.Json = False,
) -> int:
    """Learn the stray field of every film from a log of a touched skin (`skin run FILE --record`).

    Nothing touches the skin for the first two seconds of it. Then each unit is pressed and sheared
    for a second, in all directions, and its neighbours are left alone. Zeros are written to the
    calibration files. Exit status 1, and nothing is written, if the skin could not be tared or no
    press was seen.
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
    calibration_files(loaded, chosen(loaded), output)  # refused before, not after
    try:
        counts = read_counts(loaded, log, options.mapped(map, log).get("channels"))
        touched = (counts.time_s >= UNTOUCHED_S).astype(int)
        kinds = np.array([KINDS.index("tare"), KINDS.index("neighbours")])
        learned = learn_stencil(loaded, Touched(counts, kinds[touched], touched))
    except ScanError as error:
        return refused(str(error), loaded, json)
    files = learned.zeros.write(output)
    learned.stencil.save(stencil)
    print(f"{stencil}: stray fields within {learned.sigma_ut:.1f} µT")
    written = options.named_in_file(loaded, files, write)
    if learned.missing:
        print(f"not pressed: {', '.join(learned.missing)}")
    if json:
        report = {"topology": loaded.name, "units": loaded.n, "missing": learned.missing,
                  "refused": [], "sigma_ut": learned.sigma_ut,
                  "stencil": str(stencil.resolve())}  # fmt: skip
        print(json_text.dumps(report | written))
    return 0


def _table(outcome: Outcome) -> str:
    rows = []
    for result in outcome.results:
        good = result.goodness
        score: Any = outcome.scores.get(result.unit)
        lag = f"{good['lag_s']:.4f} ± {good['lag_sigma_s']:.4f}" if "lag_s" in good else "-"
        rows.append((
            result.unit, outcome.serials.get(result.unit, ""), lag,
            f"{score.force_rmse_n:.4f}" if score else "-",
            f"{1e3 * good['displacement_rms_mm']:.0f}" if "displacement_rms_mm" in good else "-",
            ", ".join(result.kept) or "nothing",
        ))  # fmt: skip
    head = ("unit", "serial", "lag / s", "force rmse / N", "film / µm", "kept as the model has it")
    return "\n".join(columns(head, rows))
