"""Relaxation: what displaced faces bear beyond their elastic force, from how they came there.

The elastic laws tell the force F_e of a displacement that is held. An elastomer bears more while it
is fresh, and less than that after it was let go (quasi-linear viscoelasticity, three Prony terms):

    F = F_e + sum_j w_j h_j,    h_j(t) = integral exp(-(t - s) / T_j) dF_e(s)

for each component of the force in the unit frame. In a step of dt over which F_e changes evenly,
``h_j = k h_j + m dF_e`` with ``k = exp(-dt / T_j)`` and ``m = (1 - k) T_j / dt``, exactly. When in
the step F_e changed is not known: at an even chance, ``exp(-s / T_j)`` has the mean m and the
variance ``(1 - k²) T_j / (2 dt) - m²``, which is kept beside each h_j and fades with it; it matters
after gaps. Of a unit whose first reading shows F_e0, all between "just now" and "long ago" is
equally likely: ``h_j = F_e0 / 2``, with the variance F_e0² / 12.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bus.compiled.aligned import zeros
from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import compiled, jitable
from skin.decode.functions import atan2
from skin.decode.records import tile_rows
from skin.decode.results import Results
from topology import CREEP_TERMS, Topology

__all__ = ["Creep", "relax", "relax_python"]

STEPS_A_PERIOD = 4
"""Times of steps are rounded to this share of a period and the rest is carried on, so that as a
rule the coefficients of the step before hold."""
FEEBLE_N = 1e-9
"""N: a force that has no direction."""
THETA_MOST_RAD = float(np.pi / np.sqrt(3.0))
"""Sigma of a direction that is not known: even over the circle."""


class Rows(NamedTuple):
    """First rows of results; -1 for those that are not there."""

    force: int
    tangential: int
    theta: int
    force_sigma: int
    tangential_sigma: int
    theta_sigma: int


class CreepModel(NamedTuple):
    """What does not change between cycles of the same length.

    Attributes
    ----------
    weight, kept, gained, spread : ndarray, shape (j, 3, n)
        w_j; k, m and the variance of a step.
    sharper : ndarray, shape (3, n)
        What a sudden change counts, 1 + sum of w_j m; so much more the noise of a reading does.
    left2 : ndarray, shape (3, n)
        Variance of what the terms leave, over the square of the force that relaxes.
    rows : Rows
    """

    weight: np.ndarray
    kept: np.ndarray
    gained: np.ndarray
    spread: np.ndarray
    sharper: np.ndarray
    left2: np.ndarray
    rows: Rows


class Memory(NamedTuple):
    """What a cycle leaves to the next.

    Attributes
    ----------
    elastic : ndarray, shape (3, n)
        F_e; NaN of a unit that was never heard.
    h, variance : ndarray, shape (j, 3, n)
    """

    elastic: np.ndarray
    h: np.ndarray
    variance: np.ndarray


class CreepData(NamedTuple):
    """What changes between cycles.

    Attributes
    ----------
    elastic, borne : ndarray, shape (1, r, n)
        Results with elastic forces; written: the same with those that are borne.
    before, now : Memory
        Of the cycle before; written: of this one.
    """

    elastic: np.ndarray
    borne: np.ndarray
    before: Memory
    now: Memory


def relax_python(model, data):
    """From elastic forces to those that are borne, with their sigma."""
    assume_noalias()
    elastic, borne, rows = data.elastic[0], data.borne[0], model.rows
    before, now, units = data.before, data.now, elastic.shape[1]
    for row in range(borne.shape[0]):
        for i in range(units):
            borne[row, i] = elastic[row, i]
    normal = rows.force + 2
    for axis in range(3):
        at, sigma_at = rows.force + axis, rows.force_sigma + axis
        for i in range(units):
            force = np.float64(elastic[at, i])
            # who has a normal force, and no other, is not touched
            force = 0.0 if np.isnan(force) and not np.isnan(elastic[normal, i]) else force
            was = before.elastic[axis, i]
            begins = np.isnan(was)
            step = 0.0 if begins else force - was
            over, variance, largest = 0.0, 0.0, force * force
            for j in range(CREEP_TERMS):
                kept, weight = model.kept[j, axis, i], model.weight[j, axis, i]
                h = kept * before.h[j, axis, i] + model.gained[j, axis, i] * step
                h = 0.5 * force if begins else h
                v = kept * kept * before.variance[j, axis, i]
                v += model.spread[j, axis, i] * step * step
                v = force * force / 12.0 if begins else v
                now.h[j, axis, i], now.variance[j, axis, i] = h, v
                over += weight * h
                variance += weight * weight * v
                largest = max(largest, h * h)
            now.elastic[axis, i] = force
            borne[at, i] += over
            if rows.force_sigma >= 0:
                noise = model.sharper[axis, i] * elastic[sigma_at, i]
                variance += model.left2[axis, i] * largest
                borne[sigma_at, i] = np.sqrt(noise * noise + variance)
    turn(model, elastic, borne)


@jitable
def turn(model, elastic, borne):
    """Size and direction of the tangential force, and their sigma."""
    rows, feeble = model.rows, borne.dtype.type(FEEBLE_N)
    x, y = rows.force, rows.force + 1
    sx, sy = rows.force_sigma, rows.force_sigma + 1
    for i in range(borne.shape[1]):
        size = np.sqrt(borne[x, i] ** 2 + borne[y, i] ** 2)
        borne[rows.tangential, i] = size
        firm = max(size, feeble)
        if rows.theta >= 0:
            theta = atan2(borne[y, i], borne[x, i])
            borne[rows.theta, i] = theta if size > feeble else elastic[rows.theta, i]
        if rows.force_sigma >= 0:
            # variances of noise along and across the elastic force, turned to the new direction
            noisier2 = model.sharper[0, i] ** 2
            sum2 = elastic[sx, i] ** 2 + elastic[sy, i] ** 2
            along2 = noisier2 * elastic[rows.tangential_sigma, i] ** 2
            across2 = max(noisier2 * sum2 - along2, 0.0)
            was = max(np.sqrt(elastic[x, i] ** 2 + elastic[y, i] ** 2), feeble)
            aligned = (elastic[x, i] * borne[x, i] + elastic[y, i] * borne[y, i]) / (was * firm)
            aligned2 = min(aligned * aligned, 1.0)
            share = borne[x, i] ** 2 / (firm * firm)
            more_x2 = max(borne[sx, i] ** 2 - noisier2 * elastic[sx, i] ** 2, 0.0)
            more_y2 = max(borne[sy, i] ** 2 - noisier2 * elastic[sy, i] ** 2, 0.0)
            along = across2 + aligned2 * (along2 - across2)
            along += share * more_x2 + (1.0 - share) * more_y2
            total = along2 + across2 + more_x2 + more_y2
            borne[rows.tangential_sigma, i] = np.sqrt(along)
            if rows.theta >= 0:
                across = np.sqrt(max(total - along, 0.0)) / firm
                borne[rows.theta_sigma, i] = min(across, THETA_MOST_RAD)


relax = compiled(relax_python, fastmath={"contract"})


class Creep:
    """Adds to the forces of a cycle what its displacements have not yet relaxed.

    Parameters
    ----------
    topology : Topology
    names : tuple of str
        Results in the order of the kernel's rows, "force" and "tangential" among them.
    elastic : Results
        What is decoded, of one cycle: written anew before each call.

    Attributes
    ----------
    borne : Results
        The same with the forces that are borne; flags are those of `elastic`.
    """

    def __init__(self, topology: Topology, names: tuple[str, ...], elastic: Results) -> None:
        p, n = topology.parameters, topology.n
        self.borne = Results(names, 1, n, elastic.values.dtype)
        self.borne.flags, self.borne.valid = elastic.flags, elastic.valid
        self.borne.arrays = self.borne.values, elastic.flags, elastic.valid
        shape = (CREEP_TERMS, 3, n)
        laws = ("shear", "shear", "normal")
        weight = np.stack([p[f"{law}_creep_relative"] for law in laws], axis=1)
        time_s = np.stack([p[f"{law}_creep_s"] for law in laws], axis=1)
        # a term without weight may have any time
        time_s = np.where(weight > 0.0, time_s, 1.0)
        self._periods = 1.0 / (topology.cycle_rate_hz * time_s)
        left = np.stack([p[f"{law}_creep_sigma_relative"] for law in laws])
        kept, gained, spread, h, variance = (zeros(shape, np.float64) for _ in range(5))
        self._model = CreepModel(
            np.ascontiguousarray(weight), kept, gained, spread, np.zeros((3, n)), left**2,
            _rows(names),
        )  # fmt: skip
        first = Memory(np.zeros((3, n)), h, variance)
        self._memories = first, Memory(*(array.copy() for array in first))
        self._elastic = elastic
        self._calls: list[Callable[[], object]] = []
        self.reset()

    def reset(self) -> None:
        """Forget the history: the next cycle is the first."""
        for memory in self._memories:
            memory.elastic[:] = np.nan
        self._last, self._missing = 0, 0.0
        self._stretch(1.0)

    def elapse(self, periods: float) -> None:
        """Say how many periods the next cycle is after the last one."""
        self._missing += periods - 1.0

    def warmup(self) -> None:
        """Compile what a cycle needs, or load it."""
        from bus.compiled.bound import Bound

        a, b = self._memories
        arrays = self._elastic.values, self.borne.values
        self._calls = [
            Bound(relax, self._model, CreepData(*arrays, *turns)) for turns in ((a, b), (b, a))
        ]  # fmt: skip

    def __call__(self, advance: bool) -> None:
        """Go on to the cycle that stands in `elastic`; without `advance`, to it once more."""
        if not self._calls:
            self.warmup()
        if advance:
            self._last = 1 - self._last
            steps = max(round((1.0 + self._missing) * STEPS_A_PERIOD) / STEPS_A_PERIOD, 0.0)
            self._missing += 1.0 - steps
            if steps != self._steps:
                self._stretch(steps)
        self._calls[self._last]()

    def batch(self, results: Results, advance: bool) -> None:
        """Do the same, in place, with consecutive cycles."""
        for t in range(len(results.values)):
            self._elastic.values[0] = results.values[t]
            self(advance)
            results.values[t] = self.borne.values[0]

    def _stretch(self, steps: float) -> None:
        """Coefficients of a step of so many periods."""
        model, lag = self._model, steps * self._periods
        model.kept[:] = np.exp(-lag)
        if steps > 0.0:
            model.gained[:] = -np.expm1(-lag) / lag
            # below 1e-3 the difference is lost in rounding, and lag² / 12
            square = -np.expm1(-2.0 * lag) / (2.0 * lag) - model.gained**2
            model.spread[:] = np.where(lag > 1e-3, square, lag**2 / 12.0)
        else:
            model.gained[:], model.spread[:] = 1.0, 0.0
        model.sharper[:] = 1.0 + (model.weight * model.gained).sum(axis=0)
        self._steps = steps


def _rows(names: tuple[str, ...]) -> Rows:
    """Where results stand."""
    first, row = {}, 0
    for name in names:
        first[name] = row
        row += len(tile_rows(name))
    return Rows(*(first.get(name, -1) for name in Rows._fields))
