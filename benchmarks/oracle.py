"""The model of a unit, written out once more: in numbers of 40 digits, and in those of 64 bits.

It shares nothing with the decoder but the parameters of the topology and the bounds that the
decoder's documentation states. `judge` has 40 digits and takes its time; `walk` has long doubles
(19 digits on x86-64) and goes through whole domains to find where judging is worth it.

Every unit is as warm as its gel says, film included: the first cycle after a start.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from skin.decode.model import field_angle_ends
from topology import THETA_KNOTS, Topology

DIGITS = 40
CURRENT_MIN, GAIN_MIN, FIELD_MIN = 1e-6, 0.1, 1e-6
"""Least current over that at 20 °C, gain, and lateral field in µT that has a direction."""
DEPTH_MIN, DEPTH_MAX = -0.5, 4.0
"""mm: bounds of H in R(psi, H)."""
OCTAVES_MAX = 24


class Numbers(NamedTuple):
    """A kind of numbers: how to make them, and what to do with them."""

    of: Callable[[Any], np.ndarray]
    log: Callable[[Any], Any]
    exp: Callable[[Any], Any]
    asin: Callable[[Any], Any]
    atan2: Callable[[Any, Any], Any]
    sin: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]
    pi: Any


def _long_doubles() -> Numbers:
    real = np.longdouble
    pi = 4 * np.arctan(real(1))
    return Numbers(lambda x: np.asarray(x, real), np.log, np.exp, np.arcsin, np.arctan2, np.sin,
                   np.cos, np.sqrt, pi)  # fmt: skip


def _many_digits() -> Numbers:
    try:
        from mpmath import mp
    except ImportError as error:
        raise SystemExit(
            "benchmarks: must have mpmath; not installed: pip install 'f3t-skin[test]'"
        ) from error
    each = {name: np.frompyfunc(getattr(mp, name), 1, 1)
            for name in ("log", "exp", "asin", "sin", "cos", "sqrt")}  # fmt: skip
    return Numbers(
        of=np.frompyfunc(lambda x: mp.mpf(float(x)), 1, 1),
        atan2=np.frompyfunc(mp.atan2, 2, 1),
        pi=mp.pi(),
        **each,
    )


def judge(skin: Topology, counts: np.ndarray, units: np.ndarray, estimator: str) -> np.ndarray:
    """Forces and temperatures of some units by the model in 40 digits, rounded to long doubles.

    Parameters
    ----------
    skin : Topology
    counts : ndarray, shape (c, m), int16
        Of the units named.
    units : ndarray, shape (m,), int
    estimator : "sine" or "field-angle"

    Returns
    -------
    ndarray, shape (4, m), longdouble
        Newton, unit frames; °C.
    """
    from mpmath import mp

    with mp.workdps(DIGITS):
        told = _model(skin, counts, units, estimator, _many_digits())
        return np.array([[np.longdouble(mp.nstr(x, 25)) for x in row] for row in told])


def walk(
    skin: Topology,
    counts: np.ndarray,
    units: np.ndarray,
    estimator: str,
) -> np.ndarray:
    """The same in long doubles."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return _model(skin, counts, units, estimator, _long_doubles())


