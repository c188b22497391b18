"""From the recordings of a unit to all of its parameters that they fix.

The order is that of decoding: gel, normal force, drifts, film, shear; what is fitted later stands
on what was fitted before. What a recording does not fix stays as the model has it, and is listed
(`UnitResult.kept`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from skin.calibrate.amplitude import fit_crest
from skin.calibrate.bench import laws
from skin.calibrate.bench.alone import alone, tared
from skin.calibrate.bench.posterior import KEPT, Posterior
from skin.calibrate.bench.relaxation import relaxed
from skin.calibrate.bench.result import UnitResult
from skin.calibrate.bench.series import Blocks, Series
from skin.calibrate.bench.spread import (
    depth_spread,
    fit_sigma,
    gel_unknown,
    misfit_sigma,
    normal_spread,
    rms,
    shear_spread,
)
from skin.calibrate.field_angle import angle_powers
from skin.calibrate.film import FilmFit, map_field
from skin.calibrate.gel import ORDERS
from skin.calibrate.read import as_fit
from skin.calibrate.spread import even_spread
from skin.calibrate.write import with_fits
from skin.decode.model import field_angle_ends
from skin.errors import ScanError
from skin.physics.force_law import force, normal_law, shear_law, stiffening
from skin.physics.least_squares import Fit
from topology import CHANNELS, Topology
from topology.gel import gel_share

__all__ = ["fit_unit"]

GEL, FREQUENCY = CHANNELS.index("gel"), CHANNELS.index("frequency")
LOADED = ("normal", "shear", "circles")
SHEARED = ("shear", "circles")
SLOW_S = 1.0
"""Block of what changes slowly: temperatures, and fields of poses that are held [assumed]."""
CURVED_MM = 1.2
"""Error of the displacement of a film that was bent after its calibration, over the displacement,
times the radius of the mount: 8 % across and 1.3 % along a cylinder of 20 mm, root mean square
[derived: films as sums of dipoles on an arc]."""
ROUNDS, DEPTHS = 20, 9
BEFORE_FOLD_RAD = np.pi / 64.0
"""How far before it folds a table ends, so that a topology's check sees it leave its range: the
step of its angles."""
MOST = 2500
"""Samples of film and shear: more would only average noise that is far below their misfit."""
NEAREST_MM = 0.2
"""Displacement from which the field has a direction that a film's fit can stand on: that of the
simulated bench's shortest stroke [assumed]."""
TOUCHED_MM = 0.02
"""Depth from which a face is held, and sheared with what presses it [assumed]."""


@dataclass
class _Work:
    """What is known so far of one unit."""

    p: dict[str, Any]
    fits: list[Fit] = field(default_factory=list)
    kept: dict[str, str] = field(default_factory=dict)
    left: dict[str, float] = field(default_factory=dict)
    goodness: dict[str, float] = field(default_factory=dict)
    spread: dict[str, float] = field(default_factory=dict)
    plots: dict[str, tuple[np.ndarray, ...]] = field(default_factory=dict)

    def attempt(self, law: str, stage: Callable[[], None]) -> None:
        """Run a stage; where the recording does not determine its law, say so and keep the
        model's."""
        try:
            stage()
        except ScanError as error:
            self.kept[law] = str(error)

    def take(self, posterior: Posterior) -> None:
        """Take what the data have fixed of these parameters."""
        known = [name for name, left in zip(posterior.fit.names, posterior.left, strict=True)
                if left <= KEPT]  # fmt: skip
        for name, left in zip(posterior.fit.names, posterior.left.tolist(), strict=True):
            self.left[name] = left
            if name not in known:
                self.kept[name] = f"the recordings leave {left:.0%} of its prior variance"
        fit = posterior.marginal(known).fit
        self.fits.append(fit)
        self.p |= dict(zip(fit.names, fit.values.tolist(), strict=True))

    def unused(self, why: str, *names: str) -> None:
        """Say of those of these parameters that were not fitted why they stay the model's."""
        known = {name for fit in self.fits for name in fit.names} | set(self.kept)
        self.kept |= dict.fromkeys([name for name in names if name not in known], why)


def fit_unit(
    topology: Topology, series: Series, unit: int, mount_radius_mm: float | None = None,
    bare: Series | None = None,
) -> UnitResult:  # fmt: skip
    """Fit one unit to its recording: its laws, and its relaxation where it was held.

    Parameters
    ----------
    topology : Topology
        Nominal parameters: the prior.
    series : Series
        A recording of this unit alone.
    unit : int
        Its index in the topology.
    mount_radius_mm : float, optional
        Of the cylinder that the unit is glued on afterwards; what its bend may change is part of
        `shear_sigma_relative` then, until an array in place measures the gain.
    bare : Series, optional
        A recording of its chip before it had a film.

    Raises
    ------
    ScanError
        The recording determines no law at all.
    """

    def fitted(recorded: Series) -> UnitResult:
        return _fit_laws(topology, recorded, unit, mount_radius_mm, bare)

    return relaxed(topology, series, unit, fitted)


