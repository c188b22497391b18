"""What noise does to single units over their range, against the least that any decoder could do.

The bound is that of Cramér and Rao for an unbiased estimator of (dx, dy, H) from frequency and
field at their noise. It is taken from the exact forward model, magnet theory and capacitor, by
numeric differentiation: nothing of a decoder is in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.made import Made
from skin import Decoder
from skin.sim.unit import UnitSimulator
from topology import CHANNELS

FREQUENCY, BZ = CHANNELS.index("frequency"), CHANNELS.index("bz")
TIMES = 10
"""Poses of a unit and cell in a round."""
STEP_MM = 1e-3
"""Of the derivatives."""
ROOM_C = 25.0
COMPONENTS = ("dx", "dy", "H", "Fx", "Fy", "Fz")


@dataclass(frozen=True, eq=False)
class Cells:
    """Poses over the range of a unit: a grid of depths and displacements, h by r.

    Attributes
    ----------
    depth_mm : ndarray, shape (h,)
    reach_mm : ndarray, shape (r,)
    """

    depth_mm: np.ndarray
    reach_mm: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        return self.depth_mm.size, self.reach_mm.size

    def draw(self, times: int, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Poses of every cell in directions at random.

        Returns
        -------
        displacement_mm : ndarray, shape (h r times, 2, n)
        depth_mm : ndarray, shape (h r times, n)
        """
        depth, reach = (np.repeat(a.ravel(), times)[:, np.newaxis] for a in
                        np.meshgrid(self.depth_mm, self.reach_mm, indexing="ij"))  # fmt: skip
        around = np.random.default_rng(seed).uniform(-np.pi, np.pi, (depth.size, n))
        displacement = reach[:, np.newaxis] * np.stack([np.cos(around), np.sin(around)], axis=1)
        return displacement, np.broadcast_to(depth, around.shape).copy()

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Mean over times and units, shape (h, r, ...), of values of shape (h r times, ..., n)."""
        return self._apart(values).mean(axis=2)

    def _apart(self, values: np.ndarray) -> np.ndarray:
        return np.moveaxis(values, -1, 1).reshape(*self.shape, -1, *values.shape[1:-1])


@dataclass(frozen=True, eq=False)
class Found:
    """What was decoded over the cells, shape (h, r) each.

    Attributes
    ----------
    square : ndarray, shape (h, r, 6)
        Mean squared error of `COMPONENTS`, mm² and N².
    least : ndarray, shape (h, r, 3)
        The bound of the variance of dx, dy and H, mm².
    held : ndarray, shape (h, r, 6)
        Share of errors within one sigma.
    """

    square: np.ndarray
    least: np.ndarray
    held: np.ndarray

    @property
    def ratio(self) -> np.ndarray:
        """Error of the tangential displacement over its bound, shape (h, r)."""
        return np.sqrt(self.square[..., :2].sum(axis=-1) / self.least[..., :2].sum(axis=-1))

    @property
    def shift_mm(self) -> np.ndarray:
        """Root mean square of the error of the tangential displacement, shape (h, r)."""
        return np.sqrt(self.square[..., :2].sum(axis=-1))


def explore(skin: Made, cells: Cells, decoder: Decoder, rounds: int) -> Found:
    """Decode poses of every cell with noise, each unit alone; `TIMES` a unit and cell and round."""
    units = skin.simulator(noise=True, seed=1)
    square, held = [], []
    for seed in range(rounds):
        displacement, depth = cells.draw(TIMES, skin.true.n, seed)
        exact = units.quantities(depth, displacement, *3 * [np.full(depth.shape, ROOM_C)])
        if not seed:
            least = cells.mean(bound(units, displacement, depth))
        decoder.reset()
        reading = decoder(units.quantise(units.disturb(exact)))
        force = skin.force(displacement, depth)
        true = np.concatenate([displacement, depth[:, np.newaxis], force], axis=1)
        error = np.concatenate([reading.displacement_mm, reading.force], axis=1) - true
        square.append(cells.mean(error**2))
        sigma = np.concatenate([reading.displacement_sigma_mm, reading.force_sigma], axis=1)
        held.append(cells.mean((np.abs(error) <= sigma).astype(float)))
    return Found(np.mean(square, axis=0), least, np.mean(held, axis=0))


def bound(units: UnitSimulator, displacement_mm: np.ndarray, depth_mm: np.ndarray) -> np.ndarray:
    """Least variance of dx, dy and H, mm², shape (t, 3, n).

    Parameters
    ----------
    units : UnitSimulator
        The exact forward model, each unit alone.
    displacement_mm : ndarray, shape (t, 2, n)
    depth_mm : ndarray, shape (t, n)
    """
    p = units.topology.parameters
    sigma = np.stack([p["frequency_noise_hz"], *3 * [p["field_noise_ut"]]])
    room = np.full(depth_mm.shape, ROOM_C)
    place = np.concatenate([displacement_mm, depth_mm[:, np.newaxis]], axis=1)
    columns = []
    for axis in range(3):
        ends = []
        for way in (-1.0, 1.0):
            moved = place.copy()
            moved[:, axis] += way * STEP_MM
            ends.append(units.quantities(moved[:, 2], moved[:, :2], room)[:, FREQUENCY : BZ + 1])
        columns.append((ends[1] - ends[0]) / (2.0 * STEP_MM) / sigma)
    slopes = np.stack(columns, axis=2)  # (t, 4 measured, 3 wanted, n)
    information = np.einsum("tmin,tmjn->tnij", slopes, slopes)
    least = np.diagonal(np.linalg.inv(information), axis1=2, axis2=3)
    return least.transpose(0, 2, 1)
