"""The law of the gel: its temperature is a polynomial in the logarithm of its current.

``T = 20 + 60 x + b x (x - 1) + c x (x - 1) (2 x - 1)`` in °C, with ``x = ln(I / I20) / ln(ratio)``,
`b` and `c` are `gel_bend_c` and `gel_twist_c`: they do not change 20 and 80 °C, which are given by
`gel_current_20c_ua` and `gel_current_ratio`. Without them the current is exponential.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

__all__ = ["gel_ends", "gel_octaves", "gel_share", "gel_slope", "gel_temperature"]

STEPS = 12
"""Newton iterations, or bisections where Newton fails."""
FARTHEST = 20.0
"""Of x: 1200 K from 20 °C."""

Parameters = Mapping[str, Any]


def _powers(p: Parameters) -> list[np.ndarray]:
    """Coefficients of x, x² and x³ in T - 20."""
    bend, twist = np.asarray(p["gel_bend_c"], float), np.asarray(p["gel_twist_c"], float)
    return [60.0 - bend + twist, bend - 3.0 * twist, 2.0 * twist]


def gel_octaves(p: Parameters) -> np.ndarray:
    """Coefficients of the first three powers of ``log2(I / I20)`` in T - 20, shape (3, n), °C."""
    octave = np.log(2.0) / np.log(p["gel_current_ratio"])
    return np.stack([factor * octave ** (k + 1) for k, factor in enumerate(_powers(p))])


def gel_temperature(p: Parameters, share: np.ndarray) -> np.ndarray:
    """Temperature at a current over that at 20 °C, °C.

    Parameters
    ----------
    p : mapping of str to ndarray, shape (n,)
        Parameters of n units, or of one.
    share : ndarray, shape (..., n)
        Above 0.
    """
    x = np.log(share) / np.log(p["gel_current_ratio"])
    first, second, third = _powers(p)
    return 20.0 + x * (first + x * (second + x * third))


def gel_slope(p: Parameters, share: np.ndarray) -> np.ndarray:
    """Derivative of the temperature by the natural logarithm of the current, °C; as above."""
    rate = np.log(p["gel_current_ratio"])
    x = np.log(share) / rate
    first, second, third = _powers(p)
    return (first + x * (2.0 * second + 3.0 * x * third)) / rate


def gel_share(p: Parameters, temperature: np.ndarray) -> np.ndarray:
    """Current over that at 20 °C: the inverse of `gel_temperature` where it is monotonic; beyond,
    the value at the end.

    Parameters
    ----------
    p : mapping of str to ndarray, shape (n,)
    temperature : ndarray, shape (..., n)
    """
    rate = np.log(p["gel_current_ratio"]) / 60.0
    above = np.asarray(temperature, float) - 20.0
    first, second, third = _powers(p)
    if not (second.any() or third.any()):
        return np.exp(rate * above)
    low, high = (np.broadcast_to(end, above.shape).copy() for end in gel_ends(p))
    x = np.clip(above / 60.0, low, high)
    for _ in range(STEPS):
        miss = x * (first + x * (second + x * third)) - above
        slope = first + x * (2.0 * second + 3.0 * x * third)
        low, high = np.where(miss < 0.0, x, low), np.where(miss > 0.0, x, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            there = x - miss / slope
        x = np.where((there >= low) & (there <= high), there, 0.5 * (low + high))
    return np.exp(rate * 60.0 * x)


def gel_ends(p: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Ends of x within which the temperature rises with it, about x = 1/2."""
    first, second, third = _powers(p)
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(second**2 - 3.0 * first * third)
        # in the form with a limit where the cubic term vanishes
        ends = [first / -(second + root), first / (root - second)]
    low, high = np.full((2, *first.shape), FARTHEST) * np.array([-1.0, 1.0]).reshape(
        2, *(1 for _ in first.shape)
    )
    for end in ends:
        known = np.isfinite(end)
        low = np.where(known & (end < 0.5), np.maximum(low, end), low)
        high = np.where(known & (end >= 0.5), np.minimum(high, end), high)
    return low, high