def _fit_laws(
    topology: Topology, series: Series, unit: int, mount_radius_mm: float | None,
    bare: Series | None,
) -> UnitResult:  # fmt: skip
    """As of `fit_unit`, of an elastic unit."""
    work = _Work({name: values[..., unit] for name, values in topology.parameters.items()})
    measured = bool(np.isfinite(series.displacement).any())
    if not measured:
        series = replace(series, displacement=_decoded(topology, series, unit))
    blocks = series.blocks(topology, unit)
    if not len(blocks):
        raise ScanError("segments: must have counts of the unit; got none")
    work.attempt("gel", lambda: _gel(work, series.blocks(topology, unit, 0.0).thinned(2 * MOST)))
    touch = {"mm": 0.0}
    work.attempt("normal", lambda: _normal(work, blocks, measured, touch))
    gel_c = laws.gel_temperature(work.p, blocks)
    film_c = laws.low_pass(blocks.time_s, gel_c, float(work.p["film_lag_s"]))

    def film_of(some: Blocks) -> np.ndarray:
        return np.interp(some.time_s, blocks.time_s, film_c)

    heated = series.blocks(topology, unit, SLOW_S).of("heated-free", "heated-load")
    chip = bare and bare.blocks(topology, unit, SLOW_S).of("bare")
    if chip is not None and not len(chip):
        work.kept["bare"], chip = "must be a segment with counts of the unit; got none", None
    work.attempt("drift", lambda: work.take(laws.fit_drift(work.p, heated, film_of(heated), chip)))
    placed = _placed(blocks, touch["mm"])
    sheared = _held(placed.of(*SHEARED))
    sheared = sheared.where(np.hypot(*sheared.displacement[:2]) > NEAREST_MM).thinned(MOST)
    if measured:
        work.attempt("film", lambda: _film(work, sheared, film_of(sheared)))
    else:
        work.kept["film"] = "the reference has no displacement"
    # single cycles: a mean over the break of the law would round it
    cycles = _placed(series.blocks(topology, unit, 0.0).of("normal", *SHEARED), touch["mm"])
    work.attempt("shear", lambda: _shear(work, _held(cycles).thinned(MOST)))
    if not work.fits:
        raise ScanError(
            "recording: must determine a law at least; got none:\n"
            + "\n".join(f"  {law}: {why}" for law, why in work.kept.items())
        )
    work.goodness["lag_s"] = series.alignment.lag_s
    work.goodness["lag_sigma_s"] = series.alignment.lag_sigma_s
    work.goodness["drift_ppm"] = series.alignment.drift_ppm
    if mount_radius_mm is not None and "shear_sigma_relative" in work.spread:
        bent = CURVED_MM / mount_radius_mm
        work.spread["shear_sigma_relative"] = float(
            np.hypot(work.spread["shear_sigma_relative"], bent)
        )
    work.fits.append(as_fit({name: (value, np.nan) for name, value in work.spread.items()}, 0))
    if "film" in work.plots:
        work.fits.append(_end_of_table(topology, unit, work.fits))
    _recorded(work, placed, gel_c)
    return UnitResult(
        topology.unit_names[unit], tuple(work.fits), work.kept, work.left, work.goodness,
        work.plots, _ranges(placed, gel_c), series.hash,
    )  # fmt: skip


def _end_of_table(topology: Topology, unit: int, fits: list[Fit]) -> Fit:
    """Range of R(psi, H) that a decoder can use at all depths."""
    known = with_fits(alone(topology, unit), {topology.unit_names[unit]: tuple(fits)})
    table = known.parameters["field_angle_mm"][:, 0]
    most = float(known.parameters["field_angle_max_mm"][0])
    depth = np.linspace(0.0, float(topology.parameters["field_reference_mm"][unit]), DEPTHS)
    for _ in range(ROUNDS):
        known.parameters["field_angle_max_mm"] = np.array([most])
        angle, displacement = (float(end[0]) for end in field_angle_ends(known))
        if displacement >= most:
            break
        before = np.full(DEPTHS, max(angle - BEFORE_FOLD_RAD, 0.0))
        # the decoder looks deeper than the reference
        most = min(float((angle_powers(before, depth) @ table).min()), displacement)
    return as_fit({"field_angle_max_mm": (most, np.nan)}, 0)


