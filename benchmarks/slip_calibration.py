"""Whether a slip detector's probability is one, and whether its grip force would have held.

The truth of the probability is that 2 % of the load have slipped. That of the force is the least
load that bears the tangential force and torsion of the moment by the mean friction of faces in
motion, all faces alike: ``hypot(shear, torsion / arm) / friction``, from the true forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.slip_intervals import rate
from benchmarks.slip_play import FIRST, Trial, skin_of
from benchmarks.slip_scoring import FRICTION_S, Outcome
from benchmarks.slip_watch import Watched
from skin.contact.slip import SlipSettings

__all__ = ["Gripped", "Told", "grip_figures", "gripped", "needed_n", "reliability", "told"]

BINS = 10
WITHIN = 1.0
"""Sigmas: 68 % of the errors are within if they are right."""


class Told(NamedTuple):
    """Sums over the cycles of trials in which there is a probability, each of shape (bins,).

    Attributes
    ----------
    cycles, probability, slips, square : ndarray
        Cycles; sum of what is said, of what is true, and of the square of their difference.
    """

    cycles: np.ndarray
    probability: np.ndarray
    slips: np.ndarray
    square: np.ndarray


def told(trial: Trial, watched: Watched) -> Told:
    """The sums of one trial."""
    said = watched.slip_probability
    known = np.isfinite(said)
    said, true = said[known], trial.share[known] >= FIRST
    at = np.clip((said * BINS).astype(int), 0, BINS - 1)
    values = (np.ones_like(said), said, true.astype(float), (said - true) ** 2)
    return Told(*(np.bincount(at, each, BINS) for each in values))


def reliability(parts: Sequence[Told]) -> dict[str, Any] | None:
    """Table and Brier score over all cycles; None where no probability was said.

    `skill` is one minus the score over that of who always says how often slip is there.
    """
    cycles, probability, slips, square = (np.sum(each, axis=0) for each in zip(*parts, strict=True))
    total = float(cycles.sum())
    if not total:
        return None
    brier, often = float(square.sum()) / total, float(slips.sum()) / total
    return {
        "brier": brier,
        "skill": 1.0 - brier / (often * (1.0 - often)) if 0.0 < often < 1.0 else None,
        "slips": often,
        "cycles": int(total),
        "table": [
            {"said": p / n, "true": s / n, "cycles": int(n)}
            for n, p, s in zip(cycles, probability, slips, strict=True)
            if n
        ],
    }


class Gripped(NamedTuple):
    """The grip force of one trial, less the safety that was asked for, against the needed one."""

    relative: float
    sigmas: float


def gripped(trial: Trial, watched: Watched, one: Outcome) -> Gripped:
    """The force that is said `FRICTION_S` after the alarm; NaN where none is."""
    if not np.isfinite(one.alarm_s) or trial.plan.kind != "slip":
        return Gripped(np.nan, np.nan)
    since_s = trial.time_s - trial.plan.begins_s
    at = min(int(np.searchsorted(since_s, one.alarm_s + FRICTION_S)), since_s.size - 1)
    safety = SlipSettings().safety
    said, sigma = watched.grip_force[at] / safety, watched.grip_force_sigma[at] / safety
    true = needed_n(trial, at)
    return Gripped(float(said / true - 1.0), float((said - true) / sigma))


def needed_n(trial: Trial, at: int) -> float:
    """The least load that would hold at a cycle, newton."""
    skin, force = skin_of(trial.plan.skin, trial.plan.pitch_m), trial.force[at]
    load = force[2]
    each = np.einsum("abn,bn->an", skin.rotation, force)
    normal = skin.rotation[:, 2] @ load
    normal /= np.linalg.norm(normal)
    centre = skin.position @ load / load.sum()
    away = skin.position - centre[:, np.newaxis]
    total = each.sum(axis=1)
    shear = np.linalg.norm(total - normal * (normal @ total))
    torsion = normal @ np.cross(away, each, axis=0).sum(axis=1)
    arm = float(np.linalg.norm(away, axis=0) @ load / load.sum())
    return float(np.hypot(shear, torsion / arm if arm else 0.0) / trial.plan.kinetic.mean())


def grip_figures(parts: Sequence[Gripped]) -> dict[str, Any]:
    """Errors of the force, and how often they are within sigma; None where nothing is said."""
    relative = np.array([one.relative for one in parts if np.isfinite(one.relative)])
    sigmas = np.array([one.sigmas for one in parts if np.isfinite(one.sigmas)])
    return {
        "error_median": float(np.median(np.abs(relative))) if relative.size else None,
        "bias_median": float(np.median(relative)) if relative.size else None,
        "known": relative.size,
        "coverage": rate(int((np.abs(sigmas) <= WITHIN).sum()), sigmas.size),
    }
