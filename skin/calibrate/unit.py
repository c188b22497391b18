"""From the recordings of a bench to all parameters of every unit, each with its sigma.

The order is that of decoding: gel, frequency and normal force, chip, film, shear; what is fitted
later is fitted on what the earlier fits have corrected. Beside the parameters stands one sigma of
the calibration itself for each law: what the covariance of its fit and the law's own misfit leave,
the same in every reading of the unit.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from skin.calibrate.amplitude import fit_amplitude, fit_bare_chip, fit_drift, map_field
from skin.calibrate.film import FilmFit, fit_film
from skin.calibrate.gel import fit_gel
from skin.calibrate.normal import fit_frequency, fit_normal
from skin.calibrate.read import as_fit
from skin.calibrate.shear import fit_shear
from skin.calibrate.spread import Spread, even_spread, law_spread
from skin.calibrate.write import parameter_values
from skin.errors import ScanError
from skin.physics.force_law import (
    normal_law,
    normal_slope,
    shear_law,
    shear_slope,
    stiffening,
)
from skin.physics.least_squares import Fit
from skin.physics.scan import Recordings, Scan
from topology import CHANNELS, Topology
from topology.gel import gel_temperature

__all__ = ["Calibration", "calibrate", "calibrate_unit", "fit_crest", "left_of", "with_fits"]

GEL = CHANNELS.index("gel")


@dataclass(frozen=True, eq=False)
class Calibration:
    """Units as they were found on a bench.

    Attributes
    ----------
    topology : Topology
        The skin with the parameters of its units.
    units : dict of str to tuple of Fit
        Unit to its fits; a later one stands above an earlier.
    films : dict of str to FilmFit
        How well the model follows each film.
    """

    topology: Topology
    units: dict[str, tuple[Fit, ...]]
    films: dict[str, FilmFit]


def calibrate(topology: Topology, recordings: Recordings) -> Calibration:
    """Fit every unit of a skin.

    Parameters
    ----------
    topology : Topology
        Nominal parameters: what no recording tells (noise, lags, ranges) stays as it is.
    recordings : Recordings

    Raises
    ------
    ScanError
        A recording cannot tell a parameter of a unit.
    """
    units, films = {}, {}
    for unit, name in enumerate(topology.unit_names):
        try:
            units[name], films[name] = calibrate_unit(topology, recordings, unit)
        except ScanError as error:
            raise ScanError(f"{name}: {error}") from None
    return Calibration(with_fits(topology, units), units, films)


def calibrate_unit(
    topology: Topology, recordings: Recordings, unit: int
) -> tuple[tuple[Fit, ...], FilmFit]:
    """Fit one unit; see `calibrate`."""
    p = {name: values[..., unit] for name, values in topology.parameters.items()}
    share = 1.0 / np.sqrt(recordings.readings)
    field_ut = share * float(p["field_noise_ut"])
    force_n = share * recordings.force_sigma_n
    bare, heated, warmed, pressed, sheared = (
        _of(scan, unit)
        for scan in (recordings.bare, recordings.heated, recordings.warmed, recordings.pressed,
                     recordings.sheared)
    )  # fmt: skip

    gel_noise = float(p["gel_noise_relative"])
    gel_c = np.concatenate([scan["gel_temperature"] for scan in (heated, warmed)])
    counts = np.concatenate([scan["counts"][:, GEL] for scan in (heated, warmed)])
    current = topology.scale[GEL, unit] * counts + topology.offset[GEL, unit]
    gel = fit_gel(current, gel_c, sigma_relative=gel_noise)

    depth = pressed["depth_mm"]
    noise_hz = share * float(p["frequency_noise_hz"])
    frequency = fit_frequency(pressed["frequency_hz"], depth, sigma_hz=noise_hz)
    slope = frequency["frequency_slope_hz_per_mm"]
    slope_sigma = frequency.sigma[1] / slope
    normal = fit_normal(
        pressed["force_n"][:, 1], slope * depth, sigma_n=force_n, fall_sigma_relative=slope_sigma
    )

    chip_c, film_c = float(p["hall_reference_c"]), float(p["film_reference_c"])
    chip = fit_bare_chip(
        bare["field_ut"], bare["chip_temperature"], reference_c=chip_c, sigma_ut=field_ut
    )
    offset = np.array([chip[f"hall_offset_{axis}_ut"] for axis in "xyz"])
    drift = fit_drift(
        heated["field_ut"] - offset, heated["film_temperature"], heated["chip_temperature"],
        _poses(heated), film_reference_c=film_c, chip_reference_c=chip_c, sigma_ut=field_ut,
    )  # fmt: skip

    field = sheared["field_ut"]
    place = sheared["depth_mm"], sheared["displacement_mm"]
    film = fit_film(
        field, *place, sheared["direction_rad"], offset_ut=tuple(offset), sigma_ut=field_ut,
        reading_ut=float(p["field_noise_ut"]),
    )  # fmt: skip
    x, y = map_field(field, film.fit)
    way = place[1] * np.exp(1j * sheared["direction_rad"])
    way += film.fit["film_x_mm"] + 1j * film.fit["film_y_mm"]
    lateral = (x * np.real(way) + y * np.imag(way)) / np.abs(way)
    amplitude = fit_crest(lateral, place[0], np.abs(way), float(p["field_reference_mm"]), field_ut)
    shear = fit_shear(
        sheared["force_n"][:, 0], place[1], place[0],
        reference_mm=float(p["field_reference_mm"]), sigma_n=force_n,
    )  # fmt: skip
    kelvin, laws = 60.0 / np.log(gel["gel_current_ratio"]), (gel, frequency, normal, shear)
    known = {**p, **{name: fit[name] for fit in laws for name in fit.names}}
    pushed, sideways = _normal_spread(known, pressed), _shear_spread(known, sheared)
    gel_sigma_c = kelvin * unknown_of(gel, gel_noise)
    spread = {
        "temperature_sigma_c": np.hypot(_temperature_sigma_c(known, current, gel_c), gel_sigma_c),
        "frequency_sigma_hz": unknown_of(frequency, noise_hz),
        "depth_sigma_mm": _depth_sigma_mm(known, pressed),
        "normal_sigma_relative": np.hypot(
            _relative(pushed, normal, pressed["force_n"][:, 1], force_n), slope_sigma
        ),
        "normal_sigma_n": pushed.absolute,
        "field_sigma_ut": left_of(chip, field_ut),
        "field_angle_sigma_mm": film.sigma_mm,
        "field_amplitude_sigma_relative": left_of(amplitude, field_ut) / _rms(lateral),
        "shear_sigma_relative": _relative(sideways, shear, sheared["force_n"][:, 0], force_n),
        "shear_sigma_n": sideways.absolute,
    }
    # a spread of t samples is known to a share of 1 / sqrt(2 t)
    relative = 1.0 / np.sqrt(2.0 * film.fit.samples)
    values = {name: (s, relative * s) for name, s in spread.items()}
    values |= {f"field_angle_variance_relative[{i}]": (s, np.nan) for i, s in enumerate(film.shape)}
    deepest = float(slope * depth.max())
    values["normal_max_n"] = float(normal_law(known, np.array(deepest))), force_n
    told = as_fit(values, film.fit.samples)
    return (gel, frequency, normal, drift, chip, film.fit, amplitude, shear, told), film


def _relative(spread: Spread, fit: Fit, force_n: np.ndarray, noise_n: float) -> float:
    """Relative sigma of a force law: what it is off, and what its fit leaves unknown."""
    return float(np.hypot(spread.relative, unknown_of(fit, noise_n) / _rms(force_n)))


def left_of(fit: Fit, noise: float) -> float:
    """One sigma of a fitted law: how far it is off beyond the noise, and its covariance.

    Over its own samples, the covariance of p parameters amounts to p / t of a residual's variance.
    """
    count = len(fit.values)
    variance = fit.residual_rms**2 * fit.samples / (fit.samples - count)
    misfit = max(variance - noise**2, 0.0)
    return float(np.sqrt(misfit + max(variance, noise**2) * count / fit.samples))


def unknown_of(fit: Fit, noise: float) -> float:
    """One sigma of a fitted law that noise leaves: p / t of its variance."""
    return noise * float(np.sqrt(len(fit.values) / fit.samples))


def _temperature_sigma_c(p: Mapping[str, float], current: np.ndarray, gel_c: np.ndarray) -> float:
    """What the temperature is off by."""
    order = np.argsort(gel_c, kind="stable")
    told = gel_temperature(p, current[order] / p["gel_current_20c_ua"])
    kelvin = 60.0 / np.log(p["gel_current_ratio"])
    return even_spread(told - gel_c[order], kelvin * p["gel_noise_relative"])


def _depth_sigma_mm(p: Mapping[str, float], pressed: dict[str, np.ndarray]) -> float:
    """What the depth is off by, by a straight line."""
    slope = p["frequency_slope_hz_per_mm"]
    error = (p["frequency_rest_hz"] - pressed["frequency_hz"]) / slope - pressed["depth_mm"]
    return even_spread(error, p["frequency_noise_hz"] / slope)


def _normal_spread(p: Mapping[str, float], pressed: dict[str, np.ndarray]) -> Spread:
    """What the normal force is off by, as it is decoded from the frequency."""
    fall = p["frequency_rest_hz"] - pressed["frequency_hz"]
    law, noise = normal_law(p, fall), normal_slope(p, fall) * p["frequency_noise_hz"]
    return law_spread(law - pressed["force_n"][:, 1], law, noise)


def _shear_spread(p: Mapping[str, float], sheared: dict[str, np.ndarray]) -> Spread:
    """What the tangential force is off by at a displacement that is known."""
    length = sheared["displacement_mm"]
    gain = stiffening(sheared["depth_mm"], p["shear_gain_per_mm"], p["field_reference_mm"])
    law, slope = shear_law(p, length) * gain, gain * shear_slope(p, length)
    # at rest, where the field is weakest, a reading knows the least of its displacement
    noise_mm = p["field_noise_ut"] / (p["field_amplitude_ut"] * p["field_wavenumber_rad_per_mm"])
    return law_spread(law - sheared["force_n"][:, 0], law, slope * noise_mm)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def fit_crest(
    lateral: np.ndarray, depth: np.ndarray, displacement: np.ndarray, reference_mm: float,
    sigma_ut: float,
) -> Fit:  # fmt: skip
    """M0(H) and k, of what lies before the crest.

    Parameters
    ----------
    lateral, depth, displacement : ndarray, shape (t,)
        As of `skin.calibrate.amplitude.fit_amplitude`.
    reference_mm, sigma_ut : float
    """
    fit = functools.partial(fit_amplitude, reference_mm=reference_mm, sigma_ut=sigma_ut)
    first = fit(lateral, depth, displacement)
    before = displacement <= 0.5 * np.pi / first["field_wavenumber_rad_per_mm"]
    return fit(lateral[before], depth[before], displacement[before], degree=2)


def _of(scan: Scan, unit: int) -> dict[str, np.ndarray]:
    """Arrays of one unit, by name."""
    return {field.name: getattr(scan, field.name)[..., unit] for field in dataclasses.fields(scan)}


def _poses(scan: Mapping[str, np.ndarray]) -> np.ndarray:
    """Number of the pose of each sample."""
    names = ("depth_mm", "displacement_mm", "direction_rad")
    poses = np.stack([scan[name] for name in names], axis=1)
    return np.unique(poses, axis=0, return_inverse=True)[1].ravel()


def with_fits(topology: Topology, units: Mapping[str, tuple[Fit, ...]]) -> Topology:
    """The skin with fitted parameters.

    Parameters
    ----------
    topology : Topology
    units : dict of str to tuple of Fit
        Units and their fits; those that are missing stay as they are.
    """
    changed = {name: values.copy() for name, values in topology.parameters.items()}
    for name, fits in units.items():
        index = topology.unit_index(name)
        most = float(topology.parameters["tangential_max_mm"][index])
        for parameter, (value, _) in parameter_values(name, fits, most).items():
            changed[parameter][..., index] = value
    for values in changed.values():
        values.flags.writeable = False
    return dataclasses.replace(topology, parameters=changed)
