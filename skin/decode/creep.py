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
from bus.compiled.intrinsics import assume_noalias
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
    """What does not change between cycles of the same length; components are those of all units
    along x, then along y, then along z.

    Attributes
    ----------
    weight, faded, gained, spread : ndarray, shape (j, 3 n)
        w_j; what fades of h_j in a step, what a change in it adds, and the variance of that.
    step_gain : ndarray, shape (3 n,)
        What a sudden change counts, 1 + sum of w_j m; so much more the noise of a reading does.
    left2 : ndarray, shape (3 n,)
        Variance of what the terms leave, over the square of the force that relaxes.
    wants : skin.decode.plan.Wants
    """

    weight: np.ndarray
    faded: np.ndarray
    gained: np.ndarray
    spread: np.ndarray
    step_gain: np.ndarray
    left2: np.ndarray
    wants: Wants


class CreepData(NamedTuple):
    """What changes between cycles.

    Attributes
    ----------
    elastic, total : ndarray, shape (RESULTS, n)
        Results with elastic forces; written: the same with those that are borne.
    last : ndarray, shape (3 n,)
        F_e of the cycle before; NaN of a unit that was never heard.
    h, h_variance : ndarray, shape (j, 3 n)
        What is left of the changes before, and its variance.
    force, over, variance, largest : ndarray, shape (3 n,)
        Scratch: F_e, what is borne beyond it, the variance of that, and the largest square of what
        relaxes.
    """

    elastic: np.ndarray
    total: np.ndarray
    last: np.ndarray
    h: np.ndarray
    h_variance: np.ndarray
    force: np.ndarray
    over: np.ndarray
    variance: np.ndarray
    largest: np.ndarray


def relax_python(model, data):
    """From elastic forces to those that are borne, with their sigma."""
    elastic, total, force = data.elastic, data.total, data.force
    units, normal = elastic.shape[1], elastic[FORCE + 2]
    for row in range(total.shape[0]):
        for i in range(units):
            total[row, i] = elastic[row, i]
    for axis in range(3):
        wanted, at = elastic[FORCE + axis], axis * units
        for i in range(units):
            # who has a normal force, and no other, is not touched
            idle = np.isnan(wanted[i]) and not np.isnan(normal[i])
            force[at + i] = 0.0 if idle else wanted[i]
    start(force, data.over, data.variance, data.largest)
    for j in range(CREEP_TERMS):
        remember(
            (model.weight[j], model.faded[j], model.gained[j], model.spread[j]),
            (data.last, data.h[j], data.h_variance[j]),
            force,
            (data.over, data.variance, data.largest),
        )
    for i in range(force.size):
        data.last[i] = force[i]
    for axis in range(3):
        add(total[FORCE + axis], data.over, axis * units)
        if model.wants.sigma is not None:
            sigma = total[SIGMA + FORCE + axis]
            widen(sigma, model, data.variance, data.largest, axis * units)
    turn(model, elastic, total)


@jitable
def start(force, over, variance, largest):
    """Before the first term."""
    assume_noalias()
    for i in range(force.size):
        over[i], variance[i], largest[i] = 0.0, 0.0, force[i] * force[i]


@jitable
def remember(term, memory, now, sums):
    """Go on with one term, and add what it bears.

    What fades is taken off: where that is little, 1 less it would be rounded.
    """
    assume_noalias()
    weight, faded, gained, spread = term
    last, h_of, variance_of = memory
    over, variance, largest = sums
    half, twelfth, two = weight.dtype.type(0.5), weight.dtype.type(1 / 12), weight.dtype.type(2.0)
    for i in range(over.size):
        force, was, f = now[i], last[i], faded[i]
        begins = was != was  # noqa: PLR0124
        step = force - was
        h = h_of[i] - f * h_of[i] + gained[i] * step
        v = variance_of[i] - f * (two - f) * variance_of[i] + spread[i] * (step * step)
        h = half * force if begins else h
        v = twelfth * (force * force) if begins else v
        h_of[i], variance_of[i] = h, v
        over[i] += weight[i] * h
        variance[i] += weight[i] * weight[i] * v
        square = h * h
        largest[i] = square if square > largest[i] else largest[i]


@jitable
def add(force, over, first):
    """Of the components from `first` on."""
    assume_noalias()
    for i in range(force.size):
        force[i] += over[first + i]


@jitable
def widen(sigma, model, variance, largest, first):
    """Noise counts more, and what is not known is added."""
    assume_noalias()
    step_gain, left2 = model.step_gain, model.left2
    for i in range(sigma.size):
        noise = step_gain[first + i] * sigma[i]
        more = variance[first + i] + left2[first + i] * largest[first + i]
        sigma[i] = np.sqrt(noise * noise + more)


