"""The film of a unit: displacement from the angle of its field, direction, centre and strength.

R = P(psi, H), psi = atan2(M_r, Bz). P is odd in psi to the seventh power and cubic in H: 16
coefficients, ``field_angle_mm`` of a unit, in rad and mm. Entry [i, j] belongs to
``psi**(2 i + 1) * H**j``.

A film off the chip's axis looks like an offset of the lateral field that grows as the film nears
the chip: no offset undoes it, but a shift of the displacement does, and a tilt is a little of both.
2x2 map, offset, centre and R(psi, H) are therefore fitted together, and to the displacement, not
to the field: each sample weighs as much as its displacement is worth. What the model cannot follow
of a film is the same in all readings of a pose, and no noise: it is reported as a variance of its
own over the range.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares, nnls, root_scalar

from skin.calibrate.fit import Fit, check_levels, check_samples, fit_law

__all__ = ["ANGLE_NAMES", "FilmFit", "angle_powers", "displaced", "fit_crest", "fit_film",
           "map_field", "misfit_sigma"]  # fmt: skip

ANGLE_TERMS, DEPTH_TERMS = 4, 4
"""Powers 1, 3, 5, 7 of the angle; powers 0 to 3 of the depth [paper]."""
ANGLE_NAMES = tuple(f"field_angle_mm[{i}]" for i in range(ANGLE_TERMS * DEPTH_TERMS))
PLACED = ("hall_offset_x_ut", "hall_offset_y_ut", "film_x_mm", "film_y_mm")
NAMES = ("field_xx", "field_xy", "field_yx", "field_yy", *PLACED, *ANGLE_NAMES)
MAP_BY = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 1.0, -1.0], [-1.0, 0.0, 0.0]])
"""d (xx, xy, yx, yy) / d (stretch, skew, turn): the determinant is 1 to second order."""
CURVED, TABLE = 5, 7
"""Parameters that the displacement is not linear in, stretch, skew and turn of the map and the
offset; with the centre, those before the polynomial's coefficients."""
FREE = np.array([0.2, 0.2, 0.5, 1000.0, 1000.0, 1.0, 1.0, *[10.0] * len(ANGLE_NAMES)])
"""One sigma of what is known of each beforehand: far more than a scan leaves [assumed]."""
ROUNDS = 3
"""Fits with the spread that the one before has left."""
CREST = {"field_wavenumber_rad_per_mm": (0.63, 0.2), "field_growth_per_mm": (0.7, 0.5),
         "field_growth_per_mm2": (0.0, 0.2)}  # fmt: skip
"""Mean and sigma of the sine law before a scan [assumed: films of 8 to 14 mm wavelength]."""


@dataclass(frozen=True, eq=False)
class FilmFit:
    """Lateral field of a unit to its displacement.

    Attributes
    ----------
    fit : Fit
        ``field_xx`` to ``field_yy`` (determinant 1 to second order), ``hall_offset_x_ut``,
        ``hall_offset_y_ut``, ``film_x_mm``, ``film_y_mm``, ``field_angle_mm[0]`` to ``[15]``.
    spread_mm : float
        What is left beyond the noise, one sigma of a component: the film is not as the model is.
    sigma_mm : float
        That and the covariance of the fit, root mean square over the scan.
    shape : ndarray, shape (6,)
        `field_angle_variance_relative`.
    """

    fit: Fit
    spread_mm: float
    sigma_mm: float
    shape: np.ndarray


