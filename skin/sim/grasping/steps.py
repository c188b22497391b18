"""Longest stable step of the engine, from stiffness over mass.

The forces of the skin are explicit: a body of mass m on springs k oscillates at ``w = sqrt(k /
m)``, and a step above ``2 / w`` is unstable. For many bodies w² is at most the sum, over both
bodies of a contact, of the largest ``sum_i k_i (1 / m + r_i² / I)`` [Gershgorin].
"""

from __future__ import annotations

import math

import numpy as np

from skin.physics.force_law import at, slope
from skin.sim.grasping.plant import Plant
from skin.sim.grasping.touch import DEEPEST_M

__all__ = ["split"]

SHARE = 0.6
"""Step relative to ``2 / w``, reduced for viscosity [numeric: a pinched box diverges between 1.6
and 2.0, a ball between 2.5 and 3.2, since w is a bound]."""

LONGEST_S = 2e-3
"""Longest step, without contact: that of MuJoCo's own models."""


def split(plant: Plant, period_s: float, longest_s: float | None = None) -> int:
    """Number of steps in a period: the smallest that is stable for the present contacts, and of
    steps that are no longer than `longest_s`."""
    step_s = min(LONGEST_S, plant.timestep_s, longest_s or LONGEST_S)
    units = np.flatnonzero(plant.touch.body >= 0)
    if units.size:
        law = at(plant.mounted.springs.normal, units)
        stiffness = 1e3 * np.maximum(slope(0.0, law), slope(1e3 * DEEPEST_M, law))
        square = 0.0
        for bodies in (plant.mounted.body[units], plant.touch.body[units]):
            sums = np.bincount(bodies, stiffness * _yielding(plant)[bodies])
            square += float(sums.max())
        if square > 0.0:
            step_s = min(step_s, SHARE * 2.0 / math.sqrt(square))
    return max(1, math.ceil(period_s / step_s * (1.0 - 1e-9)))


def _yielding(plant: Plant) -> np.ndarray:
    """Inverse mass of every body at its rim, shape (b,), 1/kg: at most the trace of its inverse
    inertia there."""
    model = plant.model
    middle, rotational = model.body_invweight0.T
    of_free = middle + rotational * plant.rim_m**2
    of_link = 3.0 * middle  # the mean over directions, of which one may have the whole sum
    return np.where(model.body_dofnum == 6, of_free, of_link)
