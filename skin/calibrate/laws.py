"""The laws of one unit, each fitted to blocks of its recording: gel, normal, drift, film, shear.

Every fit gives the parameters that it fixes, and of each other parameter of its law why it stays as
the unit's model has it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from skin.calibrate.bench.series import AXES, Blocks
from skin.calibrate.film import FilmFit, displaced, fit_film
from skin.calibrate.fit import (
    KEPT,
    Fit,
    cross_validated,
    fit_law,
    folds_of,
    robust_sigma,
)
from skin.errors import ScanError
from skin.physics.force_law import force, normal_law, shear_law, stiffening
from topology import CHANNELS
from topology.gel import gel_ends, gel_slope, gel_temperature

__all__ = ["AMBIENT_UT", "PRIOR", "TURN_RAD", "at_reference", "fit_drift", "fit_gel",
           "fit_normal", "fit_shear", "low_pass", "robust_film", "sheared", "temperature_of",
           "widened"]  # fmt: skip

GEL, FREQUENCY, BX = (CHANNELS.index(name) for name in ("gel", "frequency", "bx"))
CHIP = CHANNELS.index("hall_temperature")
Parameters = dict[str, Any]
Found = tuple[Fit, dict[str, str]]
"""A fit, and of each parameter of the law that it does not fix, why it stays the model's."""

PRIOR: dict[str, tuple[float, float]] = {
    "gel_current_20c_ua": (0.05, 0.0), "gel_current_ratio": (0.05, 0.0),
    "gel_bend_c": (0.0, 30.0), "gel_twist_c": (0.0, 10.0),
    "frequency_rest_hz": (0.02, 0.0), "frequency_slope_hz_per_mm": (0.03, 0.0),
    "normal_soft_n_per_hz": (0.05, 0.0), "normal_break_hz": (0.05, 0.0),
    "normal_stiff_n_per_hz": (0.05, 0.0),
    "shear_soft_n_per_mm": (0.05, 0.0), "shear_break_mm": (0.05, 0.0),
    "shear_stiff_n_per_mm": (0.05, 0.0), "shear_gain_per_mm": (0.0, 0.1),
    "film_drift_per_k": (0.2, 0.0), "hall_gain_per_k": (0.3, 0.0),
    **{f"hall_drift_{axis}_ut_per_k": (0.0, 1.0) for axis in AXES},
    **{f"hall_offset_{axis}_ut": (0.0, 150.0) for axis in AXES},
}  # fmt: skip
"""One sigma of what a unit's model says of it, relative and absolute: the bounds within which units
are evenly spread, so that the prior is weaker than the units are alike [assumed]."""
TOUCH_MM = 1.0
"""How far from the tare of the stage the touch may be, one sigma [assumed]."""
TURN_RAD = 0.035
"""Turn of the force sensor's axes against the unit's, one sigma: 2° [assumed]."""
AMBIENT_UT = 50.0
"""One sigma of an axis of the ambient field [derived: the Earth's]."""
FORCE_N = 0.005
"""One-sigma of a reading of a force sensor, at least [assumed]."""
OUTLIER = 5.0
"""Sigmas beyond which a block is none of the film [assumed]."""
LEAST_BLOCKS = 30
CHECKED = 600
"""Samples of a cross-validation [assumed: far fewer determine an order]."""
HEAT_LOST = 0.016
"""Of a change of the gel's temperature that does not reach the film, which is taken to follow it
whole: 1 - 0.974 / 0.99 of the 1-D heat model in long contact [assumed]."""
TILT_RAD = np.radians(1.0) / np.sqrt(3.0)
"""Tilt of a film, one sigma: evenly spread by 1° [assumed]."""
WARMED_K = 5.0
"""Change of temperature that determines a law of it [assumed]."""
TWO = ("gel_current_20c_ua", "gel_current_ratio")
GEL_LAWS = {1: TWO, 2: (*TWO, "gel_bend_c"), 3: (*TWO, "gel_bend_c", "gel_twist_c")}
"""Parameters of the laws of the gel, by their order in the logarithm of the current."""
MARGIN = 3.0
"""Standard errors by which a law of higher order must predict better: it goes on less safely beyond
what was recorded [assumed]."""
LEAST_SLOPE = 0.1
"""Of that of the exponential law, for the noise of a current [assumed]."""