def _placed(blocks: Blocks, touch_mm: float) -> Blocks:
    """Blocks whose depth begins at the touch."""
    x, y, z = blocks.displacement
    return replace(blocks, displacement=np.stack([x, y, np.maximum(z - touch_mm, 0.0)]))


def _held(blocks: Blocks) -> Blocks:
    """The blocks in which the face is pressed."""
    return blocks.where(np.nan_to_num(blocks.displacement[2]) > TOUCHED_MM)


def _decoded(topology: Topology, series: Series, unit: int) -> np.ndarray:
    """Displacement by the unit's own model, where the reference has none; shape (3, t)."""
    from skin.decode.decoder import Decoder

    decoder = Decoder(
        alone(tared(topology, series), unit),
        {"displacement"},
        dtype="float64",
        sweeps=0,
        ambient=False,
    )
    counts = np.ascontiguousarray(series.counts.counts[:, :, unit : unit + 1])
    return np.array(decoder(counts).displacement_mm[:, :, 0], float).T


def _gel(work: _Work, blocks: Blocks) -> None:
    posterior, order = laws.fit_gel(work.p, blocks)
    work.take(posterior)
    fit = posterior.fit
    if order < max(ORDERS):
        work.unused("no better by cross-validation", *ORDERS[max(ORDERS)])
    kelvin = 60.0 / np.log(work.p["gel_current_ratio"])
    law = work.p["gel_current_20c_ua"] * gel_share(work.p, blocks.temperature)
    current = blocks.values[GEL]
    error = laws.gel_temperature(work.p, blocks) - blocks.temperature
    seen = np.isfinite(error)
    work.goodness["temperature_rms_c"] = rms(error[seen])
    misfit_c = even_spread(error[seen], kelvin * float(work.p["gel_noise_relative"]))
    unknown = gel_unknown(work.p, fit, current[seen])
    work.spread["temperature_sigma_c"] = float(np.hypot(unknown, misfit_c))
    work.plots["temperature"] = blocks.temperature[seen], current[seen], law[seen]


def _normal(work: _Work, blocks: Blocks, measured: bool, touch: dict[str, float]) -> None:
    posterior = laws.fit_normal(work.p, blocks.of("tare", *LOADED), measured)
    fit = posterior.fit
    if measured:
        touch["mm"] = work.goodness["touch_mm"] = fit["touch_mm"]
    names = [name for name in fit.names if name not in ("touch_mm", "turn_x", "turn_y")]
    work.take(posterior.marginal(names))
    work.unused("the best law would soften", laws.NORMAL_CUBE)
    slope = float(work.p["frequency_slope_hz_per_mm"])
    seen = blocks.of("normal", "circles")
    seen = seen.where(np.isfinite(seen.displacement[2]))
    fall = slope * np.maximum(seen.displacement[2] - touch["mm"], 0.0)
    law = force(fall, normal_law(work.p))
    tilt = fit["turn_x"] * np.nan_to_num(seen.force[1])
    tilt = tilt - fit["turn_y"] * np.nan_to_num(seen.force[0])
    felt = np.isfinite(seen.force[2])
    borne, law = (seen.force[2] - tilt)[felt], law[felt]
    if law.size:
        error = borne - law
        work.goodness["normal_rms_n"] = rms(error)
        unknown = fit_sigma(error, law, len(names))
        work.spread |= normal_spread(work.p, seen.values[FREQUENCY][felt], borne, unknown)
        work.spread["normal_max_n"] = float(np.nanmax(law))
        work.plots["normal"] = fall[felt], borne, law
    if measured:
        work.spread["depth_sigma_mm"] = depth_spread(work.p, seen.values[FREQUENCY], fall / slope)
    work.spread["frequency_sigma_hz"] = float(fit.sigma[fit.names.index("frequency_rest_hz")])


