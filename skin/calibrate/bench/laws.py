"""The laws of one unit, each fitted to blocks of its recording: gel, normal, drift, film, shear."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from skin.calibrate.bench.posterior import KEPT, Posterior, fit_posterior
from skin.calibrate.bench.series import AXES, Blocks
from skin.calibrate.cross_validation import cross_validated, folds_of
from skin.calibrate.field_angle import ANGLE_NAMES, angle_powers
from skin.calibrate.film import FilmFit, fit_film, map_field
from skin.calibrate.gel import MARGIN, ORDERS, gel_misfit, rises
from skin.calibrate.learn import AMBIENT_UT
from skin.errors import ScanError
from skin.physics.force_law import force, normal_law, shear_law, stiffening
from skin.physics.least_squares import Fit, robust_sigma
from topology import CHANNELS
from topology.gel import gel_temperature as temperature_of

__all__ = ["NORMAL_CUBE", "PRIOR", "SHEAR_CUBE", "fit_drift", "fit_gel", "fit_normal", "fit_shear",
           "gel_temperature", "low_pass", "offsets",
           "prior_of", "robust_film", "widened"]  # fmt: skip

GEL, FREQUENCY, BX = (CHANNELS.index(name) for name in ("gel", "frequency", "bx"))
CHIP = CHANNELS.index("hall_temperature")
Parameters = dict[str, Any]

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
OUTLIER = 5.0
"""Sigmas beyond which a block is none of the film [assumed]."""
LEAST_BLOCKS = 30
NORMAL_CUBE, SHEAR_CUBE = "normal_cubic_n_per_hz3", "shear_cubic_n_per_mm3"
HEAT_LOST = 0.016
"""Of a change of the gel's temperature that does not reach the film, which is taken to follow it
whole: 1 - 0.974 / 0.99 of the 1-D heat model in long contact [assumed]."""
CHECKED = 600
"""Samples of a cross-validation [assumed: far fewer determine an order]."""
TILT_RAD = np.radians(1.0) / np.sqrt(3.0)
"""Tilt of a film, one sigma: evenly spread by 1° [assumed]."""
WARMED_K = 5.0
"""Change of temperature that determines a law of it [assumed]."""


def prior_of(p: Parameters, *names: str) -> dict[str, tuple[float, float]]:
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


def fit_gel(p: Parameters, blocks: Blocks) -> tuple[Posterior, int]:
    """Current at 20 °C, its ratio at 80 °C and, where they predict better, bend and twist of its
    law, from blocks whose temperature was measured; and the order of the law."""
    seen = _needed(blocks, "temperature of the reference", blocks.temperature)
    current = seen.values[GEL]
    if not (current > 0.0).all():
        raise ScanError(f"gel current: must be above 0; got {current.min():.4g} µA")
    sigma = float(p["gel_noise_relative"]) / np.sqrt(seen.size)

    def misfit(at: Parameters) -> np.ndarray:
        return gel_misfit({**p, **at}, current, seen.temperature) / sigma

    def fitted(order: int, chosen: np.ndarray) -> Posterior:
        return fit_posterior(lambda at: [misfit(at)[chosen]], prior_of(p, *ORDERS[order]))

    few = np.arange(len(seen)) % max(len(seen) // CHECKED, 1) == 0

    def error(order: int, training: np.ndarray) -> np.ndarray:
        fit = fitted(order, training & few).fit
        return misfit(dict(zip(fit.names, fit.values, strict=True)))[~training & few] ** 2

    order, _ = cross_validated(tuple(ORDERS), folds_of(len(seen)), error, MARGIN)
    found = fitted(order, np.ones(len(seen), bool))
    while order > 1 and not rises(
        {**p, **dict(zip(found.fit.names, found.fit.values, strict=True))}
    ):
        order -= 1
        found = fitted(order, np.ones(len(seen), bool))
    return found, order


def gel_temperature(p: Parameters, blocks: Blocks) -> np.ndarray:
    """Temperature by the gel's law, °C, shape (b,)."""
    return temperature_of(p, np.maximum(blocks.values[GEL], 1e-9) / p["gel_current_20c_ua"])


