"""Inverse masses of bodies at their rims, for the choice of time steps."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["rims", "yielding"]


def yielding(model: Any) -> np.ndarray:
    """Inverse mass of every body at its rim, shape (b,), 1/kg: at most the trace of its inverse
    inertia there."""
    middle, rotational = model.body_invweight0.T
    of_free = middle + rotational * rims(model) ** 2
    of_link = 3.0 * middle  # the mean over directions, of which one may have the whole sum
    return np.where(model.body_dofnum == 6, of_free, of_link)


def rims(model: Any) -> np.ndarray:
    """Radius of a ball about the centre of mass that contains the body's geoms, shape (b,), m."""
    radius = np.zeros(model.nbody)
    for g in range(model.ngeom):
        if model.geom_rbound[g] > 0.0:
            body = model.geom_bodyid[g]
            off = np.linalg.norm(model.geom_pos[g] - model.body_ipos[body])
            radius[body] = max(radius[body], off + model.geom_rbound[g])
    return radius
