"""The units of one contact, gathered into rows.

Units of a contact are accessed in random order. Each is read once, into rows of float64 that are
padded with zeros to whole vectors: sums over the rows are vector loops then.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.slip.data import padded

__all__ = ["TOUCHED_ROWS", "Touched", "gather", "touched_rows"]

TOUCHED_ROWS = 24


class Touched(NamedTuple):
    """Rows of float64; (length,), or (3, length) of vectors in the skin frame."""

    position: np.ndarray  # m, about the middle of the array
    x: np.ndarray  # axes of the unit
    y: np.ndarray
    z: np.ndarray
    point: np.ndarray  # m, touched point: the position, and from there along z as deep as pressed
    force: np.ndarray  # N, along the axes of the unit
    variance: np.ndarray  # N², of `force`; see `add_common`
    area: np.ndarray  # m²
    warm_area: np.ndarray  # the same of units with a temperature, else 0
    warmth: np.ndarray  # degree Celsius, 0 without a temperature


@jitable(inline=True)
def touched_rows(b):
    """The rows of a block, shape (TOUCHED_ROWS, length), by name."""
    return Touched(
        b[0:3], b[3:6], b[6:9], b[9:12], b[12:15], b[15:18], b[18:21], b[21], b[22], b[23],
    )  # fmt: skip


@jitable(inline=True)
def gather(units, reading, poses, rows):
    """Gather units into the rows of a block; returns the padded length."""
    touched, given = touched_rows(rows), reading.given[0]
    has_depth, has_temperature = given["depth"], given["temperature"]
    for j in range(units.size):
        i = units[j]
        position, rotation, area = poses[i]["position"], poses[i]["rotation"], poses[i]["area"]
        depth = 1e-3 * reading.displacement[2, i] if has_depth else 0.0
        depth = depth if np.isfinite(depth) else 0.0
        warmth = np.float64(reading.temperature[i]) if has_temperature else np.nan
        is_warm = np.isfinite(warmth)
        for a in range(3):
            touched.position[a, j] = position[a]
            touched.x[a, j] = rotation[a, 0]
            touched.y[a, j] = rotation[a, 1]
            touched.z[a, j] = rotation[a, 2]
            touched.point[a, j] = position[a] + depth * rotation[a, 2]
            touched.force[a, j] = reading.force[a, i]
            touched.variance[a, j] = np.float64(reading.force_sigma[a, i]) ** 2
        touched.area[j] = area
        touched.warm_area[j] = area if is_warm else 0.0
        touched.warmth[j] = warmth if is_warm else 0.0
    return padded(units.size, rows)
