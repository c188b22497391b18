"""`skin demo grip`: the grip follows what pulls at an object, as in the paper's Fig. 4c."""

from __future__ import annotations

import json as json_text
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from skin.cli import options
from skin.cli.demo_picture import check_picture
from skin.cli.table import facts

if TYPE_CHECKING:
    from skin.demos.disturbance import Disturbance
    from skin.view.grip_picture import GripCurves

__all__ = ["demo_grip"]


def demo_grip(
    *,
    seed: Annotated[
        int, tyro.conf.arg(metavar="INT", help="seed of the object, the pulls and the noise")
    ] = 0,
    fast: options.Fast = False,
    picture: options.Picture = Path("skin-grip.png"),
    json: options.Json = False,
) -> int:
    """Hold an object of unknown weight and friction with the least grip, while it is pulled.

    3 s at rest, 4 s of pulls and turns in all directions, 3 s of recovery, as in the paper's
    Fig. 4c. MuJoCo moves gripper and object, and the control knows no more than the frames on the
    bus say. Exit status 1 where the object is dropped. The picture needs matplotlib, all else does
    not.
    """
    from skin.demos.disturbance import run_disturbance
    from skin.demos.disturbance_score import figures_of
    from skin.errors import MOST_SEED, LibraryError, check_number
    from skin.view.grip_picture import save_grip

    check_picture(picture)
    check_number("--seed", seed, 0, MOST_SEED, whole=True)
    run = run_disturbance(seed, pace=not fast)
    thing = run.case.thing
    report = {
        "seed": seed,
        "shape": thing.shape,
        "mass_kg": round(thing.mass_kg, 4),
        "friction": round(thing.friction, 4),
        "dead_units": int(run.case.dead.size),
        **figures_of(run),
        "decisions": [str(one) for one in run.decisions],
    }
    try:
        save_grip(picture, _curves(run), _title(report))
        report["picture"] = str(picture.resolve())
    except LibraryError as error:
        print(error, file=sys.stderr)
        report["picture"] = None
    print(json_text.dumps(report) if json else _table(report), flush=True)
    return 1 if run.dropped else 0


def _curves(run: Disturbance) -> GripCurves:
    """A run as arrays for its picture."""
    from skin.view.grip_picture import GripCurves

    columns = [name for name in GripCurves._fields if name not in ("clock_s", "decisions")]
    began_s = 0.0 if np.isnan(run.lifted_s) else run.lifted_s
    return GripCurves(
        clock_s=np.array(run.time_s) - began_s,
        decisions=[(one.time_s - began_s, one.what) for one in run.decisions],
        **{name: np.array(getattr(run, name)) for name in columns},
    )


def _title(report: dict[str, Any]) -> str:
    dead = f", {report['dead_units']} units dead" if report["dead_units"] else ""
    outcome = "dropped" if report["dropped"] else "held"
    return (
        f"A {report['shape']} of {report['mass_kg']:.3f} kg and friction "
        f"{report['friction']:.2f}{dead}, "
        f"pulled and turned: {outcome}"
    )


def _table(report: dict[str, Any]) -> str:
    rows = {
        "object": "{shape}, {mass_kg:.3f} kg, friction {friction:.2f}: the control knows none",
        "friction believed": "{friction_believed:.2f}, {slips} slips seen",
        "outcome": "{outcome}, went {slid_mm:.2f} mm along the pads",
        "grip by pad": "{grip_rest_n:.2f} N at rest, {grip_peak_n:.2f} N at most, "
        "{grip_after_n:.2f} N after",
        "grip above what holds": "{rest} at rest, {peak} at the peak, {median} in the middle",
        "control": "{work_us:.1f} µs a cycle",
        "picture": "{shown_picture}",
        "decisions": "{shown_decisions}",
    }

    def share(name: str) -> str:
        value = report[name]
        return "nothing" if value is None else f"{value:.0%}"

    shown = {
        "outcome": "dropped" if report["dropped"] else "held",
        "rest": share("margin_rest"), "peak": share("margin_peak"),
        "median": share("margin_median"),
        "shown_picture": report["picture"] or "none",
        "shown_decisions": ("\n" + 27 * " ").join(report["decisions"]),
    }  # fmt: skip
    return facts(rows, report | shown, 26)
