"""Relaxation: what displaced faces bear beyond their elastic force, from how they came there.

An elastomer bears more while it is fresh than its elastic law F_e says, and less after it was let
go: ``F = F_e + sum_j w_j h_j``, each component of the force for itself, where h_j is what is left
of all changes of F_e, fading with T_j. `docs/explanation/derivations.md`, "Relaxation", has a
step's coefficients, and the variance of what is not known: when in the step F_e changed, and what
was before the first reading.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.aligned import zeros
from bus.compiled.jit import compiled, jitable
from skin.decode.arrays import Results
from skin.decode.functions import atan2
from skin.decode.plan import Wants
from skin.decode.records import FORCE, SIGMA, TANGENTIAL, THETA
from topology import CREEP_TERMS, Topology

__all__ = ["Creep", "relax", "relax_python"]

STEPS_A_PERIOD = 4
"""Steps are rounded to this fraction of a period [assumed]."""
FEEBLE_N = 1e-9
"""N: a force that has no direction."""
THETA_MOST_RAD = float(np.pi / np.sqrt(3.0))
"""Sigma of a direction that is not known: even over the circle."""


class CreepModel(NamedTuple):
    """What does not change between cycles of the same length: of j terms, of the three components
    of each unit."""

    weight: np.ndarray  # (j, 3, n), w_j
    faded: np.ndarray  # (j, 3, n), what fades of h_j in a step,
    gained: np.ndarray  # what a change in it adds,
    spread: np.ndarray  # and the variance of that
    step_gain: np.ndarray  # (3, n), of a sudden change: 1 + sum of w_j m; as much of the noise
    left2: np.ndarray  # (3, n), variance of what the terms leave, over the square of what relaxes
    wants: Wants


class CreepData(NamedTuple):
    """What changes between cycles."""

    elastic: np.ndarray  # (RESULTS, n), results with elastic forces
    total: np.ndarray  # written: the same with those that are borne
    last: np.ndarray  # (3, n), F_e of the cycle before; NaN of a unit that was never heard
    h: np.ndarray  # (j, 3, n), what is left of the changes before,
    h_variance: np.ndarray  # and its variance


@jitable
def remember(model, data, axis, i, force):
    """Go on with the terms of one component; returns what is borne beyond the elastic force, and
    its variance.

    What fades is taken off: where that is little, 1 less it would be rounded.
    """
    real, was = type(force), data.last[axis, i]
    begins, step = np.isnan(was), force - was
    over, variance, largest = real(0.0), real(0.0), force * force
    for j in range(CREEP_TERMS):
        weight, faded = model.weight[j, axis, i], model.faded[j, axis, i]
        h, v = data.h[j, axis, i], data.h_variance[j, axis, i]
        h += model.gained[j, axis, i] * step - faded * h
        v += model.spread[j, axis, i] * (step * step) - faded * (real(2.0) - faded) * v
        h = real(0.5) * force if begins else h
        v = real(1 / 12) * (force * force) if begins else v
        data.h[j, axis, i], data.h_variance[j, axis, i] = h, v
        over += weight * h
        variance += weight * weight * v
        largest = max(largest, h * h)
    data.last[axis, i] = force
    return over, variance + model.left2[axis, i] * largest


@jitable
def turn(model, elastic, total, i):
    """Size and direction of the tangential force of a unit, and their sigma: along the force of
    noise, which is given along the elastic one, and of the rest; of the direction what that leaves
    of both axes."""
    x, y = total[FORCE, i], total[FORCE + 1, i]
    real = type(x)
    feeble, zero, one = real(FEEBLE_N), real(0.0), real(1.0)
    size = np.sqrt(x * x + y * y)
    total[TANGENTIAL, i] = size
    if model.wants.theta is not None and size > feeble:
        total[THETA, i] = atan2(y, x)
    if model.wants.sigma is not None:
        was_x, was_y, firm = elastic[FORCE, i], elastic[FORCE + 1, i], max(size, feeble)
        noise_x = model.step_gain[0, i] * elastic[SIGMA + FORCE, i]
        noise_y = model.step_gain[1, i] * elastic[SIGMA + FORCE + 1, i]
        along = model.step_gain[0, i] * elastic[SIGMA + TANGENTIAL, i]
        noise_x2, noise_y2, along2 = noise_x * noise_x, noise_y * noise_y, along * along
        across2 = max(noise_x2 + noise_y2 - along2, zero)
        was = np.sqrt(was_x * was_x + was_y * was_y)
        aligned = (was_x * x + was_y * y) / (max(was, feeble) * firm)
        share = (x / firm) * (x / firm)
        x2, y2 = total[SIGMA + FORCE, i] ** 2, total[SIGMA + FORCE + 1, i] ** 2
        along2 = across2 + min(aligned * aligned, one) * (along2 - across2)
        along2 += share * max(x2 - noise_x2, zero) + (one - share) * max(y2 - noise_y2, zero)
        total[SIGMA + TANGENTIAL, i] = np.sqrt(along2)
        turned = np.sqrt(max(x2 + y2 - along2, zero)) / firm
        total[SIGMA + THETA, i] = min(turned, real(THETA_MOST_RAD))


def relax_python(model, data):
    """From elastic forces to those that are borne, with their sigma."""
    elastic, total = data.elastic, data.total
    real = data.last.dtype.type
    for row in range(total.shape[0]):
        for i in range(total.shape[1]):
            total[row, i] = elastic[row, i]
    for i in range(total.shape[1]):
        for axis in range(3):
            force = elastic[FORCE + axis, i]
            # who has a normal force, and no other, is not touched
            idle = np.isnan(force) and not np.isnan(elastic[FORCE + 2, i])
            over, variance = remember(model, data, axis, i, real(0.0) if idle else force)
            total[FORCE + axis, i] += over
            if model.wants.sigma is not None:
                noise = model.step_gain[axis, i] * total[SIGMA + FORCE + axis, i]
                total[SIGMA + FORCE + axis, i] = np.sqrt(noise * noise + variance)
        turn(model, elastic, total, i)


relax = compiled(relax_python, fastmath={"contract"}, allocates=False)


class Creep:
    """Adds to the forces of a cycle what its displacements have not yet relaxed.

    Parameters
    ----------
    topology : Topology
    wants : skin.decode.plan.Wants
    elastic : Results
        What is decoded, of one cycle: written before each call.

    Attributes
    ----------
    total : Results
        The same with the forces that are borne; flags are those of `elastic`.
    call : tuple
        The kernel with its arguments.
    steps : float
        Periods that a call goes on by.
    """

    def __init__(self, topology: Topology, wants: Wants, elastic: Results) -> None:
        p, n, real = topology.parameters, topology.n, elastic.values.dtype
        self.total = Results(n, real)
        self.total.flags, self.total.valid = elastic.flags, elastic.valid
        self.total.arrays = self.total.values, elastic.flags, elastic.valid
        laws = ("shear", "shear", "normal")
        weight = np.stack([p[f"{law}_creep_relative"] for law in laws], axis=1)
        time_s = np.stack([p[f"{law}_creep_s"] for law in laws], axis=1)
        # a term without weight may have any time
        time_s = np.where(weight > 0.0, time_s, 1.0)
        self._periods = 1.0 / (topology.cycle_rate_hz * time_s)
        left = np.stack([p[f"{law}_creep_sigma_relative"] for law in laws])
        faded, gained, spread, h, variance = zeros((5, CREEP_TERMS, 3, n), real)
        step_gain, last = zeros((2, 3, n), real)
        self._model = CreepModel(
            weight.astype(real), faded, gained, spread, step_gain, np.square(left).astype(real),
            wants,
        )  # fmt: skip
        self._data = CreepData(elastic.values, self.total.values, last, h, variance)
        self.call = relax, self._model, self._data
        self.steps = 0.0
        self.reset()

    def reset(self) -> None:
        """Forget the history: the next cycle is the first."""
        self._data.last[:] = np.nan
        self._missing = 0.0
        self.stretch(1.0)

    def go_on(self, periods: float) -> None:
        """Let the next cycle come so many periods after the last one, rounded to a part of a
        period, so that the coefficients of the step before usually apply; the rest is kept."""
        missing = self._missing + periods - 1.0
        steps = max(round((1.0 + missing) * STEPS_A_PERIOD) / STEPS_A_PERIOD, 0.0)
        self._missing = missing + 1.0 - steps
        self.stretch(steps)

    def stretch(self, steps: float) -> None:
        """Let the next call go on by so many periods."""
        if steps == self.steps:
            return
        model, lag = self._model, steps * self._periods
        gained, square = np.ones_like(lag), np.ones_like(lag)
        if steps > 0.0:
            gained, square = -np.expm1(-lag) / lag, -np.expm1(-2.0 * lag) / (2.0 * lag)
        model.faded[:], model.gained[:] = -np.expm1(-lag), gained
        # near 0 the difference is lost in rounding, and lag² / 12
        model.spread[:] = np.where(lag > 1e-3, square - gained**2, lag**2 / 12.0)
        model.step_gain[:] = 1.0 + (model.weight * model.gained).sum(axis=0)
        self.steps = steps