def _film(work: _Work, blocks: Blocks, film_c: np.ndarray) -> None:
    film, good, field_ut = laws.robust_film(work.p, blocks, film_c)
    depth, length = blocks.displacement[2][good], np.hypot(*blocks.displacement[:2])[good]
    noise = float(work.p["field_noise_ut"])
    x, y = laws.displaced(film.fit, field_ut, blocks.displacement[2])
    lateral = _along(film, field_ut[good], blocks.displacement[:2, good])
    displacement = np.hypot(blocks.displacement[0] + film.fit["film_x_mm"],
                     blocks.displacement[1] + film.fit["film_y_mm"])[good]  # fmt: skip
    block_ut = noise / float(np.sqrt(np.mean(blocks.size)))
    crest = fit_crest(lateral, depth, displacement, float(work.p["field_reference_mm"]), block_ut)
    rest = work.p["field_vertical_ratio"] * crest["field_amplitude_ut"] * np.exp(
        -crest["field_growth_per_mm"] * float(work.p["field_reference_mm"]))  # fmt: skip
    _take_film(work, laws.widened(film, float(rest)), crest)
    work.spread |= {
        "field_sigma_ut": float(np.max(film.fit.sigma[4:6])),
        "field_angle_sigma_mm": film.sigma_mm,
        "field_amplitude_sigma_relative": misfit_sigma(crest, block_ut) / max(rms(lateral), 1e-9),
        **{f"field_angle_variance_relative[{i}]": s for i, s in enumerate(film.shape)},
    }
    error = np.concatenate([x - blocks.displacement[0], y - blocks.displacement[1]])
    work.goodness["displacement_rms_mm"] = rms(error)
    work.goodness["blocks_left_out"] = float(np.sum(~good))
    work.plots["film"] = length, length, np.hypot(x, y)[good]


def _along(film: FilmFit, field_ut: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Lateral field along the displacement, shape (b,)."""
    x, y = map_field(field_ut, film.fit)
    way = place + np.array([film.fit["film_x_mm"], film.fit["film_y_mm"]])[:, np.newaxis]
    return (x * way[0] + y * way[1]) / np.maximum(np.hypot(*way), 1e-9)


def _take_film(work: _Work, film: Fit, crest: Fit) -> None:
    """The film's fits have no prior: all that they say is the data's."""
    for fit in (film, crest):
        work.fits.append(fit)
        for name, value, sigma in zip(fit.names, fit.values, fit.sigma, strict=True):
            if name in laws.PRIOR:
                work.left[name] = float(sigma / laws.PRIOR[name][1]) ** 2
                work.p[name] = float(value)


def _shear(work: _Work, blocks: Blocks) -> None:
    slope = float(work.p["frequency_slope_hz_per_mm"])
    normal_n = force(slope * blocks.displacement[2], normal_law(work.p))
    posterior, deeper = laws.fit_shear(work.p, blocks, normal_n)
    fit = posterior.fit
    names = [name for name in fit.names if not name.startswith("turn")]
    work.take(posterior.marginal(names))
    for axis in "xyz":
        work.goodness[f"sensor_turn_{axis}_deg"] = float(np.degrees(fit[f"turn_{axis}"]))
    work.unused("the best law would soften", laws.SHEAR_CUBE)
    if not deeper:
        work.unused("no better by cross-validation", "shear_gain_per_mm")
    x, y, depth = blocks.displacement
    displacement = np.hypot(x, y)
    along = np.stack([x, y]) / np.maximum(displacement, 1e-9)
    p = work.p
    law = force(displacement, shear_law(p))
    law = law * stiffening(depth, float(p["shear_gain_per_mm"]), float(p["field_reference_mm"]))
    tilt = np.stack([fit["turn_y"] * normal_n, -fit["turn_x"] * normal_n])
    sideways = blocks.force[:2] - tilt
    seen = np.isfinite(sideways).all(axis=0)
    push = (sideways * along).sum(axis=0)
    error = (push - law)[seen]
    work.goodness["shear_rms_n"] = rms(error)
    unknown = fit_sigma(error, law[seen], len(names))
    work.spread |= shear_spread(work.p, error, law[seen], displacement[seen], unknown)
    work.plots["shear"] = displacement[seen], push[seen], law[seen]


def _recorded(work: _Work, blocks: Blocks, gel_c: np.ndarray) -> None:
    """What the report draws of the recording itself."""
    work.plots["coverage"] = tuple(blocks.displacement)
    slope, rest = (float(work.p[name]) for name in
                   ("frequency_slope_hz_per_mm", "frequency_rest_hz"))  # fmt: skip
    pressed = blocks.of("normal")
    fall = rest - pressed.values[FREQUENCY]
    work.plots["hysteresis"] = fall / slope, pressed.force[2], force(fall, normal_law(work.p))
    work.plots["warming"] = blocks.time_s, gel_c, blocks.temperature


def _ranges(blocks: Blocks, gel_c: np.ndarray) -> dict[str, tuple[float, float]]:
    rows = {
        "depth_mm": blocks.displacement[2], "displacement_mm": np.hypot(*blocks.displacement[:2]),
        "normal_n": blocks.force[2], "tangential_n": np.hypot(*blocks.force[:2]),
        "temperature_c": gel_c,
    }  # fmt: skip
    return {name: (float(np.nanmin(v)), float(np.nanmax(v)))
            for name, v in rows.items() if np.isfinite(v).any()}  # fmt: skip