def _fit_law(
    residual: Callable[[Parameters], Sequence[np.ndarray]], prior: dict[str, tuple[float, float]],
    over: Sequence[np.ndarray | None], cube: str,
) -> Posterior:  # fmt: skip
    """`fit_posterior` of a law with a cube; what the data do not determine, or a cube below 0,
    stays the model's, and the others are fitted with it there."""
    found = fit_posterior(residual, prior, over)
    left = dict(zip(found.fit.names, found.left.tolist(), strict=True))
    unknown = {name: share for name, share in left.items()
              if share > KEPT and not name.startswith("turn_")}  # fmt: skip
    softens = found.fit[cube] < 0.0
    if not unknown and not softens:
        return found
    fixed = {cube, *unknown} if softens else set(unknown)
    others = {name: known for name, known in prior.items() if name not in fixed}
    again = fit_posterior(residual, others, over)
    return again.joined({name: (*prior[name], share) for name, share in unknown.items()})


def _cubic_prior(p: Parameters, law: str) -> dict[str, tuple[float, float]]:
    """Of the cube of a law: none, and one sigma twice the slope at the end of the range."""
    if law == "normal":
        soft, knee, stiffer, *_ = normal_law(p)
        end, name = knee + (p["normal_max_n"] - soft * knee) / (soft + stiffer), NORMAL_CUBE
    else:
        soft, knee, stiffer, *_ = shear_law(p)
        end, name = p["tangential_max_mm"], SHEAR_CUBE
    beyond = max(float(end - knee), 0.1 * float(end))
    return {name: (float(p[name]), float(soft + stiffer) / (3.0 * beyond**2))}


def fit_normal(p: Parameters, blocks: Blocks, measured: bool) -> Posterior:
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
    Posterior
        Of parameters of `UnitModel`, of ``touch_mm``, ``turn_x`` and ``turn_y``; without that of
        the cube where the best law would soften.
    """
    seen = _needed(blocks, "depth of press", blocks.displacement[2])
    frequency, way, push = seen.values[FREQUENCY], seen.displacement[2], seen.force[2]
    has_force = np.isfinite(push)
    sigma_hz = float(p["frequency_noise_hz"]) / np.sqrt(seen.size)
    sigma_n = 0.005 / np.sqrt(seen.size[has_force])
    names = ["frequency_rest_hz", "normal_soft_n_per_hz", "normal_break_hz",
             "normal_stiff_n_per_hz"]  # fmt: skip
    prior = prior_of(p, *names) | _cubic_prior(p, "normal")
    if measured:
        prior |= prior_of(p, "frequency_slope_hz_per_mm") | {"touch_mm": (0.0, TOUCH_MM)}
    # a turned sensor shows some of what is tangential as normal
    prior |= {"turn_x": (0.0, TURN_RAD), "turn_y": (0.0, TURN_RAD)}
    sideways = np.nan_to_num(seen.force[:2])

    def residual(at: Parameters) -> list[np.ndarray]:
        now = {"touch_mm": 0.0, **p, **at}
        fall = now["frequency_slope_hz_per_mm"] * np.maximum(way - now["touch_mm"], 0.0)
        law = force(fall, normal_law(now))
        law = law + at["turn_x"] * sideways[1] - at["turn_y"] * sideways[0]
        return [
            (frequency - now["frequency_rest_hz"] + fall) / sigma_hz,
            (push - law)[has_force] / sigma_n,
        ]

    return _fit_law(residual, prior, (way, way[has_force]), NORMAL_CUBE)


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
) -> Posterior:
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
    field = blocks.values[BX : BX + 3]
    chip = blocks.values[CHIP] - float(p["hall_reference_c"])
    film = film_c - float(p["film_reference_c"])
    sigma = float(p["field_noise_ut"]) / np.sqrt(blocks.size)
    numbers, pose = np.unique(blocks.segment, return_inverse=True)
    names = ["film_drift_per_k", "hall_gain_per_k", *(f"hall_drift_{a}_ut_per_k" for a in AXES)]
    offset = [f"hall_offset_{a}_ut" for a in AXES]
    prior = prior_of(p, *names, *offset)
    for axis, letter in enumerate(AXES):
        for k in range(numbers.size):
            mean = float(np.median(field[axis, pose == k]))
            prior[f"pose {k} {letter}"] = mean, 0.2 * abs(mean) + 1000.0

    def alone(at: Parameters) -> list[np.ndarray]:
        if bare is None:
            return []
        above = bare.values[CHIP] - float(p["hall_reference_c"])
        gain, noise = 1.0 + at["hall_gain_per_k"] * above, float(p["field_noise_ut"])
        return [
            (bare.values[BX + axis] - at[f"hall_offset_{letter}_ut"]
             - at[f"hall_drift_{letter}_ut_per_k"] * above - gain * at[f"ambient {letter}"])
            / (noise / np.sqrt(bare.size))
            for axis, letter in enumerate(AXES)
        ]  # fmt: skip

    def residual(at: Parameters) -> list[np.ndarray]:
        gain = (1.0 + at["hall_gain_per_k"] * chip) * (1.0 + at["film_drift_per_k"] * film)
        return [
            (field[axis] - at[f"hall_offset_{letter}_ut"]
             - at[f"hall_drift_{letter}_ut_per_k"] * chip
             - gain * np.array([at[f"pose {k} {letter}"] for k in range(numbers.size)])[pose])
            / sigma
            for axis, letter in enumerate(AXES)
        ]  # fmt: skip

    if bare is not None:
        prior |= {f"ambient {letter}": (0.0, AMBIENT_UT) for letter in AXES}
        names += offset
    found = fit_posterior(lambda at: residual(at) + alone(at), prior).marginal(names)
    more = np.zeros(len(names))
    more[0] = (HEAT_LOST * float(p["film_drift_per_k"])) ** 2
    covariance = found.fit.covariance + np.diag(more)
    return replace(found, fit=replace(found.fit, covariance=covariance))


def offsets(p: Parameters) -> np.ndarray:
    """Offsets of the chip's axes, shape (3,)."""
    return np.array([float(p[f"hall_offset_{axis}_ut"]) for axis in AXES])


