"""The law between displacement and force: a line up to a knee, a steeper one beyond, and a cube.

    F(x) = soft x + stiffer r + cubic r³,  r = max(x - knee, 0)

Its form stands here, for numpy arrays and for kernels alike; decoder, contacts, calibration and
simulator call it. A law is a tuple of its terms, in the order of `TERMS`: numbers, or arrays that
broadcast against the displacement. Two lines are a law whose cube is 0; the cube is that of
Duffing's spring, which only stiffens: elastomers do, the more they are strained.

No force is clipped at zero: a pull continues the first line.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bus.compiled.intrinsics import above_zero, anywhere, choose, lesser
from bus.compiled.jit import jitable

__all__ = [
    "STIFFNESSES", "TERMS", "Law", "at", "energy", "force", "in_series", "inverse",
    "normal_law", "normal_law_mm", "rescaled", "scaled", "shear_law", "slope", "stacked",
    "stiffening",
]  # fmt: skip

TERMS = ("soft", "knee", "stiffer", "cubic")
"""N/mm up to the knee; mm; N/mm added beyond it; N/mm³ beyond it."""
STIFFNESSES = {
    "normal": ("normal_soft_n_per_hz", "normal_stiff_n_per_hz", "normal_cubic_n_per_hz3"),
    "shear": ("shear_soft_n_per_mm", "shear_stiff_n_per_mm", "shear_cubic_n_per_mm3"),
}
"""Parameters of `UnitModel` that grow as the force at every displacement does, by law."""
Law = tuple[Any, Any, Any, Any]
"""Terms of a law."""
NEWTON_STEPS = 14
"""Steps to the inverse of a law with a cube from above: each leaves at most 2/3 of the way, and
near the end less than its square. They begin at the lesser of two bounds: the inverse of the lines,
and what the mean of the line and the cube is at least, their geometric one; that is 23 times the
root where the inverse of the lines is a million times it [derived]."""
TINY = 1e-37
"""Keeps a divisor from zero where there is no cube [numeric: a normal number of float32]."""


@jitable
def at(laws, i):
    """The law of one unit, of an array of shape (terms, n)."""
    return laws[0, i], laws[1, i], laws[2, i], laws[3, i]


@jitable
def force(x, law):
    """Force at a displacement."""
    soft, knee, stiffer, cubic = law
    beyond = above_zero(x - knee)
    return soft * x + (stiffer + cubic * beyond * beyond) * beyond


@jitable
def slope(x, law):
    """Derivative of `force`; at the knee that of the first line."""
    soft, knee, stiffer, cubic = law
    beyond = x - knee
    return choose(beyond > 0.0, soft + stiffer + 3.0 * cubic * beyond * beyond, soft)


@jitable
def energy(x, law):
    """Integral of `force` from 0."""
    soft, knee, stiffer, cubic = law
    beyond2 = above_zero(x - knee) ** 2
    return 0.5 * soft * x * x + (0.5 * stiffer + 0.25 * cubic * beyond2) * beyond2


@jitable
def inverse(y, law):
    """Displacement at a force: the inverse of `force`."""
    soft, knee, stiffer, cubic = law
    at_knee = soft * knee
    beyond_n, steep = above_zero(y - at_knee), soft + stiffer
    beyond = beyond_n / steep
    if anywhere(cubic > 0.0):
        # from above: the force is convex, so that no step goes below the root
        beyond = lesser(beyond, np.sqrt(beyond_n / (2.0 * np.sqrt(steep * cubic) + TINY)))
        for _ in range(NEWTON_STEPS):
            square = cubic * beyond * beyond
            beyond = (2.0 * square * beyond + beyond_n) / (3.0 * square + steep)
    return lesser(y, at_knee) / soft + beyond


@jitable
def in_series(law, compliance):
    """The law from the force's displacement to that of a unit with a compliance in series, both of
    the same form: ``x + compliance F(x)``."""
    soft, knee, stiffer, cubic = law
    return 1.0 + compliance * soft, knee, compliance * stiffer, compliance * cubic


@jitable
def scaled(law, factor):
    """The law of forces that are so many times as large."""
    soft, knee, stiffer, cubic = law
    return factor * soft, knee, factor * stiffer, factor * cubic


@jitable
def stiffening(depth_mm, gain_per_mm, reference_mm):
    """Factor of the tangential force at a depth (eq. 2)."""
    return 1.0 + gain_per_mm * (depth_mm - reference_mm)


def rescaled(law: Law, per_x: Any) -> Law:
    """The law of a displacement of which one is so many of those that it is of."""
    soft, knee, stiffer, cubic = law
    return soft * per_x, knee * (1.0 / per_x), stiffer * per_x, cubic * per_x**3


def normal_law(p: Mapping[str, Any]) -> Law:
    """Law of the normal force by the fall of the frequency in Hz (Fig. 3e), of parameters of
    `UnitModel`, numbers or arrays."""
    soft = p["normal_soft_n_per_hz"]
    stiffer = p["normal_stiff_n_per_hz"] - soft
    return soft, p["normal_break_hz"], stiffer, p["normal_cubic_n_per_hz3"]


def normal_law_mm(p: Mapping[str, Any]) -> Law:
    """Law of the normal force by the depth in millimetre."""
    return rescaled(normal_law(p), p["frequency_slope_hz_per_mm"])


def shear_law(p: Mapping[str, Any]) -> Law:
    """Law of the tangential force by the displacement in millimetre, at the reference depth."""
    names = "shear_soft_n_per_mm", "shear_break_mm", "shear_stiff_n_per_mm", "shear_cubic_n_per_mm3"
    soft, knee, stiffer, cubic = (p[name] for name in names)
    return soft, knee, stiffer, cubic


def stacked(law: Law) -> np.ndarray:
    """The laws of n units as an array, shape (terms, n), as `at` takes them."""
    return np.stack(np.broadcast_arrays(*law))
