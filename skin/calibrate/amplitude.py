"""What the sine estimator needs of a unit: M0(H), k and drifts."""

from __future__ import annotations

import numpy as np

from skin.errors import ScanError
from skin.physics.least_squares import Fit, check_levels, check_samples, gauss_newton, least_squares

__all__ = [
    "fit_amplitude",
    "fit_bare_chip",
    "fit_drift",
    "map_field",
]

WAVENUMBER_RAD_PER_MM = (0.05, 1.5)
"""Where k is looked for; R must stay within one period of the sine [assumed]."""
AXES = "xyz"


def fit_amplitude(
    lateral_ut: np.ndarray,
    depth_mm: np.ndarray,
    displacement_mm: np.ndarray,
    *,
    reference_mm: float = 2.0,
    degree: int = 1,
    sigma_ut: float = 105.0,
) -> Fit:
    """k and ln M0(H) of M_r = M0(H) sin(k R), from a scan over depth and displacement.

    With k given, ln M0 is linear in its coefficients: k is found alone (variable projection), and
    all of them are then refined together on the field itself, whose noise is even.

    Parameters
    ----------
    lateral_ut : ndarray, shape (t,)
        Lateral field along the displacement, at the reference temperatures.
    depth_mm, displacement_mm : ndarray, shape (t,)
        As commanded; R up to the crest, where the decoder ends.
    reference_mm : float
        Depth at which the amplitude is told.
    degree : int
        1: ``field_growth_per_mm`` alone; 2: also ``field_growth_per_mm2``.
    sigma_ut : float

    Returns
    -------
    Fit
        ``field_wavenumber_rad_per_mm``, ``field_amplitude_ut``, and the growth.

    Raises
    ------
    ScanError
        Too few samples, depths or displacements, or a value that is not finite.
    """
    if degree not in (1, 2):
        raise ScanError(f"degree: must be 1 or 2; got {degree}")
    check_samples(
        degree + 2, lateral_ut=lateral_ut, depth_mm=depth_mm, displacement_mm=displacement_mm
    )
    check_levels("depth_mm", depth_mm, degree + 1, 0.05)
    lateral, displacement = np.asarray(lateral_ut, float), np.asarray(displacement_mm, float)
    if not (lateral > 5.0 * sigma_ut).any():
        raise ScanError(
            f"lateral_ut: must rise above 5 sigma, {5.0 * sigma_ut:.4g} µT; got "
            f"{lateral.max():.4g} at most"
        )
    moved = displacement[lateral > 5.0 * sigma_ut]
    check_levels("displacement_mm", moved, 3, 0.05)
    above = np.asarray(depth_mm, float) - reference_mm
    powers = np.vander(above, degree + 1, increasing=True)
    names = ("field_wavenumber_rad_per_mm", "ln_amplitude", "field_growth_per_mm",
             "field_growth_per_mm2")[: degree + 2]  # fmt: skip

    def model(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        amplitude = np.exp(np.clip(powers @ at[1:], -50.0, 50.0))
        sine, cosine = np.sin(at[0] * displacement), np.cos(at[0] * displacement)
        columns = [amplitude * displacement * cosine, *(powers * (amplitude * sine)[:, None]).T]
        return amplitude * sine, np.stack(columns, axis=1)

    start = _project(lateral, displacement, powers, sigma_ut, names[1:])
    fit = gauss_newton(model, start, lateral, sigma_ut, names)
    amplitude = np.exp(fit["ln_amplitude"])
    values, jacobian = fit.values.copy(), np.eye(degree + 2)
    values[1] = jacobian[1, 1] = amplitude
    return fit.derived((names[0], "field_amplitude_ut", *names[2:]), values, jacobian)


def _project(
    lateral: np.ndarray, displacement: np.ndarray, powers: np.ndarray, sigma: float,
    names: tuple[str, ...],
) -> np.ndarray:  # fmt: skip
    """k, and what is best of the rest with it: the start of the fit."""
    strong = (lateral > 5.0 * sigma) & (displacement > 0.0)
    low, high = WAVENUMBER_RAD_PER_MM
    high = min(high, 0.95 * np.pi / displacement[strong].max())
    tried = np.linspace(low, high, 100)
    fits = [
        least_squares(
            powers[strong], np.log(lateral[strong] / np.sin(k * displacement[strong])),
            sigma / lateral[strong], names,
        )
        for k in tried
    ]  # fmt: skip
    best = min(range(len(fits)), key=lambda i: fits[i].chi2)
    return np.concatenate([[tried[best]], fits[best].values])


def fit_bare_chip(
    field_ut: np.ndarray,
    chip_temperature: np.ndarray,
    *,
    reference_c: float = 25.0,
    sigma_ut: float = 105.0,
) -> Fit:
    """Offset of each axis and its drift, from a chip that is heated before it has a film.

    With a film on it, an offset of Bz cannot be told from the film's own field.

    Parameters
    ----------
    field_ut : ndarray, shape (t, 3)
        In no field.
    chip_temperature : ndarray, shape (t,)
        Degree Celsius.

    Raises
    ------
    ScanError
        Too few samples or temperatures, or a value that is not finite.
    """
    check_samples(2, field_ut=field_ut, chip_temperature=chip_temperature)
    check_levels("chip_temperature", chip_temperature, 2, 5.0)
    warmer = np.asarray(chip_temperature, float) - reference_c
    block = np.stack([np.ones(len(warmer)), warmer], axis=1)
    names = [name for axis in AXES
             for name in (f"hall_offset_{axis}_ut", f"hall_drift_{axis}_ut_per_k")]  # fmt: skip
    values = np.asarray(field_ut, float).T.ravel()
    return least_squares(np.kron(np.eye(3), block), values, sigma_ut, names)


def fit_drift(
    field_ut: np.ndarray,
    film_temperature: np.ndarray,
    chip_temperature: np.ndarray,
    pose: np.ndarray,
    *,
    film_reference_c: float = 25.0,
    chip_reference_c: float = 25.0,
    sigma_ut: float = 105.0,
) -> Fit:
    """Drift of film and chip from a few poses that are held while the unit is heated.

    ``B = (1 + a_hall dT_chip)(1 + a_film dT_film) B_pose + b1 dT_chip``; the field of each pose at
    the reference temperatures is fitted along and is not returned.

    Parameters
    ----------
    field_ut : ndarray, shape (t, 3)
        Without the chip's offset at the reference temperature.
    film_temperature, chip_temperature : ndarray, shape (t,)
        Degree Celsius; one must not simply follow the other.
    pose : ndarray, shape (t,), int
        Number of the pose of each sample.

    Returns
    -------
    Fit
        ``film_drift_per_k``, ``hall_gain_per_k``, ``hall_drift_x_ut_per_k`` and so on.

    Raises
    ------
    ScanError
        Too few samples, poses of one field only, temperatures that do not change or go together,
        or a value that is not finite.
    """
    check_samples(
        8, field_ut=field_ut, film_temperature=film_temperature,
        chip_temperature=chip_temperature, pose=pose,
    )  # fmt: skip
    check_levels("film_temperature", film_temperature, 2, 5.0)
    check_levels("chip_temperature", chip_temperature, 2, 5.0)
    film = np.asarray(film_temperature, float) - film_reference_c
    chip = np.asarray(chip_temperature, float) - chip_reference_c
    columns = np.stack([np.ones_like(film), film, chip], axis=1)
    singular = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False)
    if singular[-1] < 1e-2:
        raise ScanError(
            "film_temperature, chip_temperature: must change apart from each other to tell "
            "film_drift_per_k and hall_gain_per_k apart (heat film and chip in turn); got "
            "temperatures of which one follows the other"
        )
    field = np.asarray(field_ut, float)
    _, which = np.unique(pose, return_inverse=True)
    poses = which.max() + 1
    if poses < 2:
        raise ScanError(
            "pose: must be 2 or more, of different fields, to tell the chip's gain from its "
            f"offset's drift; got {poses}"
        )
    names = ("film_drift_per_k", "hall_gain_per_k", *(f"hall_drift_{a}_ut_per_k" for a in AXES))
    of_poses = tuple(f"pose {p} B{axis}" for axis in AXES for p in range(poses))
    in_pose = np.eye(poses)[which]
    mean = (in_pose.T @ field) / in_pose.sum(axis=0)[:, None]
    start = np.concatenate([np.zeros(5), mean.T.ravel()])
    fit = gauss_newton(
        lambda at: _drifted(at, film, chip, in_pose), start, field.T.ravel(), sigma_ut,
        (*names, *of_poses),
    )  # fmt: skip
    return fit.derived(names, fit.values[:5], np.eye(5, fit.values.size))