@jitable
def turn(model, elastic, total):
    """Size and direction of the tangential force, and their sigma."""
    x, y, size = total[FORCE], total[FORCE + 1], total[TANGENTIAL]
    size_of(x, y, size)
    if model.wants.theta is not None:
        direct(x, y, size, total[THETA])
    if model.wants.sigma is not None:
        way = elastic[FORCE], elastic[FORCE + 1], elastic[SIGMA + TANGENTIAL]
        noise = elastic[SIGMA + FORCE], elastic[SIGMA + FORCE + 1], model.step_gain
        sigma_x, sigma_y = total[SIGMA + FORCE], total[SIGMA + FORCE + 1]
        along = total[SIGMA + TANGENTIAL]
        lengthwise(way, noise, (x, y, size), (sigma_x, sigma_y), along)
        across(sigma_x, sigma_y, along, size, total[SIGMA + THETA])


@jitable
def size_of(x, y, size):
    """Size of the tangential force."""
    assume_noalias()
    for i in range(size.size):
        size[i] = np.sqrt(x[i] * x[i] + y[i] * y[i])


@jitable
def direct(x, y, size, theta):
    """Its direction, which stays as it is where there is no force."""
    assume_noalias()
    feeble = size.dtype.type(FEEBLE_N)
    for i in range(size.size):
        found = atan2(y[i], x[i])
        theta[i] = found if size[i] > feeble else theta[i]


@jitable
def lengthwise(way, noise, force, sigma, along):
    """Sigma along the force: of noise, which is given along the elastic one, and of the rest."""
    assume_noalias()
    elastic_x, elastic_y, elastic_along = way
    noise_x, noise_y, step_gain = noise
    (x, y, size), (sigma_x, sigma_y) = force, sigma
    real = along.dtype.type
    feeble, zero, one = real(FEEBLE_N), real(0.0), real(1.0)
    for i in range(along.size):
        firm, noisier2 = max(size[i], feeble), step_gain[i] * step_gain[i]
        noise_x2 = noisier2 * (noise_x[i] * noise_x[i])
        noise_y2 = noisier2 * (noise_y[i] * noise_y[i])
        along2 = noisier2 * (elastic_along[i] * elastic_along[i])
        across2 = max(noise_x2 + noise_y2 - along2, zero)
        was = np.sqrt(elastic_x[i] * elastic_x[i] + elastic_y[i] * elastic_y[i])
        aligned = elastic_x[i] * x[i] + elastic_y[i] * y[i]
        aligned /= max(was, feeble) * firm
        share = x[i] / firm
        share *= share
        more_x2 = max(sigma_x[i] * sigma_x[i] - noise_x2, zero)
        more_y2 = max(sigma_y[i] * sigma_y[i] - noise_y2, zero)
        total = across2 + min(aligned * aligned, one) * (along2 - across2)
        along[i] = np.sqrt(total + share * more_x2 + (one - share) * more_y2)


@jitable
def across(sigma_x, sigma_y, along, size, theta_sigma):
    """Sigma of the direction: what the sigma along it leaves of that of both axes."""
    assume_noalias()
    real = along.dtype.type
    feeble, zero, most = real(FEEBLE_N), real(0.0), real(THETA_MOST_RAD)
    for i in range(along.size):
        rest = sigma_x[i] * sigma_x[i] + sigma_y[i] * sigma_y[i] - along[i] * along[i]
        theta_sigma[i] = min(np.sqrt(max(rest, zero)) / max(size[i], feeble), most)


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
        shape = (CREEP_TERMS, 3 * n)
        laws = ("shear", "shear", "normal")
        weight = np.hstack([p[f"{law}_creep_relative"] for law in laws])
        time_s = np.hstack([p[f"{law}_creep_s"] for law in laws])
        # a term without weight may have any time
        time_s = np.where(weight > 0.0, time_s, 1.0)
        self._periods = 1.0 / (topology.cycle_rate_hz * time_s)
        left = np.hstack([p[f"{law}_creep_sigma_relative"] for law in laws])
        faded, gained, spread, h, variance = zeros((5, *shape), real)
        step_gain, last, *scratch = zeros((6, 3 * n), real)
        self._model = CreepModel(
            weight.astype(real), faded, gained, spread, step_gain, np.square(left).astype(real),
            wants,
        )  # fmt: skip
        self._data = CreepData(
            elastic.values, self.total.values, last, h, variance, *scratch
        )  # fmt: skip
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