def at_reference(p: Parameters, blocks: Blocks, film_c: np.ndarray) -> np.ndarray:
    """Field as it would be at the reference temperatures, offsets included, shape (b, 3)."""
    chip = blocks.values[CHIP] - float(p["hall_reference_c"])
    gain = 1.0 + float(p["hall_gain_per_k"]) * chip
    gain = gain * (1.0 + float(p["film_drift_per_k"]) * (film_c - float(p["film_reference_c"])))
    drift = np.array([float(p[f"hall_drift_{axis}_ut_per_k"]) for axis in AXES])
    rest = offsets(p)[:, np.newaxis]
    field = blocks.values[BX : BX + 3] - rest - drift[:, np.newaxis] * chip
    return (rest + field / gain).T


def robust_film(
    p: Parameters, blocks: Blocks, film_c: np.ndarray
) -> tuple[FilmFit, np.ndarray, np.ndarray]:
    """`fit_film` on blocks that are sheared, without those that do not fit.

    Returns
    -------
    film : FilmFit
    good : ndarray, shape (b,), bool
        Blocks that it stands on.
    field_ut : ndarray, shape (b, 3)
        At the reference temperatures.
    """
    _needed(blocks, "strokes and circles", blocks.displacement[2])
    field = at_reference(p, blocks, film_c)
    depth, x, y = blocks.displacement[2], *blocks.displacement[:2]
    length, direction = np.hypot(x, y), np.arctan2(y, x)
    reading = float(p["field_noise_ut"])
    good = np.ones(len(blocks), bool)
    film = None
    for _ in range(2):
        film = fit_film(
            field[good], depth[good], length[good], direction[good], offset_ut=tuple(offsets(p)),
            sigma_ut=reading / float(np.sqrt(np.mean(blocks.size))), reading_ut=reading,
        )  # fmt: skip
        error = np.stack(displaced(film.fit, field, depth)) - np.stack([x, y])
        size = np.hypot(*error)
        kept = size <= OUTLIER * max(robust_sigma(error.ravel()), 1e-6)
        if (kept == good).all():
            break
        good = kept
    assert film is not None
    return film, good, field


