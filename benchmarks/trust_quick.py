"""The plant of `benchmarks.trust_plant`, one instant at a time, compiled: for closed loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchmarks.trust_film import field_of
from benchmarks.trust_plant import Plant, Touch
from benchmarks.trust_skin import Skin
from bus.compiled.jit import compiled

__all__ = ["QuickPlant"]

FARTHEST_MM = 36.0
HEIGHT_MM = (1.0, 5.0)
STEP_MM = (0.25, 0.125)
"""[numeric] Of distances from the axis, and of heights: error below 0.1 % of the field at rest."""


class Pairs(NamedTuple):
    """Films that move, and chips that feel it: chip, film, place of the chip from the film at rest,
    turn into the chip's axes, field at rest, shapes (p,), (3, p) and (3, 3, p)."""

    chip: np.ndarray
    film: np.ndarray
    between: np.ndarray
    turn: np.ndarray
    resting: np.ndarray


class QuickPlant(Plant):
    """The units of a skin, whose film field is interpolated in a table."""

    def __init__(self, skin: Skin) -> None:
        vars(self).update(vars(skin.plant))
        kept = np.flatnonzero(self._near | (self._at == self._by))
        self._moving = Pairs(
            self._at[kept], self._by[kept], self._between[:, kept].copy(),
            (self._turn * self.strength[self._by])[:, :, kept].copy(),
            self._resting[:, kept].copy(),
        )  # fmt: skip
        r = np.arange(0.0, FARTHEST_MM + 1e-9, STEP_MM[0])
        z = np.arange(*HEIGHT_MM, STEP_MM[1])
        at_r, at_z = np.meshgrid(r, z, indexing="ij")
        points = np.stack([at_r.ravel(), np.zeros(at_r.size), at_z.ravel()])
        seen = field_of(self.film, points)[[0, 2]]
        self._table = np.ascontiguousarray(seen.reshape(2, r.size, z.size))

    def film_field(self, touch: Touch) -> np.ndarray:
        """See `Plant`; of few instants, table by table."""
        out = np.repeat(self._rest[np.newaxis], len(touch.depth_mm), axis=0)
        for k, field in enumerate(out):
            moved = np.concatenate([touch.moved_mm[k], touch.depth_mm[k, np.newaxis]])
            add_moved(self._moving, self._table, moved, field)
        return out


def add_moved_python(pairs: Pairs, table: np.ndarray, moved: np.ndarray, out: np.ndarray) -> None:
    """Add to the field `out` (3, n) what films change that have moved by (3, n): cubic convolution
    in a table of the radial and axial field [Keys, 1981]."""
    weight = np.empty((2, 4))
    last = np.array([table.shape[1] - 3, table.shape[2] - 3])
    for p in range(pairs.chip.size):
        film = pairs.film[p]
        if moved[0, film] == 0.0 and moved[1, film] == 0.0 and moved[2, film] == 0.0:
            continue
        x = pairs.between[0, p] - moved[0, film]
        y = pairs.between[1, p] - moved[1, film]
        r = np.sqrt(x * x + y * y)
        at_r = r / STEP_MM[0]
        at_z = (pairs.between[2, p] - moved[2, film] - HEIGHT_MM[0]) / STEP_MM[1]
        i = min(max(int(at_r), 1), last[0])
        j = min(max(int(at_z), 1), last[1])
        for axis in range(2):
            t = at_r - i if axis == 0 else at_z - j
            weight[axis, 0] = 0.5 * t * (-1.0 + t * (2.0 - t))
            weight[axis, 1] = 1.0 + 0.5 * t * t * (-5.0 + 3.0 * t)
            weight[axis, 2] = 0.5 * t * (1.0 + t * (4.0 - 3.0 * t))
            weight[axis, 3] = 0.5 * t * t * (t - 1.0)
        radial, axial = 0.0, 0.0
        for a in range(4):
            for b in range(4):
                both = weight[0, a] * weight[1, b]
                # the radial field is odd in r: its extrapolation at the axis is a small error
                radial += both * table[0, i - 1 + a, j - 1 + b]
                axial += both * table[1, i - 1 + a, j - 1 + b]
        share = radial / r if r > 1e-9 else 0.0
        seen_x, seen_y = share * x, share * y
        chip = pairs.chip[p]
        for c in range(3):
            seen = (pairs.turn[c, 0, p] * seen_x + pairs.turn[c, 1, p] * seen_y
                    + pairs.turn[c, 2, p] * axial)  # fmt: skip
            out[c, chip] += seen - pairs.resting[c, p]


add_moved = compiled(add_moved_python, fastmath={"contract"})
