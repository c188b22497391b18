"""How long a step of the engine may be, from stiffness over mass.

The forces of the skin are explicit: a body of mass m on springs k oscillates at ``w = sqrt(k /
m)``, and a step above ``2 / w`` lets that grow without bound. Of many bodies w² is at most the
sum, over both bodies of a contact, of the largest ``sum_i k_i (1 / m + r_i² / I)`` [Gershgorin].
"""

from __future__ import annotations

import math

import numpy as np

from skin.errors import OptionError
from skin.sim.engine.inertia import rims
from skin.sim.engine.plant import Plant
from skin.sim.engine.touch import DEEPEST_M

__all__ = ["LONGEST_S", "longest_step_s", "split", "worst_touch"]

SHARE = 0.6
"""Of ``2 / w`` that a step may be: loss takes its part [numeric: a pinched box explodes between 1.6
and 2.0, a ball between 2.5 and 3.2, as w is a bound]."""

LONGEST_S = 2e-3
"""Of a step, where nothing touches: what MuJoCo's own models take."""


def longest_step_s(plant: Plant, touching: np.ndarray | None = None) -> float:
    """The longest step at which the contacts that there are cannot explode, second.

    Parameters
    ----------
    plant : Plant
    touching : ndarray, shape (n,), int32, optional
        Body that touches each unit, -1 for none; as it is now if not given.
    """
    model, mounted = plant.model, plant.mounted
    other = plant.touch.body if touching is None else touching
    units = np.flatnonzero(other >= 0)
    limit_s = min(LONGEST_S, plant.timestep_s)
    if not units.size:
        return limit_s
    stiffness = 1e3 / np.min(mounted.springs.normal[:2, units], axis=0)
    on_link = np.zeros(model.nbody)
    on_other = np.zeros(model.nbody)
    for sums, bodies in ((on_link, mounted.body[units]), (on_other, other[units])):
        np.add.at(sums, bodies, stiffness * plant.yielding[bodies])
    square = float(on_link.max() + on_other.max())
    return limit_s if square <= 0.0 else min(limit_s, SHARE * 2.0 / math.sqrt(square))


def worst_touch(plant: Plant) -> np.ndarray:
    """Which body each unit would touch if all objects were grasped by all units that can at once:
    the two links that have most of them within the size of the lightest object."""
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
    """Into how many steps a period is to be split: as few as can be, or as the user asks.

    Raises
    ------
    OptionError
        A step is asked for that is too long, or not above 0.
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
