"""Longest stable step of the engine, from stiffness over mass.

The forces of the skin are explicit: a body of mass m on springs k oscillates at ``w = sqrt(k /
m)``, and a step above ``2 / w`` is unstable. For many bodies w² is at most the sum, over both
bodies of a contact, of the largest ``sum_i k_i (1 / m + r_i² / I)`` [Gershgorin].
"""

from __future__ import annotations

import math

import numpy as np

from skin.errors import OptionError
from skin.grasp.inertia import rims
from skin.grasp.plant import Plant
from skin.grasp.touch import DEEPEST_M
from skin.physics.force_law import at, slope

__all__ = ["LONGEST_S", "longest_step_s", "split", "worst_touch"]

SHARE = 0.6
"""Step relative to ``2 / w``, reduced for viscosity [numeric: a pinched box diverges between 1.6
and 2.0, a ball between 2.5 and 3.2, since w is a bound]."""

LONGEST_S = 2e-3
"""Longest step, without contact: that of MuJoCo's own models."""


def longest_step_s(plant: Plant, touching: np.ndarray | None = None) -> float:
    """The longest stable step for the present contacts, second.

    Parameters
    ----------
    plant : Plant
    touching : ndarray, shape (n,), int32, optional
        Body in contact with each unit, -1 for none; the present ones if not given.
    """
    model, mounted = plant.model, plant.mounted
    other = plant.touch.body if touching is None else touching
    units = np.flatnonzero(other >= 0)
    limit_s = min(LONGEST_S, plant.timestep_s)
    if not units.size:
        return limit_s
    law = at(mounted.springs.normal, units)
    stiffness = 1e3 * np.maximum(slope(0.0, law), slope(1e3 * DEEPEST_M, law))
    on_link = np.zeros(model.nbody)
    on_other = np.zeros(model.nbody)
    for sums, bodies in ((on_link, mounted.body[units]), (on_other, other[units])):
        np.add.at(sums, bodies, stiffness * plant.yielding[bodies])
    square = float(on_link.max() + on_other.max())
    return limit_s if square <= 0.0 else min(limit_s, SHARE * 2.0 / math.sqrt(square))


def worst_touch(plant: Plant) -> np.ndarray:
    """Body in contact with each unit if all objects were grasped by as many units as possible: the
    two links that have most units within the size of the lightest object."""
    model, mounted = plant.model, plant.mounted
    touching = np.full(mounted.body.size, -1, np.int32)
    light = [b for b in plant.object_bodies if model.body_dofnum[b]]
    if not light:
        return touching
    body = min(light, key=lambda b: model.body_mass[b])
    reach_m = float(rims(model)[body]) + DEEPEST_M
    sets = []
    for link in np.unique(mounted.body):
        own = np.flatnonzero(mounted.body == link)
        place = mounted.place[:, own]
        away = np.linalg.norm(place[:, :, np.newaxis] - place[:, np.newaxis, :], axis=0)
        sets.append(own[away[np.argmax((away <= reach_m).sum(axis=1))] <= reach_m])
    for units in sorted(sets, key=len)[-2:]:
        touching[units] = body
    return touching


def split(plant: Plant, period_s: float, asked_s: float | None) -> int:
    """Number of steps in a period: the smallest, or by the user's step.

    Raises
    ------
    OptionError
        The user's step is too long, or not above 0.
    """
    longest_s = longest_step_s(plant)
    if asked_s is None:
        return max(1, math.ceil(period_s / longest_s * (1.0 - 1e-9)))
    if not 0.0 < asked_s <= longest_s * (1.0 + 1e-9):
        raise OptionError(
            f"step_s: must be above 0 and at most {longest_s:.2g} s, as stiffness over mass of "
            f"what touches asks; got {asked_s:g}: leave it out, and it is chosen"
        )
    return max(1, math.ceil(period_s / asked_s * (1.0 - 1e-9)))
