"""Direction and displacement of a unit in one fit: 2x2 map, offset, centre and R(psi, H) together.

A film off the chip's axis looks like an offset of the lateral field that grows as the film nears
the chip: no offset undoes it, but a shift of the displacement does, and a tilt is a little of both.
What is fitted is therefore the displacement, not the field, over the whole range: each sample
weighs as much as its displacement is worth, and what the model cannot follow is reported as a
spread of its own, which differs over the range (`skin.calibrate.film_variance`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root_scalar

from skin.calibrate.field_angle import ANGLE_NAMES, angle_powers, angle_slope, field_angle
from skin.calibrate.film_variance import Scatter, fit_variance
from skin.errors import ScanError
from skin.physics.least_squares import Fit, check_levels, check_samples, gauss_newton, least_squares

__all__ = ["FilmFit", "fit_film", "map_field"]

RAW = ("stretch", "skew", "turn", "hall_offset_x_ut", "hall_offset_y_ut", "film_x_mm", "film_y_mm",
       *ANGLE_NAMES)  # fmt: skip
TABLE = 7
"""First of the polynomial's coefficients in `RAW`."""
NAMES = ("field_xx", "field_xy", "field_yx", "field_yy", *RAW[3:], "field_angle_max_mm")
SHORTEST = 0.5
"""Least share of the scan's displacements over which the angle must grow [assumed]."""
LEVELS = 50
"""Depths at which the range is looked for, where a scan has more [assumed]."""
ROUNDS = 3
"""Fits with the spread that the one before has left."""


@dataclass(frozen=True, eq=False)
class FilmFit:
    """Lateral field of a unit to its displacement.

    Attributes
    ----------
    fit : Fit
        ``field_xx`` to ``field_yy`` (determinant 1 to second order), ``hall_offset_x_ut``,
        ``hall_offset_y_ut``, ``film_x_mm``, ``film_y_mm``, ``field_angle_mm[0]`` to ``[15]``, and
        ``field_angle_max_mm``, the end of the scan, or where before it the angle ceases to grow;
        residuals in mm, of a component.
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
    reading_ut: float = 105.0,
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
    reading_ut : float
        The same of a single reading, as a decoder gets it.

    Raises
    ------
    ScanError
        Too few samples, depths, displacements or directions, a value that is not finite, or an
        angle that does not grow over the better part of the displacements.
    """
    check_samples(
        len(RAW), field_ut=field_ut, depth_mm=depth_mm, displacement_mm=displacement_mm,
        direction_rad=direction_rad,
    )  # fmt: skip
    along = np.stack([np.cos(direction_rad), np.sin(direction_rad)])
    check_levels("direction_rad", np.arctan2(along[1], along[0]), 4, 0.2)
    field = (np.asarray(field_ut, float) - offset_ut).T
    depth, displacement = np.asarray(depth_mm, float), np.asarray(displacement_mm, float)
    # the model gives the displacement along and across the commanded direction
    wanted = np.concatenate([displacement, np.zeros_like(displacement)])
    angle = field_angle(field.T, direction_rad)
    start = least_squares(angle_powers(angle, depth), displacement, 1.0, ANGLE_NAMES)
    found = np.concatenate([np.zeros(TABLE), start.values])
    spread_mm = 0.0
    for _ in range(ROUNDS):
        noise = _noise_mm(found, field, depth, along) * sigma_ut
        sigma = np.hypot(noise, spread_mm)
        fit = gauss_newton(lambda at: _model(at, field, depth, along), found, wanted, sigma, RAW)
        found = fit.values
        residual = wanted - _model(found, field, depth, along)[0]
        spread_mm = _spread(residual, noise, residual.size - found.size)
    range_mm = _range(found[TABLE:], depth, float(displacement.max()))
    derivatives = _model(found, field, depth, along)[1]
    own = np.einsum("tp,pq,tq->t", derivatives, fit.covariance, derivatives)
    sigma_mm = float(np.hypot(spread_mm, np.sqrt(own.mean())))
    scatter = Scatter(*(each.reshape(2, -1) for each in (residual, noise, own)))
    variance = fit_variance(scatter, along, depth, displacement, sigma_mm**2, reading_ut / sigma_ut)
    values, jacobian = np.empty(len(NAMES)), np.zeros((len(NAMES), len(RAW)))
    values[:4], jacobian[:4, :3] = _map(*found[:3]).ravel(), _MAP_BY
    values[4:-1], jacobian[4:-1, 3:] = found[3:], np.eye(len(RAW) - 3)
    values[-1] = range_mm
    values[4:6] += offset_ut[:2]
    told = fit.derived(NAMES, values, jacobian)
    flat = np.append(1.0, np.zeros(len(variance) - 1))
    return FilmFit(told, spread_mm, sigma_mm, variance / sigma_mm**2 - flat)


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


