"""The law between displacement and force: a line up to a knee, and a steeper one beyond.

Its form stands here, for numpy arrays and for kernels alike; decoder, contacts, calibration and
simulator call it (`skin.calibrate.hinge`, which searches for the knee, has its two ramps as
columns). A law is three numbers: the slope below the knee, the knee, and the slope beyond, or what
is added to the slope there. Compliances instead of stiffnesses make it a law from force to
displacement, and its inverse one from displacement to force.

None is clipped at zero: a pull continues the first line.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from bus.compiled.elementwise import above_zero, choose, lesser
from bus.compiled.jit import jitable

__all__ = [
    "force", "force_with_added", "inverse", "inverse_integral", "normal_fall", "normal_law",
    "normal_slope", "secant", "shear_law", "shear_slope", "slope", "stiffening",
]  # fmt: skip


@jitable(inline=True)
def force(x, below, knee, beyond):
    """Force at a displacement, of slopes below the knee and beyond."""
    return below * lesser(x, knee) + beyond * above_zero(x - knee)


@jitable(inline=True)
def force_with_added(x, below, knee, added):
    """`force`, of the slope below the knee and what is added to it beyond: one step less in a
    kernel, and another rounding."""
    return below * x + added * above_zero(x - knee)


@jitable(inline=True)
def slope(x, below, knee, beyond):
    """Derivative of `force`; at the knee that of the first line."""
    return choose(x > knee, beyond, below)


@jitable(inline=True)
def inverse(y, below, knee, beyond):
    """Displacement at a force: the inverse of `force`."""
    at_knee = below * knee
    return choose(y <= at_knee, y / below, knee + (y - at_knee) / beyond)


@jitable(inline=True)
def inverse_integral(y, below, knee, beyond):
    """Integral of `inverse` from 0 to a number that is not negative: of compliances, the energy at
    a displacement."""
    at_knee = below * knee
    if y <= at_knee:
        return 0.5 * y * y / below
    past = y - at_knee
    return 0.5 * at_knee * knee + knee * past + 0.5 * past * past / beyond


@jitable(inline=True)
def secant(square, below, knee, added):
    """Force over displacement at a vector of this squared length, and how much the slope along the
    vector is above that; across it the slope is the secant."""
    if square > knee * knee:
        steeper = added * knee / math.sqrt(square)
        return below + (added - steeper), steeper
    return below, 0.0


@jitable(inline=True)
def stiffening(depth_mm, gain_per_mm, reference_mm):
    """Factor of the tangential force at a depth (eq. 2)."""
    return 1.0 + gain_per_mm * (depth_mm - reference_mm)


def normal_law(p: Mapping[str, Any], fall_hz: np.ndarray) -> np.ndarray:
    """Normal force at a fall of the frequency (Fig. 3e).

    Parameters
    ----------
    p : mapping
        Parameters of `UnitModel`, numbers or arrays.
    fall_hz : ndarray
        Broadcast against them.

    Returns
    -------
    ndarray
        Newton.
    """
    return force(fall_hz, *_normal(p))


def normal_slope(p: Mapping[str, Any], fall_hz: np.ndarray) -> np.ndarray:
    """Derivative of `normal_law`, N/Hz."""
    return slope(fall_hz, *_normal(p))


def normal_fall(p: Mapping[str, Any], normal_n: np.ndarray) -> np.ndarray:
    """Fall of the frequency under a normal force, Hz: the inverse of `normal_law`."""
    return inverse(normal_n, *_normal(p))


def shear_law(p: Mapping[str, Any], displacement_mm: np.ndarray) -> np.ndarray:
    """Tangential force at a displacement and the reference depth, N; `p` as of `normal_law`."""
    return force_with_added(displacement_mm, *_shear(p))


def shear_slope(p: Mapping[str, Any], displacement_mm: np.ndarray) -> np.ndarray:
    """Derivative of `shear_law`, N/mm."""
    below, knee, added = _shear(p)
    return slope(displacement_mm, below, knee, below + added)


def _normal(p: Mapping[str, Any]) -> tuple[Any, Any, Any]:
    return p["normal_soft_n_per_hz"], p["normal_break_hz"], p["normal_stiff_n_per_hz"]


def _shear(p: Mapping[str, Any]) -> tuple[Any, Any, Any]:
    return p["shear_soft_n_per_mm"], p["shear_break_mm"], p["shear_stiff_n_per_mm"]