def fit_film(
    field_ut: np.ndarray,
    depth_mm: np.ndarray,
    displacement_mm: np.ndarray,
    direction_rad: np.ndarray,
    *,
    offset_ut: tuple[float, float, float] = (0.0, 0.0, 0.0),
    sigma_ut: float = 105.0,
) -> FilmFit:
    """Fit map, offset, centre and field-angle polynomial to strokes over depth and direction.

    Parameters
    ----------
    field_ut : ndarray, shape (t, 3)
        As the chip reports it, without neighbours.
    depth_mm, displacement_mm, direction_rad : ndarray, shape (t,)
        As commanded.
    offset_ut : tuple of 3 floats
        Of the chip without a film: that of Bz is taken, the others are a start.
    sigma_ut : float
        One-sigma noise of each axis, after averaging.

    Raises
    ------
    ScanError
        Too few samples, depths, displacements or directions, or a value that is not finite.
    """
    check_samples(
        len(NAMES), field_ut=field_ut, depth_mm=depth_mm, displacement_mm=displacement_mm,
        direction_rad=direction_rad,
    )  # fmt: skip
    along = np.stack([np.cos(direction_rad), np.sin(direction_rad)])
    check_levels("direction_rad", np.arctan2(along[1], along[0]), 4, 0.2)
    field = (np.asarray(field_ut, float) - offset_ut).T
    # the model gives the displacement along and across the commanded direction
    wanted = np.concatenate([displacement_mm, np.zeros_like(displacement_mm)])
    # along a known direction, the noise of the lateral field gives its angle no bias
    powers = angle_powers(np.arctan2(np.sum(along * field[:2], axis=0), field[2]), depth_mm)
    found, scan = np.zeros(len(FREE)), (field, depth_mm, along)
    found[TABLE:] = np.linalg.lstsq(powers, displacement_mm, rcond=None)[0]
    spread_mm, noise = 0.0, np.ones_like(wanted)
    weight, residual = noise, wanted
    for _ in range(ROUNDS):
        noise = sigma_ut * _noise_mm(found, *scan)
        weight = 1.0 / np.hypot(noise, spread_mm)
        found = _solved(scan, found, wanted, weight)
        residual = wanted - _rows(found, *scan) @ found[CURVED:]
        spread_mm = _spread(residual, noise, residual.size - found.size)
    slopes = _slopes(found, scan)
    scaled = slopes * weight[:, np.newaxis]
    chi2 = max(float(np.sum((residual * weight) ** 2)) / (residual.size - found.size), 1.0)
    covariance = chi2 * np.linalg.inv(scaled.T @ scaled + np.diag(1.0 / FREE**2))
    own2 = float(np.einsum("tp,pq,tq->t", slopes, covariance, slopes).mean())
    sigma2 = spread_mm**2 + own2
    both = residual.reshape(2, -1) ** 2, noise.reshape(2, -1)
    variance = _variance(*both, depth_mm, displacement_mm, sigma2)
    variance[0] += own2
    values, jacobian = np.append(_map(*found[:3]), found[3:]), np.eye(len(NAMES), found.size, -1)
    jacobian[:4, :3] = MAP_BY
    values[4:6] += offset_ut[:2]
    fit = Fit(NAMES, values, jacobian @ covariance @ jacobian.T, np.zeros(len(NAMES)))
    flat = np.append(1.0, np.zeros(len(variance) - 1))
    return FilmFit(fit, spread_mm, sigma2**0.5, variance / max(sigma2, 1e-12) - flat)