def _drifted(
    at: np.ndarray, film: np.ndarray, chip: np.ndarray, in_pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Field of all axes, shape (3 t,), and its derivatives, (3 t, p); see `fit_drift`.

    `at` holds film drift, chip gain, three drifts of the offset, then per axis the field of each
    pose; film and chip are temperatures above their references, in_pose is (t, poses) of 0 and 1.
    """
    poses = in_pose.shape[1]
    which = in_pose.argmax(axis=1)
    of_film, of_chip = 1.0 + at[0] * film, 1.0 + at[1] * chip
    predicted, rows = [], []
    for axis in range(3):
        first = 5 + axis * poses
        own = at[first : first + poses][which]
        predicted.append(of_film * of_chip * own + at[2 + axis] * chip)
        row = np.zeros((len(film), at.size))
        row[:, 0], row[:, 1] = film * of_chip * own, of_film * chip * own
        row[:, 2 + axis] = chip
        row[:, first : first + poses] = (of_film * of_chip)[:, None] * in_pose
        rows.append(row)
    return np.concatenate(predicted), np.concatenate(rows)


def map_field(field_ut: np.ndarray, film: Fit) -> np.ndarray:
    """Lateral field without offset, and mapped, as `skin.calibrate.film.fit_film` has both.

    Parameters
    ----------
    field_ut : ndarray, shape (t, 3)

    Returns
    -------
    ndarray, shape (2, t)
    """
    x, y = (field_ut[:, i] - film[f"hall_offset_{axis}_ut"] for i, axis in enumerate("xy"))
    return np.stack([film[f"field_{row}x"] * x + film[f"field_{row}y"] * y for row in "xy"])
