"""Viscoelasticity of an elastomer: relaxation in time, and rate-independent hysteresis.

Both stand between the force on a face and the force of the elastic law at its displacement: a unit
under a load has the displacement of ``prony.elastic(hysteresis.elastic(load), dt_s)``: it creeps,
and it lags. With all weights 0, or a width of 0, force and elastic force are equal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from topology import Topology

__all__ = ["Hysteresis", "Prony"]

SILICONE, SILICONE_S = (0.05, 0.05, 0.08), (0.05, 0.5, 10.0)
"""Weights and times, s, of a soft silicone [assumed]."""
OPERATORS = 5
"""Number of stops; more make loops smoother."""


class Prony:
    """Linear viscoelasticity: a generalised Maxwell model, exact for forces that change linearly.

    ``force = elastic + sum_j q_j`` and ``q_j' = weight_j * elastic' - q_j / time_j``: a sudden
    displacement needs ``1 + sum(weights)`` times the elastic force, which relaxes to it.

    Parameters
    ----------
    shape : tuple of int
        Shape of the forces, the unit axis last.
    weights : sequence of float, or ndarray, shape (j, ...)
        Of each term, at least 0. The default is a soft silicone's [assumed].
    times_s : sequence of float, or ndarray, shape (j, ...)
        As many relaxation times, more than 0.

    Attributes
    ----------
    terms : ndarray, shape (j, ...)
        The q_j, newton.

    Examples
    --------
    >>> prony = Prony((1,), weights=[0.5], times_s=[1.0])
    >>> prony.elastic(np.array([3.0]), 0.0)
    array([2.])
    >>> prony.elastic(np.array([3.0]), 100.0).round(2)
    array([3.])
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        weights: Sequence[float] | np.ndarray = SILICONE,
        times_s: Sequence[float] | np.ndarray = SILICONE_S,
    ) -> None:
        self.terms = np.zeros((len(weights), *shape))
        # common to all units, or per unit
        self._weights, self._times_s = (
            np.ascontiguousarray(np.broadcast_to(np.asarray(each, float).T, self.terms.T.shape).T)
            for each in (weights, times_s)
        )
        self._elastic = np.zeros(shape)
        self._dt_s, self._kept, self._gained = -1.0, self._weights, self._weights

    @classmethod
    def of(cls, topology: Topology, soft: bool) -> Prony | None:
        """For n units, shape (3, n), by their parameters; those without parameters are soft, or do
        not relax. None if no unit relaxes."""
        p, laws = topology.parameters, ("shear", "shear", "normal")
        weight = np.stack([p[f"{law}_creep_relative"] for law in laws], axis=1)
        time_s = np.stack([p[f"{law}_creep_s"] for law in laws], axis=1)
        own = weight.any(axis=(0, 1))
        if soft:
            weight[..., ~own] = np.reshape(SILICONE, (-1, 1, 1))
            time_s[..., ~own] = np.reshape(SILICONE_S, (-1, 1, 1))
        time_s[weight == 0.0] = 1.0
        return cls((3, topology.n), weight, time_s) if soft or own.any() else None

    def elastic(self, force: np.ndarray, dt_s: float) -> np.ndarray:
        """Advance by one step; returns the elastic force of the displacement under `force`."""
        self._adapt(dt_s)
        self.terms *= self._kept
        gain = self._gained.sum(axis=0)
        new = (force - self.terms.sum(axis=0) + gain * self._elastic) / (1.0 + gain)
        self.terms += self._gained * (new - self._elastic)
        self._elastic[...] = new
        return new

    def _adapt(self, dt_s: float) -> None:
        # differences of times differ in the last bit
        if math.isclose(dt_s, self._dt_s, rel_tol=1e-9):
            return
        lags = dt_s / self._times_s
        self._kept = np.exp(-lags)
        # the mean of exp over the step; 1 for a step of 0
        mean = np.where(lags > 0.0, -np.expm1(-lags) / np.where(lags > 0.0, lags, 1.0), 1.0)
        self._gained = self._weights * mean
        self._dt_s = dt_s


class Hysteresis:
    """Rate-independent loops: the stop operators of Prandtl and Ishlinskii.

    ``force = elastic + sum_j weight_j * e_j``: each e_j follows the elastic force, and stops at the
    ends of its range. One-sided ranges (pressing) leave no force after unloading; two-sided ones
    (dragging) are symmetric.

    Parameters
    ----------
    shape : tuple of int
        Shape of the forces, the unit axis last.
    width_n : float
        Width of the loop from 0 to `span_n` and back, halfway.
    span_n : float
        Loops over less than this are narrower.
    one_sided : bool
        For forces that are never below 0.

    Attributes
    ----------
    stops : ndarray, shape (j, ...)
        The e_j, newton.

    Examples
    --------
    >>> pressing = Hysteresis((1,), width_n=0.2, span_n=4.0)
    >>> [round(float(pressing.elastic(np.array([x]))[0]), 9) for x in (2.2, 4.2, 2.0, 0.0)]
    [2.0, 4.0, 2.0, 0.0]
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        *,
        width_n: float,
        span_n: float,
        one_sided: bool = True,
    ) -> None:
        ranges = 0.5 * span_n * np.arange(1, OPERATORS + 1) / OPERATORS
        ranges = ranges.reshape(-1, *(1,) * len(shape))
        self._weights = width_n / (OPERATORS * ranges)
        self._low = np.zeros_like(ranges) if one_sided else -0.5 * ranges
        self._high = self._low + ranges
        self.stops = np.zeros((OPERATORS, *shape))
        self._elastic = np.zeros(shape)

    def elastic(self, force: np.ndarray) -> np.ndarray:
        """Advance; returns the elastic force of the displacement under `force`."""
        lacking = force - self._elastic - (self._weights * self.stops).sum(axis=0)
        sign = np.where(lacking >= 0.0, 1.0, -1.0)
        end, lacking = np.where(sign > 0.0, self._high, self._low), np.abs(lacking)
        for _ in range(OPERATORS + 1):  # linear from one stop to the next
            room = np.abs(end - self.stops)
            slope = 1.0 + (self._weights * (room > 0.0)).sum(axis=0)
            free = np.where(room > 0.0, room, np.inf).min(axis=0)
            step = np.minimum(lacking / slope, free)
            self._elastic += sign * step
            self.stops[...] = np.where(room <= step, end, self.stops + sign * step)
            lacking = np.where(step < free, 0.0, lacking - slope * step)
            if not lacking.any():
                break
        return self._elastic.copy()

    def lagging(self, force: np.ndarray) -> np.ndarray:
        """Advance; returns the force that reaches the displacement under `force` in first loading.

        A law measured during loading, as on a bench, holds for that force: it is `force` itself
        until the first unloading.
        """
        elastic = self.elastic(force)
        return elastic + (self._weights * np.clip(elastic, self._low, self._high)).sum(axis=0)