def widened(film: FilmFit, rest_ut: float) -> Fit:
    """A film's fit, with what no scan of a single film can determine in the sigma of its
    parameters.

    A tilt of the film turns some of its own Bz sideways, which is taken for an offset; and what the
    model cannot follow of a film is the same in all readings, which no number of them averages out.

    Parameters
    ----------
    film : FilmFit
    rest_ut : float
        Bz at rest.
    """
    more = np.zeros(len(film.fit.names))
    for axis in "xy":
        more[film.fit.names.index(f"hall_offset_{axis}_ut")] = (TILT_RAD * rest_ut) ** 2
        more[film.fit.names.index(f"film_{axis}_mm")] = film.spread_mm**2
    return replace(film.fit, covariance=film.fit.covariance + np.diag(more))


def displaced(film: Fit, field_ut: np.ndarray, depth_mm: np.ndarray) -> list[np.ndarray]:
    """Tangential displacement x, y by a film's fit, mm, each shape (b,)."""
    lateral = map_field(field_ut, film)
    size = np.maximum(np.hypot(*lateral), 1e-9)
    table = np.array([film[name] for name in ANGLE_NAMES])
    displacement = angle_powers(np.arctan2(size, field_ut[:, 2]), depth_mm) @ table
    return [lateral[0] / size * displacement - film["film_x_mm"],
            lateral[1] / size * displacement - film["film_y_mm"]]  # fmt: skip


def fit_shear(p: Parameters, blocks: Blocks, normal_n: np.ndarray) -> tuple[Posterior, bool]:
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
    posterior : Posterior
        Of parameters of `UnitModel`, and ``turn_x``, ``turn_y``, ``turn_z`` in rad; without that of
        the cube where the best law would soften.
    deeper : bool
        Whether the law grows with depth, by cross-validation.
    """
    seen = _needed(blocks, "force_x, force_y of the reference", *blocks.force[:2])
    whole = np.isfinite(blocks.force[:2]).all(axis=0)
    normal_n = normal_n[whole]
    (x, y, depth), push = seen.displacement, seen.force[:2]
    radius = np.hypot(x, y)
    along = np.stack([x, y]) / np.maximum(radius, 1e-9)
    reference_mm = float(p["field_reference_mm"])
    sigma = 0.005 / np.sqrt(seen.size)
    names = ("shear_soft_n_per_mm", "shear_break_mm", "shear_stiff_n_per_mm")
    turns = {f"turn_{axis}": (0.0, TURN_RAD) for axis in AXES}

    def misfit(at: Parameters) -> np.ndarray:
        grown = stiffening(depth, at.get("shear_gain_per_mm", 0.0), reference_mm)
        fx, fy = force(radius, shear_law({**p, **at})) * grown * along
        seen_x = fx + at["turn_y"] * normal_n - at["turn_z"] * fy
        seen_y = fy + at["turn_z"] * fx - at["turn_x"] * normal_n
        x, y = (push - np.stack([seen_x, seen_y])) / sigma
        # along the displacement, which the law is of, and across it
        return np.stack([x * along[0] + y * along[1], y * along[0] - x * along[1]])

    def fitted(order: bool, chosen: np.ndarray) -> Posterior:
        prior = prior_of(p, *names, *(("shear_gain_per_mm",) if order else ()))
        prior |= _cubic_prior(p, "shear") | turns
        over = radius[chosen], None
        return _fit_law(lambda at: list(misfit(at)[:, chosen]), prior, over, SHEAR_CUBE)

    few = np.arange(len(seen)) % max(len(seen) // CHECKED, 1) == 0

    def error(order: bool, training: np.ndarray) -> np.ndarray:
        fit = fitted(order, training & few).fit
        return misfit(dict(zip(fit.names, fit.values, strict=True)))[:, ~training & few] ** 2

    order, _ = cross_validated((False, True), folds_of(len(seen)), error)
    return fitted(order, np.ones(len(seen), bool)), order
