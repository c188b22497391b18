"""Path of a contact: waypoints of its centre."""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.model import WAYPOINTS
from skin.contact.record import BORN

__all__ = ["walk"]

STEP_SIGMAS = 3.0
STEP_M = 2e-4
"""Smallest movement of the centre between waypoints, in its sigmas, and in metres [assumed]."""


@jitable
def walk(record, step_variance, path):
    """Store the centre as a waypoint if it has moved.

    `step_variance` is that of noise alone, m², over all axes: the unknown place of load on the
    faces is the same before and after a step.
    """
    centre, waypoint = record["centroid"], record["waypoint"]
    if record["event"] & BORN:
        record["waypoints"] = 0
        record["travel"] = 0.0
    if not np.isfinite(centre[0]):
        return
    if record["waypoints"] == 0:
        for a in range(3):
            record["origin"][a] = centre[a]
    else:
        square = 0.0
        for a in range(3):
            square += (centre[a] - waypoint[a]) ** 2
        if square <= max(STEP_M**2, STEP_SIGMAS**2 * step_variance):
            return
        record["travel"] += np.sqrt(square)
    for a in range(3):
        waypoint[a] = centre[a]
        path[record["waypoints"] % WAYPOINTS, a] = centre[a]
    record["waypoints"] += 1