def _model(
    skin: Topology,
    counts: np.ndarray,
    units: np.ndarray,
    estimator: str,
    m: Numbers,
) -> np.ndarray:
    p = {name: m.of(values[..., units]) for name, values in skin.parameters.items()}
    scale, offset = m.of(skin.scale[:, units]), m.of(skin.offset[:, units])
    current, frequency, bx, by, bz, chip = scale * m.of(counts) + offset
    warm = np.maximum(current / p["gel_current_20c_ua"], m.of(CURRENT_MIN))
    x = m.log(warm) / m.log(p["gel_current_ratio"])
    gel_c = 20 + 60 * x + (p["gel_bend_c"] + p["gel_twist_c"] * (2 * x - 1)) * x * (x - 1)

    drop = p["frequency_rest_hz"] - frequency
    over = np.maximum(drop - p["normal_break_hz"], 0)
    normal = p["normal_soft_n_per_hz"] * drop
    normal = normal + (p["normal_stiff_n_per_hz"] - p["normal_soft_n_per_hz"]) * over
    normal = normal + p["normal_cubic_n_per_hz3"] * over * over * over
    depth = drop / p["frequency_slope_hz_per_mm"]

    above = chip - p["hall_reference_c"]
    field = [
        b - p[f"hall_offset_{axis}_ut"] - p[f"hall_drift_{axis}_ut_per_k"] * above
        for b, axis in ((bx, "x"), (by, "y"), (bz, "z"))
    ]
    x = p["field_xx"] * field[0] + p["field_xy"] * field[1]
    y = p["field_yx"] * field[0] + p["field_yy"] * field[1]
    strength = np.maximum(m.sqrt(x * x + y * y), m.of(FIELD_MIN))
    if estimator == "sine":
        radius = _by_strength(p, strength, depth, gel_c, above, m)
    else:
        end = m.of(_angle_ends(skin)[units])
        radius = _by_angle(p, np.minimum(m.atan2(strength, field[2]), end), depth, m)
    return np.stack([*_shear(p, x / strength, y / strength, radius, depth, m), normal, gel_c])


@functools.lru_cache(maxsize=2)
def _angle_ends(skin: Topology) -> np.ndarray:
    return field_angle_ends(skin)[0]


def _by_strength(p, strength, depth, film_c, above, m: Numbers):
    """R = asin(S / M0) / k, eq. 1 of the paper."""
    deeper = depth - p["field_reference_mm"]
    growth = (p["field_growth_per_mm2"] * deeper + p["field_growth_per_mm"]) * deeper
    octaves = (m.log(p["field_amplitude_ut"]) + growth) / m.log(m.of(2.0))
    octaves = np.minimum(np.maximum(octaves, -OCTAVES_MAX), OCTAVES_MAX)
    film = 1 + p["film_drift_per_k"] * (film_c - p["film_reference_c"])
    chip = 1 + p["hall_gain_per_k"] * above
    gain = np.maximum(film, m.of(GAIN_MIN)) * np.maximum(chip, m.of(GAIN_MIN))
    crest = gain * m.exp(octaves * m.log(m.of(2.0)))
    return m.asin(np.minimum(strength / crest, m.of(1.0))) / p["field_wavenumber_rad_per_mm"]


def _by_angle(p, psi, depth, m: Numbers):
    """R(psi, H), a polynomial odd in psi and cubic in H."""
    h = np.minimum(np.maximum(depth, m.of(DEPTH_MIN)), m.of(DEPTH_MAX))
    table = p["field_angle_mm"]
    return sum(table[4 * i + j] * psi ** (2 * i + 1) * h**j for i in range(4) for j in range(4))


def _shear(p, x, y, radius, depth, m: Numbers):
    """Components of the tangential force, of R in a direction."""
    knots = p["theta_correction_rad"]
    if (knots != 0).any():
        spacing = 2 * m.pi / THETA_KNOTS
        along = (m.atan2(y, x) + m.pi) / spacing
        knot = np.minimum(np.floor(along.astype(np.float64)).astype(int), THETA_KNOTS - 1)
        unit = np.arange(knot.size)
        low, high = knots[knot, unit], knots[(knot + 1) % THETA_KNOTS, unit]
        turn = low + (high - low) * (along - knot)
        c, s = m.cos(turn), m.sin(turn)
        x, y = x * c - y * s, x * s + y * c
    if (p["film_x_mm"] != 0).any() or (p["film_y_mm"] != 0).any():
        x, y = radius * x - p["film_x_mm"], radius * y - p["film_y_mm"]
        radius = m.sqrt(x * x + y * y)
        away = np.maximum(radius, m.of(FIELD_MIN))
        x, y = x / away, y / away
    beyond = np.maximum(radius - p["shear_break_mm"], 0)
    force = p["shear_soft_n_per_mm"] * radius + p["shear_stiff_n_per_mm"] * beyond
    force = force + p["shear_cubic_n_per_mm3"] * beyond * beyond * beyond
    force = force * (1 + p["shear_gain_per_mm"] * (depth - p["field_reference_mm"]))
    return force * x, force * y
