"""Figures of the grip control on brushes, by delay of the gripper, face and stuck units.

A cell of delay, face and stuck units has `EACH` trials, so that each delay has 300 and so has each
face. The mixed cell draws all of them for each of 300 trials, lag, stiction, rate and drive of the
gripper too, and friction in motion down to 0.6 of that at rest. All are run three times: with the
control, with the control that never probes, and with a grip of 6 N that never changes.

`dropped`: moved by more than 10 mm along the pads, or never lifted; `dropped_when` says in which
phase. Margins are friction times grip over the tangential load, minus 1, by the truth, medians over
the trials that held: `margin_rest` in the last 0.3 s before the pulls, `margin_peak` at the largest
load, `margin_median` over all from then to the end. `slid_mm` is how far the thing moved in the 3 s
of rest, where a probe is the only cause; the floor ends a fall at 15 mm. `felt_over_true` is the
load that the pads feel over that of the gripper, at rest; `shear_over_true` the demand of the
control on friction (tangential load and torsion) over the tangential load. `reaction_ms` is the
time from when half of the load slides to a rise of the command by 1 %.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Any

import numpy as np

from benchmarks.brush_pads import FACES
from benchmarks.brush_trial import (
    DELAYS_S,
    PULLED_S,
    REST_END_S,
    Cell,
    Trial,
    run_trial,
)
from benchmarks.slip_intervals import rate
from benchmarks.trust_skin import BAG, QUICK_BAG
from benchmarks.workers import in_parallel
from fig4c_adaptive_grasp import DROPPED_M, LATEST_S, LOOK_S, QUIET_S, RISEN
from skin.behaviours.grip import GripParameters

__all__ = ["cells", "row", "score", "trials"]

FIRST_SEED = 20_000
STUCK = (0, 2, 4)
EACH, MIXED = 25, 300
FIXED_N = 6.0
HALF = 0.5
"""Share of the load that slides, from which a reaction is counted."""
NAMES = ("control", "no probe", "fixed 6 N")
MIXED_CELL = Cell(mixed=True)
QUICK_CELLS = [Cell(*each) for each in zip(DELAYS_S, FACES, (*STUCK, 0), strict=True)]
"""Of a short run: each delay, each face and each number of stuck units once."""


def cells(quick: bool) -> dict[str, Any]:
    """All figures: `delay`, `face`, `stuck`, each over all others, `mixed`, and `cells`."""
    every = [Cell(*each) for each in product(DELAYS_S, FACES, STUCK)]
    each, mixed = (EACH, MIXED) if not quick else (1, 1)
    chosen = QUICK_CELLS if quick else every
    bag = QUICK_BAG if quick else BAG
    tasks = [(cell, FIRST_SEED + 100 * k + i, name, bag)
             for k, cell in enumerate(chosen) for i in range(each) for name in NAMES]  # fmt: skip
    tasks += [(MIXED_CELL, FIRST_SEED + 100 * len(every) + i, name, bag)
              for i in range(mixed) for name in NAMES]  # fmt: skip
    return figures(trials(tasks))


def trials(tasks: list[tuple[Cell, int, str, int]]) -> list[dict[str, Any]]:
    """What trials come to, in their order."""
    return in_parallel(_one, tasks, chunk=3)


def figures(found: list[dict[str, Any]]) -> dict[str, Any]:
    """Rows by cell, and over all cells of a delay, a face, a number of stuck units."""
    plain = [one for one in found if not one["cell"].mixed]
    cut = [one for one in found if one["cell"].mixed]
    return {
        "first_seed": FIRST_SEED,
        "cells": _rows(plain, lambda cell: f"{_ms(cell)}, {cell.face}, {cell.stuck} stuck"),
        "delay": _rows(plain, _ms),
        "face": _rows(plain, lambda cell: cell.face),
        "stuck": _rows(plain, lambda cell: str(cell.stuck)),
        "mixed": _rows(cut, lambda _: "mixed").get("mixed", {}),
    }


def _ms(cell: Cell) -> str:
    return f"{1e3 * (cell.delay_s or 0.0):.0f} ms"


def _rows(found: list[dict[str, Any]], key: Any) -> dict[str, dict[str, Any]]:
    groups: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for one in found:
        groups.setdefault(key(one["cell"]), {}).setdefault(one["name"], []).append(one)
    return {name: {way: row(some) for way, some in ways.items()} for name, ways in groups.items()}


def _one(task: tuple[Cell, int, str, int]) -> dict[str, Any]:
    cell, seed, name, bag = task
    parameters = GripParameters(probe=False) if name == "no probe" else None
    fixed_n = FIXED_N if name.startswith("fixed") else None
    trial = run_trial(seed, cell, parameters=parameters, fixed_n=fixed_n, bag=bag)
    return {"cell": cell, "seed": seed, "name": name, **score(trial)}


def score(trial: Trial) -> dict[str, Any]:
    """Figures of a trial."""
    clock_s = np.array(trial.time_s) - trial.lifted_s
    grip, drag = np.array(trial.grip_n), np.array(trial.drag_n)
    offset = np.array(trial.offset_mm)
    friction = trial.thing.body.friction
    out: dict[str, Any] = {
        "dropped": trial.dropped, "when": _when(trial, clock_s, offset),
        "friction": friction, "weight_n": 9.81 * trial.thing.body.mass_kg,
        "face": trial.thing.body.face, "delay_s": trial.thing.servo.delay_s,
        "reactions_s": _reactions(trial, clock_s),
    }  # fmt: skip
    rest = (clock_s > REST_END_S - LOOK_S) & (clock_s < REST_END_S)
    hangs = (clock_s >= 0.0) & (clock_s < REST_END_S)
    if hangs.any():
        out["slid_mm"] = float(offset[hangs].max() - offset[hangs][0])
    pulled = (clock_s > REST_END_S) & (clock_s < PULLED_S)
    if trial.dropped or not (rest.any() and pulled.any()):
        return out
    margin = friction * grip / np.maximum(drag, 1e-9) - 1.0
    since = clock_s > REST_END_S - LOOK_S
    peak = np.flatnonzero(pulled)[np.argmax(drag[pulled])]
    felt, shear = np.array(trial.felt_n)[rest], np.array(trial.felt_drag_n)[rest]
    out |= {"margin_rest": float(np.median(margin[rest])), "margin_peak": float(margin[peak]),
            "margin_median": float(np.median(margin[since]))}  # fmt: skip
    if np.isfinite(felt).all():
        out["felt_over_true"] = float(np.median(felt / grip[rest]))
        out["shear_over_true"] = float(np.median(shear / drag[rest]))
    return out


def _when(trial: Trial, clock_s: np.ndarray, offset: np.ndarray) -> str:
    """In which phase it was dropped."""
    if not trial.dropped:
        return "held"
    if not np.isfinite(trial.lifted_s):
        return "lift"
    at_s = float(clock_s[np.argmax(offset > 1e3 * DROPPED_M)])
    ends = (("lift", 0.0), ("rest", REST_END_S), ("pulls", PULLED_S + LOOK_S))
    for name, end_s in ends:
        if at_s < end_s:
            return name
    return "let go" if at_s > trial.thing.let_go_s else "later"


def _reactions(trial: Trial, clock_s: np.ndarray) -> list[float]:
    """Times from when half of the load slides to a rise of the command, second."""
    slides, wanted = np.array(trial.slid) >= HALF, np.array(trial.wanted_n)
    period_s = trial.time_s[1] - trial.time_s[0]
    quiet, late = round(QUIET_S / period_s), round(LATEST_S / period_s)
    found = []
    for i in np.flatnonzero(slides).tolist():
        if not clock_s[i] > REST_END_S or slides[max(i - quiet, 0) : i].any():
            continue
        risen = np.flatnonzero(wanted[i : i + late] > (1.0 + RISEN) * wanted[i - 1])
        found.append(float(risen[0]) * period_s if risen.size else LATEST_S)
    return found


def row(found: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Figures over trials."""
    some = list(found)
    dropped = [one for one in some if one["dropped"]]
    slid = [one["slid_mm"] for one in some if "slid_mm" in one]
    times = [t for one in some for t in one["reactions_s"]]
    whens = [one["when"] for one in dropped]
    return {
        "runs": len(some),
        "dropped": rate(len(dropped), len(some)),
        "dropped_when": {when: whens.count(when) for when in sorted(set(whens))},
        **{name: _median(some, name) for name in (
            "margin_rest", "margin_peak", "margin_median", "felt_over_true", "shear_over_true")},
        "slid_mm_p90": float(np.quantile(slid, 0.9)) if slid else None,
        "slid_mm_max": max(slid, default=None),
        "reaction_ms_median": 1e3 * float(np.median(times)) if times else None,
        "reactions": len(times),
    }  # fmt: skip