_MAP_BY = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 1.0, -1.0], [-1.0, 0.0, 0.0]])
"""d (xx, xy, yx, yy) / d (stretch, skew, turn)."""


def _map(stretch: float, skew: float, turn: float) -> np.ndarray:
    return np.array([[1.0 + stretch, skew + turn], [skew - turn, 1.0 - stretch]])


def _spread(residual: np.ndarray, noise: np.ndarray, freedom: int) -> float:
    """Spread in addition to the noise with which chi-squared of the residuals is their number."""

    def excess(spread: float) -> float:
        return float(np.sum(residual**2 / (noise**2 + spread**2)) - freedom)

    if excess(0.0) <= 0.0:
        return 0.0
    most = 2.0 * float(np.abs(residual).max())
    return root_scalar(excess, bracket=(0.0, most), method="brentq").root


def _range(table: np.ndarray, depth: np.ndarray, longest_mm: float) -> float:
    """Displacement up to which R(psi, H) rises with psi at every depth, at most `longest_mm`."""
    levels = np.unique(depth)
    if levels.size > LEVELS:
        levels = np.linspace(levels[0], levels[-1], LEVELS)
    angle, level = np.meshgrid(np.linspace(0.0, 0.75 * np.pi, 400), levels)
    place = angle.ravel(), level.ravel()
    rises = angle_slope(table.reshape(4, 4), *place).reshape(angle.shape) > 0.0
    rises = np.logical_and.accumulate(rises, axis=1)
    displacement = (angle_powers(*place) @ table).reshape(angle.shape)
    end = float(np.where(rises, displacement, 0.0).max(axis=1).min())
    if end < SHORTEST * longest_mm:
        raise ScanError(
            "field_ut: must have an angle that grows with displacement over the scan; got one that "
            f"ceases to grow at {end:.3g} mm"
        )
    return min(end, longest_mm)


def _model(
    at: np.ndarray, field: np.ndarray, depth: np.ndarray, along: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Displacement along and across, shape (2 t,), and its derivatives, (2 t, p)."""
    raw = field[:2] - at[3:5, np.newaxis]
    lateral = _map(*at[:3]) @ raw
    size = np.maximum(np.hypot(*lateral), 1e-9)
    direction = lateral / size
    angle = np.arctan2(size, field[2])
    table = at[TABLE:].reshape(4, 4)
    powers = angle_powers(angle, depth)
    displacement = powers @ at[TABLE:]
    # d displacement / d size at the same Bz, and their ratio for a change of the direction
    radial = angle_slope(table, angle, depth) * field[2] / (size**2 + field[2] ** 2)
    around = displacement / size
    by_field = np.einsum("it,jt->ijt", direction, direction) * (radial - around)
    by_field[0, 0] += around
    by_field[1, 1] += around
    zero = np.zeros_like(angle)
    x, y = raw
    by = np.stack(
        [[x, -y], [y, x], [y, -x], *(-_map(*at[:3]).T[:, :, np.newaxis] + zero)], axis=1
    )  # d lateral / d parameter, shape (2, 5, t)
    first = np.einsum("ijt,jpt->ipt", by_field, by)
    moved = direction * displacement - at[5:TABLE, np.newaxis]
    centre = np.broadcast_to(-np.eye(2)[:, :, np.newaxis], (2, 2, len(angle)))
    each = np.concatenate([first, centre, direction[:, np.newaxis, :] * powers.T], axis=1)
    turned = np.stack([along, np.stack([-along[1], along[0]])])
    predicted = np.einsum("ait,it->at", turned, moved)
    return predicted.ravel(), np.einsum("ait,ipt->atp", turned, each).reshape(2 * len(angle), -1)


def _noise_mm(
    at: np.ndarray, field: np.ndarray, depth: np.ndarray, along: np.ndarray
) -> np.ndarray:
    """Noise of the displacement along and across for 1 µT of each axis, shape (2 t,)."""
    raw = field[:2] - at[3:5, np.newaxis]
    lateral = _map(*at[:3]) @ raw
    forward = np.sum(along * lateral, axis=0)
    angle = np.arctan2(np.abs(forward), field[2])
    table = at[TABLE:].reshape(4, 4)
    radial = angle_slope(table, angle, depth) / np.hypot(forward, field[2])
    # across: R / M_r, which at no displacement is what it is along
    small = np.abs(forward) < 1e-3 * np.abs(field[2])
    across = angle_powers(angle, depth) @ at[TABLE:] / np.where(small, 1.0, np.abs(forward))
    return np.concatenate([radial, np.where(small, radial, across)])