def _prior_of(p: Parameters, *names: str) -> dict[str, tuple[float, float]]:
    """Mean and sigma of parameters, of the unit's model `p`."""
    return {name: (float(p[name]), PRIOR[name][0] * abs(float(p[name])) + PRIOR[name][1])
            for name in names}  # fmt: skip


def _needed(blocks: Blocks, what: str, *arrays: np.ndarray) -> Blocks:
    """The blocks where everything was measured."""
    whole = np.asarray(np.isfinite(np.stack(arrays)).all(axis=0))
    if whole.sum() < LEAST_BLOCKS:
        raise ScanError(f"{what}: must be {LEAST_BLOCKS} blocks of 0.1 s or more; got "
                        f"{int(whole.sum())}")  # fmt: skip
    return blocks.where(whole)


def _settled(
    p: Parameters, residual: Callable[[Parameters], Sequence[np.ndarray]],
    prior: dict[str, tuple[float, float]], over: Sequence[np.ndarray | None] = (), cube: str = "",
) -> Found:  # fmt: skip
    """`fit_law` of parameters of `p` and others. What the data do not determine, or a cube that
    they do not show, stays the model's, and the others are fitted with it there."""
    known = p | {name: mean for name, (mean, _) in prior.items()}
    fit = fit_law(lambda at: residual(known | at), prior, over)
    kept = {name: f"the recordings leave {left:.0%} of its prior variance"
            for name, left in zip(fit.names, fit.left, strict=True)
            if left > KEPT and name in p}  # fmt: skip
    if cube and fit[cube] < 0.0:
        kept[cube] = "the best law would soften"
    if kept:
        others = {name: each for name, each in prior.items() if name not in kept}
        fit = fit_law(lambda at: residual(known | at), others, over)
    return fit, kept


# -- gel ------------------------------------------------------------------------------------------