def _median(found: list[dict[str, Any]], name: str) -> float | None:
    values = [one[name] for one in found if name in one]
    return float(np.median(values)) if values else None


def lines(figures: dict[str, Any]) -> list[str]:
    """The figures for a person."""
    heads = ("dropped", "margin rest", "peak", "median", "slid p90", "max", "felt/true", "reaction")
    out = [f"{'brushes: things, grippers':<34}{'':<12}{heads[0]:>24}"
           + "".join(f"{head:>12}" for head in heads[1:])]  # fmt: skip
    groups = {f"delay {name}": ways for name, ways in figures["delay"].items()}
    groups |= {f"face {name}": ways for name, ways in figures["face"].items()}
    groups |= {f"{name} stuck units": ways for name, ways in figures["stuck"].items()}
    groups |= {"mixed": figures["mixed"], **figures["cells"]}
    for name, ways in groups.items():
        for way, one in ways.items():
            each = one["dropped"]
            share = f"{each['rate']:.1%} ({each['lower']:.1%}-{each['upper']:.1%})"
            cells = [_shown(one[key], scale, unit) for key, scale, unit in (
                ("margin_rest", 1.0, ""), ("margin_peak", 1.0, ""), ("margin_median", 1.0, ""),
                ("slid_mm_p90", 1.0, " mm"), ("slid_mm_max", 1.0, " mm"),
                ("felt_over_true", 1.0, ""), ("reaction_ms_median", 1.0, " ms"),
            )]  # fmt: skip
            out.append(f"{name:<34}{way:<12}{share:>24}" + "".join(f"{cell:>12}" for cell in cells))
    return out


def _shown(value: float | None, scale: float, unit: str) -> str:
    return "-" if value is None else f"{scale * value:.2f}{unit}"
