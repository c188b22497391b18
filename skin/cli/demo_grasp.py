"""`skin demo grasp`: a gripper holds what it does not know, by slip, margin and one probe."""

from __future__ import annotations

import json as json_text
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from skin.cli import options
from skin.cli.demo_picture import check_picture
from skin.cli.table import facts

if TYPE_CHECKING:
    from skin.demos.grasp_trial import Trial
    from skin.view.grasp_picture import Shots

__all__ = ["demo_grasp", "figures_of"]


def demo_grasp(
    *,
    seed: Annotated[
        int, tyro.conf.arg(metavar="INT", help="seed of the object and of the noise")
    ] = 0,
    fast: options.Fast = False,
    picture: options.Picture = Path("skin-grasp.png"),
    json: options.Json = False,
) -> int:
    """Close a gripper on an object of unknown weight and friction, lift it, and pull at it.

    MuJoCo moves gripper and object, the skin makes the forces between them, and the controller
    knows no more than the frames on the bus: it holds by slip onset and grip margin, and
    grips harder for a moment to see whether what it has lifted hangs or slides. Exit status 1
    where the object is dropped. The picture needs matplotlib, all else does not.
    """
    from skin.demos.grasp_trial import run_trial
    from skin.errors import MOST_SEED, LibraryError, check_number
    from skin.view.grasp_picture import save_grasp

    check_picture(picture)
    check_number("--seed", seed, 0, MOST_SEED, whole=True)
    trial = run_trial(seed, pace=not fast)
    report = {"seed": seed, **figures_of(trial)}
    try:
        save_grasp(picture, shots_of(trial), _title(report))
        report["picture"] = str(picture.resolve())
    except LibraryError as error:
        print(error, file=sys.stderr)
        report["picture"] = None
    print(json_text.dumps(report) if json else _table(report), flush=True)
    return 1 if trial.dropped else 0


def figures_of(trial: Trial) -> dict[str, object]:
    """What a trial comes to."""
    time_s, margin = np.array(trial.time_s), np.array(trial.true_margin)
    load, true_load = np.array(trial.load_n), np.array(trial.true_load_n)
    hangs = time_s > time_s[-1] - 1.0
    held = float(np.nanmean(margin[hangs])) if np.isfinite(margin[hangs]).any() else None
    return {
        "shape": trial.thing.shape,
        "mass_kg": round(trial.thing.mass_kg, 4),
        "friction": round(trial.thing.friction, 4),
        "friction_believed": round(trial.belief[-1], 4),
        "slips_seen": trial.slips,
        "dropped": trial.dropped,
        "slid_mm": round(1e3 * trial.slid_m[-1], 3),
        "lifted_mm": round(1e3 * trial.height_m[-1], 3),
        "grip_n": round(float(true_load[hangs].mean()), 3),
        "grip_at_pull_n": round(float(true_load.max()), 3),
        "margin": None if held is None else round(held, 4),
        "over_squeezed_s": round(trial.over_squeezed_s, 3),
        "grip_rmse_n": round(float(np.sqrt(np.mean((load - true_load) ** 2))), 4),
    }


def shots_of(trial: Trial) -> Shots:
    """A trial as arrays for its picture."""
    from skin.view.grasp_picture import Shots

    size = trial.thing.size_m
    half = (size[0], size[2] if trial.thing.shape == "box" else size[1])
    columns = [name for name in Shots._fields if name != "half_m"]
    return Shots(**{name: np.array(getattr(trial, name)) for name in columns}, half_m=half)


def _title(report: dict[str, object]) -> str:
    outcome = "dropped" if report["dropped"] else "held"
    return (
        f"A {report['shape']} of {report['mass_kg']} kg and friction {report['friction']}, "
        f"{outcome}, by slip onset, grip margin and one probe"
    )


def _table(report: dict[str, object]) -> str:
    rows = {
        "object": "{shape}, {mass_kg:.3f} kg, friction {friction:.2f}: the controller knows none",
        "friction believed": "{friction_believed:.2f} after {slips_seen} slips",
        "outcome": "{outcome}, slid {slid_mm:.2f} mm along the pads",
        "grip by pad": "{grip_n:.2f} N at the end, {grip_at_pull_n:.2f} N at most",
        "margin": "{shown_margin} of what friction can hold, at the end",
        "margin above 60 %": "{over_squeezed_s:.2f} s at a stretch",
        "grip felt against truth": "{grip_rmse_n:.3f} N rms",
        "picture": "{shown_picture}",
    }
    margin = report["margin"]
    shown = {
        "outcome": "dropped" if report["dropped"] else "held",
        "shown_margin": "nothing" if margin is None else f"{margin:.0%}",
        "shown_picture": report["picture"] or "none",
    }
    return facts(rows, report | shown, 26)