def fit_gel(p: Parameters, blocks: Blocks) -> Found:
    """Current at 20 °C, its ratio at 80 °C and, where they predict better, bend and twist of its
    law, from blocks whose temperature was measured."""
    seen = _needed(blocks, "temperature of the reference", blocks.temperature)
    current = seen.values[GEL]
    if not (current > 0.0).all():
        raise ScanError(f"gel current: must be above 0; got {current.min():.4g} µA")
    sigma = float(p["gel_noise_relative"]) / np.sqrt(seen.size)

    def misfit(at: Parameters) -> np.ndarray:
        now = {**p, **at}
        share = current / now["gel_current_20c_ua"]
        least = LEAST_SLOPE * 60.0 / np.log(now["gel_current_ratio"])
        error = gel_temperature(now, share) - seen.temperature
        return error / np.maximum(gel_slope(now, share), least) / sigma

    few = np.arange(len(seen)) % max(len(seen) // CHECKED, 1) == 0

    def error(order: int, training: np.ndarray) -> np.ndarray:
        prior = _prior_of(p, *GEL_LAWS[order])
        fit = fit_law(lambda at: [misfit(at)[training & few]], prior)
        return misfit(dict(zip(fit.names, fit.values, strict=True)))[~training & few] ** 2

    best, _ = cross_validated(tuple(GEL_LAWS), folds_of(len(seen)), error, MARGIN)
    for order in range(best, 0, -1):
        fit, kept = _settled(p, lambda at: [misfit(at)], _prior_of(p, *GEL_LAWS[order]))
        if _rises(p | dict(zip(fit.names, fit.values.tolist(), strict=True))):
            break
    others = set(GEL_LAWS[3]) - set(GEL_LAWS[order])
    return fit, kept | dict.fromkeys(sorted(others), "no better by cross-validation")


def _rises(p: Parameters) -> bool:
    """Whether the temperature rises with the current over the whole calibrated range of a unit."""
    first, last = (gel_temperature(p, p["gel_current_ratio"] ** x) for x in gel_ends(p))
    return bool((first <= p["temperature_min_c"]) & (last >= p["temperature_max_c"]))


def temperature_of(p: Parameters, blocks: Blocks) -> np.ndarray:
    """Temperature by the gel's law, °C, shape (b,)."""
    return gel_temperature(p, np.maximum(blocks.values[GEL], 1e-9) / p["gel_current_20c_ua"])


# -- forces ---------------------------------------------------------------------------------------


def fit_normal(p: Parameters, blocks: Blocks, measured: bool) -> Found:
    """Frequency at rest, its fall and the normal force, from blocks that are pressed.

    Parameters
    ----------
    p : dict of str to float
    blocks : Blocks
        Force or displacement may be missing (NaN).
    measured : bool
        Whether the depth is the reference's, and not one decoded by the unit's own model: then its
        zero (``touch_mm``) and the fall per mm are fitted along.

    Returns
    -------
    Found
        Of parameters of `UnitModel`, of ``touch_mm``, ``turn_x`` and ``turn_y``.
    """
    seen = _needed(blocks, "depth of press", blocks.displacement[2])
    frequency, way, push = seen.values[FREQUENCY], seen.displacement[2], seen.force[2]
    felt = np.isfinite(push)
    sigma_hz = float(p["frequency_noise_hz"]) / np.sqrt(seen.size)
    sigma_n = FORCE_N / np.sqrt(seen.size[felt])
    soft, knee, stiffer, _ = normal_law(p)
    end_hz = knee + (p["normal_max_n"] - soft * knee) / (soft + stiffer)
    cube = _cube_of(p, "normal_cubic_n_per_hz3", soft + stiffer, knee, end_hz)
    prior = cube | _prior_of(p, "frequency_rest_hz", "normal_soft_n_per_hz", "normal_break_hz",
                             "normal_stiff_n_per_hz")  # fmt: skip
    if measured:
        prior |= _prior_of(p, "frequency_slope_hz_per_mm") | {"touch_mm": (0.0, TOUCH_MM)}
    # a turned sensor shows some of what is tangential as normal
    prior |= {"turn_x": (0.0, TURN_RAD), "turn_y": (0.0, TURN_RAD)}
    sideways = np.nan_to_num(seen.force[:2])

    def residual(at: Parameters) -> list[np.ndarray]:
        touch_mm = at.get("touch_mm", 0.0)
        fall = at["frequency_slope_hz_per_mm"] * np.maximum(way - touch_mm, 0.0)
        law = force(fall, normal_law(at))
        law = law + at["turn_x"] * sideways[1] - at["turn_y"] * sideways[0]
        return [
            (frequency - at["frequency_rest_hz"] + fall) / sigma_hz, (push - law)[felt] / sigma_n
        ]  # fmt: skip

    return _settled(p, residual, prior, (way, way[felt]), *cube)


def fit_shear(p: Parameters, blocks: Blocks, normal_n: np.ndarray) -> Found:
    """Tangential force against displacement and depth, and the turn of the force sensor's axes.

    Parameters
    ----------
    p : dict of str to float
    blocks : Blocks
        Pressed and sheared.
    normal_n : ndarray, shape (b,)
        Normal force by the unit's law: a turned sensor shows some of it sideways.

    Returns
    -------
    Found
        Of parameters of `UnitModel`, and ``turn_x``, ``turn_y``, ``turn_z`` in rad.
    """
    seen = _needed(blocks, "force_x, force_y of the reference", *blocks.force[:2])
    normal_n = normal_n[np.isfinite(blocks.force[:2]).all(axis=0)]
    radius = np.hypot(*seen.displacement[:2])
    along = seen.displacement[:2] / np.maximum(radius, 1e-9)
    sigma = FORCE_N / np.sqrt(seen.size)
    soft, knee, stiffer, _ = shear_law(p)
    cube = _cube_of(p, "shear_cubic_n_per_mm3", soft + stiffer, knee, p["tangential_max_mm"])

    def misfit(at: Parameters) -> list[np.ndarray]:
        fx, fy = sheared(at, seen.displacement) * along
        seen_x = fx + at["turn_y"] * normal_n - at["turn_z"] * fy
        seen_y = fy + at["turn_z"] * fx - at["turn_x"] * normal_n
        x, y = (seen.force[:2] - np.stack([seen_x, seen_y])) / sigma
        # along the displacement, which the law is of, and across it
        return [x * along[0] + y * along[1], y * along[0] - x * along[1]]

    prior = cube | _prior_of(p, "shear_soft_n_per_mm", "shear_break_mm", "shear_stiff_n_per_mm",
                             "shear_gain_per_mm")  # fmt: skip
    prior |= {f"turn_{axis}": (0.0, TURN_RAD) for axis in AXES}
    return _settled(p, misfit, prior, (radius, None), *cube)


def _cube_of(
    p: Parameters, name: str, slope: float, knee: float, end: float
) -> dict[str, tuple[float, float]]:
    """Of the cube of a law: none, and one sigma twice the slope at the end of the range."""
    return {name: (float(p[name]), float(slope) / (3.0 * max(end - knee, 0.1 * end) ** 2))}


def sheared(p: Parameters, displacement_mm: np.ndarray) -> np.ndarray:
    """Tangential force by the law of a unit at displacements and depths, shape (3, b)."""
    x, y, depth = displacement_mm
    grown = stiffening(depth, p["shear_gain_per_mm"], p["field_reference_mm"])
    return force(np.hypot(x, y), shear_law(p)) * grown


# -- field ----------------------------------------------------------------------------------------


def low_pass(time_s: np.ndarray, values: np.ndarray, lag_s: float) -> np.ndarray:
    """Values behind a first-order lag, from rest at the first of them; gaps of time are bridged."""
    share = -np.expm1(-np.diff(time_s, prepend=time_s[0]) / max(lag_s, 1e-6))
    out, now = np.empty_like(values), float(values[0])
    for i, (value, part) in enumerate(zip(values.tolist(), share.tolist(), strict=True)):
        now += part * (value - now)
        out[i] = now
    return out


def fit_drift(
    p: Parameters, blocks: Blocks, film_c: np.ndarray, bare: Blocks | None = None
) -> Found:
    """Drift of film and chip, from poses that are held while the unit is heated, and from the chip
    before it had a film.

    ``B = b0 + b1 dT_chip + (1 + a_hall dT_chip)(1 + a_film dT_film) B_pose``; each segment is a
    pose, whose field is a nuisance parameter. That of a bare chip is the ambient one, which is
    small: so its offset is known, to that field, and its gain is not.

    Parameters
    ----------
    p : dict of str to float
    blocks : Blocks
        Of segments that are heated.
    film_c : ndarray, shape (b,)
        Temperature of the film.
    bare : Blocks, optional
        Of the chip without film.
    """
    if bare is None and (len(blocks) < LEAST_BLOCKS or np.ptp(film_c) < WARMED_K):
        got = f"{np.ptp(film_c):.3g}" if len(blocks) else "no such segment"
        raise ScanError(f"heated segments: must change the temperature by {WARMED_K:g} K or more; "
                        f"got {got}")  # fmt: skip
    field, noise_ut = blocks.values[BX : BX + 3], float(p["field_noise_ut"])
    chip, film = _above(p, blocks), film_c - float(p["film_reference_c"])
    numbers, pose = np.unique(blocks.segment, return_inverse=True)
    names = ["film_drift_per_k", "hall_gain_per_k", *(f"hall_drift_{a}_ut_per_k" for a in AXES)]
    offsets = [f"hall_offset_{a}_ut" for a in AXES]
    prior = _prior_of(p, *names, *offsets)
    for axis, letter in enumerate(AXES):
        for k in range(numbers.size):
            mean = float(np.median(field[axis, pose == k]))
            prior[f"pose {k} {letter}"] = mean, 0.2 * abs(mean) + 1000.0
    if bare is not None:
        prior |= {f"ambient {letter}": (0.0, AMBIENT_UT) for letter in AXES}

    def still(at: Parameters, letter: str, above: np.ndarray) -> np.ndarray:
        return at[f"hall_offset_{letter}_ut"] + at[f"hall_drift_{letter}_ut_per_k"] * above

    def residual(at: Parameters) -> list[np.ndarray]:
        gain = (1.0 + at["hall_gain_per_k"] * chip) * (1.0 + at["film_drift_per_k"] * film)
        out = []
        for axis, letter in enumerate(AXES):
            posed = np.array([at[f"pose {k} {letter}"] for k in range(numbers.size)])
            law = still(at, letter, chip) + gain * (posed[pose] if numbers.size else 0.0)
            out.append((field[axis] - law) * np.sqrt(blocks.size) / noise_ut)
        for axis, letter in enumerate(AXES if bare is not None else ""):
            above = _above(p, bare)
            law = still(at, letter, above)
            law = law + (1.0 + at["hall_gain_per_k"] * above) * at[f"ambient {letter}"]
            out.append((bare.values[BX + axis] - law) * np.sqrt(bare.size) / noise_ut)
        return out

    fit, kept = _settled(p, residual, prior)
    wanted = names + (offsets if bare is not None else [])
    fit = fit.of([name for name in wanted if name in fit.names])
    # part of the heat does not reach the film: its drift is known no better
    lost = HEAT_LOST * float(p["film_drift_per_k"]) * (np.array(fit.names) == names[0])
    kept = {name: why for name, why in kept.items() if name in wanted}
    return replace(fit, covariance=fit.covariance + np.diag(lost**2)), kept


def _above(p: Parameters, blocks: Blocks) -> np.ndarray:
    return blocks.values[CHIP] - float(p["hall_reference_c"])


def _offsets(p: Parameters) -> np.ndarray:
    """Offsets of the chip's axes, shape (3,)."""
    return np.array([float(p[f"hall_offset_{axis}_ut"]) for axis in AXES])


def at_reference(p: Parameters, blocks: Blocks, film_c: np.ndarray) -> np.ndarray:
    """Field as it would be at the reference temperatures, offsets included, shape (b, 3)."""
    chip, rest = _above(p, blocks), _offsets(p)[:, np.newaxis]
    gain = 1.0 + float(p["hall_gain_per_k"]) * chip
    gain = gain * (1.0 + float(p["film_drift_per_k"]) * (film_c - float(p["film_reference_c"])))
    drift = np.array([[float(p[f"hall_drift_{axis}_ut_per_k"])] for axis in AXES])
    return (rest + (blocks.values[BX : BX + 3] - rest - drift * chip) / gain).T


def robust_film(
    p: Parameters, blocks: Blocks, film_c: np.ndarray
) -> tuple[FilmFit, np.ndarray, np.ndarray]:
    """`fit_film` on blocks that are sheared.

    Returns
    -------
    film : FilmFit
    good : ndarray, shape (b,), bool
        Blocks that it stands on; the others do not fit.
    field_ut : ndarray, shape (b, 3)
        At the reference temperatures, without offset of Bz.
    """
    _needed(blocks, "strokes and circles", blocks.displacement[2])
    field = at_reference(p, blocks, film_c)
    (x, y), depth = blocks.displacement[:2], blocks.displacement[2]
    length, direction = np.hypot(x, y), np.arctan2(y, x)
    sigma_ut = float(p["field_noise_ut"]) / float(np.sqrt(np.mean(blocks.size)))
    good = np.ones(len(blocks), bool)
    bz = np.append([0.0, 0.0], _offsets(p)[2])
    for _ in range(2):
        film = fit_film(
            field[good], depth[good], length[good], direction[good], offset_ut=tuple(_offsets(p)),
            sigma_ut=sigma_ut,
        )  # fmt: skip
        off = displaced(film.fit, field - bz, depth) - blocks.displacement[:2]
        kept = np.hypot(*off) <= OUTLIER * max(robust_sigma(off.ravel()), 1e-6)
        if (kept == good).all():
            break
        good = kept
    return film, good, field - bz


def widened(film: FilmFit, rest_ut: float) -> Fit:
    """A film's fit, with what no scan of a single film can determine in the sigma of its
    parameters.

    A tilt of the film turns some of its own Bz at rest sideways, which is taken for an offset; and
    what the model cannot follow of a film is the same in all readings, which no number of them
    averages out.
    """
    more = np.zeros(len(film.fit.names))
    for axis in "xy":
        more[film.fit.names.index(f"hall_offset_{axis}_ut")] = TILT_RAD * rest_ut
        more[film.fit.names.index(f"film_{axis}_mm")] = film.spread_mm
    return replace(film.fit, covariance=film.fit.covariance + np.diag(more**2))