def _solved(
    scan: tuple[np.ndarray, ...], start: np.ndarray, wanted: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """Least squares of the film's parameters, which are known beforehand as far as `FREE` says."""
    prior = np.diag(1.0 / FREE)

    def missed(at: np.ndarray) -> np.ndarray:
        off = _rows(at, *scan) @ at[CURVED:] - wanted
        return np.append(off * weight, prior @ (at - start))

    def slopes(at: np.ndarray) -> np.ndarray:
        return np.concatenate([_slopes(at, scan) * weight[:, np.newaxis], prior])

    solve: Any = least_squares  # its stubs know no derivatives that are given
    return solve(missed, start, slopes, method="lm", x_scale="jac").x


def _spread(residual: np.ndarray, noise: np.ndarray, freedom: int) -> float:
    """Spread in addition to the noise with which chi-squared of the residuals is their number."""

    def excess(spread: float) -> float:
        return float(np.sum(residual**2 / (noise**2 + spread**2)) - freedom)

    if excess(0.0) <= 0.0:
        return 0.0
    return root_scalar(excess, bracket=(0.0, 2.0 * float(np.abs(residual).max()))).root


def _map(stretch: float, skew: float, turn: float) -> np.ndarray:
    return np.array([[1.0 + stretch, skew + turn], [skew - turn, 1.0 - stretch]])


def _rows(at: np.ndarray, field: np.ndarray, depth: np.ndarray, along: np.ndarray) -> np.ndarray:
    """What centre and table, which the displacement is linear in, make of it along and across, at
    a map and an offset; shape (2 t, p - 5)."""
    lateral = _map(*at[:3]) @ (field[:2] - at[3:CURVED, np.newaxis])
    size = np.maximum(np.hypot(*lateral), 1e-9)
    powers = angle_powers(np.arctan2(size, field[2]), depth)
    turned = np.stack([along, np.stack([-along[1], along[0]])])
    direction = np.einsum("ait,it->at", turned, lateral / size)
    rows = [-turned.transpose(0, 2, 1), direction[:, :, np.newaxis] * powers]
    return np.concatenate(rows, axis=2).reshape(2 * len(depth), -1)


def _slopes(at: np.ndarray, scan: tuple[np.ndarray, ...]) -> np.ndarray:
    """Derivatives of what `_rows` predicts, shape (2 t, p)."""
    rows, linear = _rows(at, *scan), at[CURVED:]
    steps = 1e-6 * np.diag(FREE)[:CURVED]
    curved = [(_rows(at + step, *scan) - rows) @ linear / step.sum() for step in steps]
    return np.column_stack([*curved, rows])


def displaced(film: Fit, field_ut: np.ndarray, depth_mm: np.ndarray) -> np.ndarray:
    """Tangential displacement by a film's fit, mm, shape (2, t); of a field, shape (t, 3), whose
    Bz has no offset."""
    lateral = map_field(field_ut, film)
    size = np.maximum(np.hypot(*lateral), 1e-9)
    table = np.array([film[name] for name in ANGLE_NAMES])
    over = angle_powers(np.arctan2(size, field_ut[:, 2]), depth_mm) @ table / size
    return lateral * over - np.array([[film["film_x_mm"]], [film["film_y_mm"]]])


def map_field(field_ut: np.ndarray, film: Fit) -> np.ndarray:
    """Lateral field without offset, and mapped, as `fit_film` has both.

    Parameters
    ----------
    field_ut : ndarray, shape (t, 3)

    Returns
    -------
    ndarray, shape (2, t)
    """
    x, y = (field_ut[:, i] - film[f"hall_offset_{axis}_ut"] for i, axis in enumerate("xy"))
    return np.stack([film[f"field_{row}x"] * x + film[f"field_{row}y"] * y for row in "xy"])


def _variance(
    residual2: np.ndarray,
    noise: np.ndarray,
    depth: np.ndarray,
    displacement: np.ndarray,
    sigma2: float,
) -> np.ndarray:
    """Variance across the displacement without its noise, ``sum c[2 i + j] R^(3 i) H^(2 j)``, mm²,
    shape (6,), of squared residuals along and across, shape (2, t)."""
    terms = np.stack(
        [displacement ** (3 * i) * depth ** (2 * j) for i in range(3) for j in range(2)]
    )
    # the film's errors are such of its field: along, they count as much less as its noise does
    ratio2 = np.stack([(noise[0] / noise[1]) ** 2, np.ones_like(noise[1])])
    weight = 1.0 / (noise**2 + sigma2)
    matrix = (terms[:, np.newaxis] * ratio2 * weight).reshape(len(terms), -1)
    size = np.linalg.norm(matrix, axis=1)
    found, _ = nnls((matrix / size[:, np.newaxis]).T, ((residual2 - noise**2) * weight).ravel())
    return found / size


def _noise_mm(
    at: np.ndarray, field: np.ndarray, depth: np.ndarray, along: np.ndarray
) -> np.ndarray:
    """Noise of the displacement along and across for 1 µT of each axis, shape (2 t,)."""
    lateral = _map(*at[:3]) @ (field[:2] - at[3:5, np.newaxis])
    forward = np.abs(np.sum(along * lateral, axis=0))
    angle = np.arctan2(forward, field[2])
    ends = (angle_powers(angle + step, depth) for step in (1e-4, -1e-4))
    radial = np.abs(np.subtract(*ends) @ at[TABLE:] / 2e-4) / np.hypot(forward, field[2])
    # across: R / M_r, which at no displacement is what it is along
    small = forward < 1e-3 * np.abs(field[2])
    across = np.abs(angle_powers(angle, depth) @ at[TABLE:]) / np.where(small, 1.0, forward)
    return np.maximum(np.concatenate([radial, np.where(small, radial, across)]), 1e-9)


def angle_powers(angle: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """``psi**(2 i + 1) * H**j``, shape (t, 16): R is their product with the coefficients."""
    odd = angle[:, np.newaxis] ** (2 * np.arange(ANGLE_TERMS) + 1)
    even = np.vander(depth, DEPTH_TERMS, increasing=True)
    return (odd[:, :, np.newaxis] * even[:, np.newaxis]).reshape(len(angle), -1)


# -- the sine law ---------------------------------------------------------------------------------


def fit_crest(
    lateral_ut: np.ndarray, depth_mm: np.ndarray, displacement_mm: np.ndarray, reference_mm: float,
    sigma_ut: float,
) -> Fit:  # fmt: skip
    """k and M0(H) of M_r = M0(H) sin(k R), which the sine estimator needs, before the crest.

    Parameters
    ----------
    lateral_ut : ndarray, shape (t,)
        Lateral field along the displacement, at the reference temperatures.
    depth_mm, displacement_mm : ndarray, shape (t,)
    reference_mm : float
        Depth at which the amplitude is given.
    sigma_ut : float
        One-sigma noise of the field.

    Returns
    -------
    Fit
        ``field_wavenumber_rad_per_mm``, ``field_growth_per_mm``, ``field_growth_per_mm2`` and
        ``field_amplitude_ut``.

    Raises
    ------
    ScanError
        Too few samples, depths or displacements, or a value that is not finite.
    """
    check_samples(4, lateral_ut=lateral_ut, depth_mm=depth_mm, displacement_mm=displacement_mm)
    check_levels("depth_mm", depth_mm, 3, 0.05)
    check_levels("displacement_mm", displacement_mm, 3, 0.05)
    above = depth_mm - reference_mm
    largest = float(max(lateral_ut.max(), sigma_ut))
    prior = CREST | {"field_amplitude_ut": (largest, largest)}

    def fitted(before: np.ndarray) -> Fit:
        known = lateral_ut[before], above[before], displacement_mm[before]
        return fit_law(lambda p: [_off_crest(p, *known) / sigma_ut], prior)

    first = fitted(np.ones(len(above), bool))
    return fitted(displacement_mm <= 0.5 * np.pi / first["field_wavenumber_rad_per_mm"])


def _off_crest(
    p: dict[str, Any], lateral: np.ndarray, above: np.ndarray, displacement: np.ndarray
) -> Any:
    grown = (p["field_growth_per_mm"] + p["field_growth_per_mm2"] * above) * above
    sine = np.sin(p["field_wavenumber_rad_per_mm"] * displacement)
    return lateral - p["field_amplitude_ut"] * np.exp(np.clip(grown, -50.0, 50.0)) * sine


def misfit_sigma(fit: Fit, noise: float) -> float:
    """One sigma of a fitted law: how far it is off beyond the noise, and its covariance.

    Over its own samples, the covariance of p parameters amounts to p / t of a residual's variance.
    """
    count = len(fit.values)
    variance = (fit.rms * noise) ** 2 * fit.samples / (fit.samples - count)
    misfit = max(variance - noise**2, 0.0)
    return float(np.sqrt(misfit + max(variance, noise**2) * count / fit.samples))
