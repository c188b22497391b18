"""From the recordings of a unit to all of its parameters that they fix.

The order is that of decoding: gel, normal force, drifts, film, shear; what is fitted later stands
on what was fitted before. What a recording does not fix stays as the model has it, and is listed
(`UnitResult.kept`).

Faces that move bear more than those that are held, and so do the laws that are fitted to them. What
a step bears beyond its elastic force is determined by the holds, but for a factor, the gain of
`skin.calibrate.creep`. Taken off all forces of the recording, it leaves those that the elastic laws
are of: they are fitted once more, which is how the gain comes into them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.ndimage import morphological_gradient

from bus.status import INVALID
from skin.calibrate import laws
from skin.calibrate.bench.file import KINDS
from skin.calibrate.bench.series import Blocks, Series, alone, decoded, tared
from skin.calibrate.creep import CreepFit, fit_creep, unrelaxed
from skin.calibrate.files import with_fits
from skin.calibrate.film import angle_powers, displaced, fit_crest, map_field, misfit_sigma
from skin.calibrate.fit import Fit, as_fit, even_spread, law_spread, rms
from skin.decode.model import field_angle_ends
from skin.errors import ScanError
from skin.physics.elastic import Elastic
from skin.physics.force_law import STIFFNESSES, force, normal_law
from topology import CHANNELS, Topology
from topology.gel import gel_share

__all__ = ["UnitResult", "fit_unit"]

GEL, FREQUENCY = CHANNELS.index("gel"), CHANNELS.index("frequency")
SHEARED = ("shear", "circles")
SLOW_S = 1.0
"""Block of what changes slowly: temperatures, and fields of poses that are held [assumed]."""
CURVED_MM = 1.2
"""Error of the displacement of a film that was bent after its calibration, over the displacement,
times the radius of the mount: 8 % across and 1.3 % along a cylinder of 20 mm, root mean square
[derived: films as sums of dipoles on an arc]."""
SHORTEST = 0.5
"""Least share of the scan's displacements over which the angle must grow [assumed]."""
DEPTHS, BEFORE_FOLD_RAD = 9, np.pi / 64.0
"""Depths, and how far before it folds a table ends, so that a topology's check sees it leave its
range: the step of its angles."""
MOST = 2500
"""Samples of film and shear: more would only average noise that is far below their misfit."""
NEAREST_MM = 0.2
"""Displacement from which the field has a direction that a film's fit can stand on: that of the
simulated bench's shortest stroke [assumed]."""
TOUCHED_MM = 0.02
"""Depth from which a face is held, and sheared with what presses it [assumed]."""
HOLD_S, LATER = 0.05, 10
"""Block of a hold, two in the time of the fastest term; of those that are not near a step, one of
so many is looked at [derived]."""
QUICK_S = 4.0
"""From a step, within which all blocks are looked at [assumed]."""
MOVED_SHARE = 0.1
"""Of the range of the force: more is a step [assumed: more than relaxes in that time]."""
PARTED_N = 0.05
"""Normal force below which a stage that goes back may have left the face behind: ten sigma of a
force cell [assumed]."""
ROUNDS = 2
"""Elastic laws and terms by turns: each is off by the other's error, which is some per cent."""
AXES_OF = {"normal": (2,), "shear": (0, 1)}
"""Components of the force that a law is of."""


@dataclass
class UnitResult:
    """What was found of one unit.

    Attributes
    ----------
    unit : str
    p : dict of str to float
        Its parameters, as far as they are known.
    fits : list of Fit
        Of parameters of `UnitModel`, in the order of decoding.
    kept : dict of str to str
        Parameters, or laws, that stay as the model has them, and why.
    left : dict of str to float
        Variance of each parameter over that of its prior.
    goodness : dict of str to float
        Residuals of each law, root mean square; sensor's turn, touch, lag.
    plots : dict of str to tuple of ndarray
        What the report draws: for each law x, measured, fitted.
    range : dict of str to tuple of float
        Lowest and highest value that was recorded.
    hash : str
        SHA-256 of the files.
    """

    unit: str
    p: dict[str, Any] = field(default_factory=dict)
    fits: list[Fit] = field(default_factory=list)
    kept: dict[str, str] = field(default_factory=dict)
    left: dict[str, float] = field(default_factory=dict)
    goodness: dict[str, float] = field(default_factory=dict)
    plots: dict[str, tuple[np.ndarray, ...]] = field(default_factory=dict)
    range: dict[str, tuple[float, float]] = field(default_factory=dict)
    hash: str = ""

    def attempt(self, law: str, stage: Callable[[], None]) -> None:
        """Run a stage; where the recording does not determine its law, say so and keep the
        model's."""
        try:
            stage()
        except ScanError as error:
            self.kept[law] = str(error)

    def take(self, fit: Fit, kept: dict[str, str]) -> None:
        """Take what the data have fixed of the unit's parameters."""
        own = fit.of([name for name in fit.names if name in self.p or "[" in name])
        self.fits.append(own)
        self.kept |= kept
        self.left |= dict(zip(own.names, own.left.tolist(), strict=True))
        self.p |= dict(zip(own.names, own.values.tolist(), strict=True))

    def say(self, **values: float) -> None:
        """Take what is known of parameters, without a sigma of its own."""
        self.fits.append(as_fit({name: (value, np.nan) for name, value in values.items()}))
        self.p |= values

    def draw(self, name: str, *arrays: np.ndarray) -> None:
        """Have arrays drawn, of like length, where all are finite."""
        seen = np.isfinite(np.stack(arrays)).all(axis=0)
        self.plots[name] = tuple(each[seen] for each in arrays)


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

    result = fitted(series)
    try:
        found = _relaxation(topology, series, result)
    except ScanError as error:
        result.kept["creep"] = str(error)
        return result
    if any(fit.weights.any() for fit in found.fits.values()):
        loaded = np.isin(series.kind, [KINDS.index(k) for k in ("normal", *SHEARED)])
        parted = loaded & ~(series.force[2] > PARTED_N)
        whole = replace(series, segment=np.where(parted, -1, series.segment))
        for _ in range(ROUNDS):
            result = fitted(replace(whole, force=series.force - found.over_n))
            found = _relaxation(topology, series, result)
    _take_relaxation(result, found)
    return result


def _fit_laws(
    topology: Topology, series: Series, unit: int, mount_radius_mm: float | None,
    bare: Series | None,
) -> UnitResult:  # fmt: skip
    """As of `fit_unit`, of an elastic unit."""
    p = {name: values[..., unit] for name, values in topology.parameters.items()}
    work = UnitResult(topology.unit_names[unit], p, hash=series.hash)
    measured = bool(np.isfinite(series.displacement).any())
    if not measured:
        model = decoded(tared(topology, series), series, unit)
        series = replace(series, displacement=np.array(model.displacement_mm[:, :, 0], float).T)
    blocks = series.blocks(topology, unit)
    if not len(blocks):
        raise ScanError("segments: must have counts of the unit; got none")
    work.attempt("gel", lambda: _gel(work, series.blocks(topology, unit, 0.0).thinned(2 * MOST)))
    work.attempt("normal", lambda: _normal(work, blocks, measured))
    touch_mm = work.goodness.get("touch_mm", 0.0)
    gel_c = laws.temperature_of(work.p, blocks)
    film_c = laws.low_pass(blocks.time_s, gel_c, float(work.p["film_lag_s"]))

    def film_of(some: Blocks) -> np.ndarray:
        return np.interp(some.time_s, blocks.time_s, film_c)

    heated = series.blocks(topology, unit, SLOW_S).of("heated-free", "heated-load")
    chip = bare and bare.blocks(topology, unit, SLOW_S).of("bare")
    if chip is not None and not len(chip):
        work.kept["bare"], chip = "must be a segment with counts of the unit; got none", None
    work.attempt("drift", lambda: work.take(*laws.fit_drift(work.p, heated, film_of(heated), chip)))
    placed = _placed(blocks, touch_mm)
    far = _held(placed.of(*SHEARED))
    far = far.where(np.hypot(*far.displacement[:2]) > NEAREST_MM).thinned(MOST)
    if measured:
        work.attempt("film", lambda: _film(work, far, film_of(far), alone(topology, unit)))
    else:
        work.kept["film"] = "the reference has no displacement"
    # single cycles: a mean over the break of the law would round it
    cycles = _placed(series.blocks(topology, unit, 0.0).of("normal", *SHEARED), touch_mm)
    work.attempt("shear", lambda: _shear(work, _held(cycles).thinned(MOST), mount_radius_mm))
    if not work.fits:
        raise ScanError(
            "recording: must determine a law at least; got none:\n"
            + "\n".join(f"  {law}: {why}" for law, why in work.kept.items())
        )
    aligned = series.alignment
    work.goodness |= {"lag_s": aligned.lag_s, "lag_sigma_s": aligned.lag_sigma_s,
                      "drift_ppm": aligned.drift_ppm}  # fmt: skip
    pressed = placed.of("normal")
    work.plots["coverage"] = tuple(placed.displacement)
    fall = float(work.p["frequency_rest_hz"]) - pressed.values[FREQUENCY]
    depth = fall / float(work.p["frequency_slope_hz_per_mm"])
    work.draw("hysteresis", depth, pressed.force[2], force(fall, normal_law(work.p)))
    work.draw("warming", blocks.time_s, gel_c, blocks.temperature)
    rows = {
        "depth_mm": placed.displacement[2], "displacement_mm": np.hypot(*placed.displacement[:2]),
        "normal_n": placed.force[2], "tangential_n": np.hypot(*placed.force[:2]),
        "temperature_c": gel_c,
    }  # fmt: skip
    work.range = {name: (float(np.nanmin(row)), float(np.nanmax(row)))
                  for name, row in rows.items() if np.isfinite(row).any()}  # fmt: skip
    return work


def _placed(blocks: Blocks, touch_mm: float) -> Blocks:
    """Blocks whose depth begins at the touch."""
    x, y, z = blocks.displacement
    return replace(blocks, displacement=np.stack([x, y, np.maximum(z - touch_mm, 0.0)]))


def _held(blocks: Blocks) -> Blocks:
    """The blocks in which the face is pressed."""
    return blocks.where(np.nan_to_num(blocks.displacement[2]) > TOUCHED_MM)


# -- law by law -----------------------------------------------------------------------------------


def _gel(work: UnitResult, blocks: Blocks) -> None:
    work.take(*laws.fit_gel(work.p, blocks))
    seen = blocks.where(np.isfinite(blocks.temperature))
    error = laws.temperature_of(work.p, seen) - seen.temperature
    work.goodness["temperature_rms_c"] = rms(error)
    unknown = work.fits[-1].unknown(lambda at: laws.temperature_of(work.p | at, seen))
    work.say(temperature_sigma_c=float(np.hypot(even_spread(error), unknown)))
    law = work.p["gel_current_20c_ua"] * gel_share(work.p, seen.temperature)
    work.draw("temperature", seen.temperature, seen.values[GEL], law)


def _normal(work: UnitResult, blocks: Blocks, measured: bool) -> None:
    fit, kept = laws.fit_normal(work.p, blocks.of("tare", "normal", *SHEARED), measured)
    work.take(fit, kept)
    touch_mm = fit["touch_mm"] if measured else 0.0
    if measured:
        work.goodness["touch_mm"] = touch_mm
    p = work.p
    slope, rest_hz = (float(p[f"frequency_{name}"]) for name in ("slope_hz_per_mm", "rest_hz"))
    seen = blocks.of("normal", "circles")
    seen = seen.where(np.isfinite(seen.displacement[2]))
    depth, fall = np.maximum(seen.displacement[2] - touch_mm, 0.0), rest_hz - seen.values[FREQUENCY]
    felt = np.isfinite(seen.force[2])
    if felt.any():
        x, y, z = seen.force[:, felt]
        tilt = fit["turn_x"] * np.nan_to_num(y) - fit["turn_y"] * np.nan_to_num(x)
        at_depth, law = (force(each[felt], normal_law(p)) for each in (slope * depth, fall))
        error = z - tilt - at_depth
        work.goodness["normal_rms_n"] = rms(error)
        # a decoder has the force from the frequency
        spread = law_spread(law - (z - tilt), law)
        unknown = work.fits[-1].unknown(lambda at: force(fall[felt], normal_law(p | at))) / rms(law)
        work.say(
            normal_sigma_relative=float(np.hypot(spread.relative, unknown)),
            normal_sigma_n=spread.absolute, normal_max_n=float(at_depth.max()),
        )  # fmt: skip
        work.draw("normal", slope * depth[felt], z - tilt, at_depth)
    if measured:
        work.say(depth_sigma_mm=even_spread((fall / slope - depth)[depth > 0.0]))
    if "frequency_rest_hz" in fit.names:
        sigma_hz = fit.sigma[fit.names.index("frequency_rest_hz")]
        work.say(frequency_sigma_hz=float(sigma_hz))


def _film(work: UnitResult, blocks: Blocks, film_c: np.ndarray, one: Topology) -> None:
    film, good, field_ut = laws.robust_film(work.p, blocks, film_c)
    seen, field_ut = blocks.where(good), field_ut[good]
    depth, place = seen.displacement[2], seen.displacement[:2]
    centre = np.array([[film.fit["film_x_mm"]], [film.fit["film_y_mm"]]])
    way, far_mm = place + centre, np.hypot(*(place + centre))
    lateral = np.sum(map_field(field_ut, film.fit) * way, axis=0) / np.maximum(far_mm, 1e-9)
    block_ut = float(work.p["field_noise_ut"]) / float(np.sqrt(np.mean(blocks.size)))
    reference_mm = float(work.p["field_reference_mm"])
    crest = fit_crest(lateral, depth, far_mm, reference_mm, block_ut)
    rest_ut = work.p["field_vertical_ratio"] * crest["field_amplitude_ut"] * np.exp(
        -crest["field_growth_per_mm"] * reference_mm)  # fmt: skip
    known = {name: np.asarray(work.p[name], float)[..., np.newaxis] for name in one.parameters}
    end = _end_of_table(replace(one, parameters=known), film.fit, float(np.hypot(*place).max()))
    for fit in (laws.widened(film, float(rest_ut)), crest):
        work.take(fit, {})
    # these fits have no prior of the model: all that they say is the data's
    for axis in "xy":
        name = f"hall_offset_{axis}_ut"
        sigma_ut = work.fits[-2].sigma[film.fit.names.index(name)]
        work.left[name] = float(sigma_ut / laws.PRIOR[name][1]) ** 2
    work.say(
        field_sigma_ut=float(np.max(film.fit.sigma[4:6])), field_angle_sigma_mm=film.sigma_mm,
        field_amplitude_sigma_relative=misfit_sigma(crest, block_ut) / max(rms(lateral), 1e-9),
        field_angle_max_mm=end,
        **{f"field_angle_variance_relative[{i}]": s for i, s in enumerate(film.shape.tolist())},
    )  # fmt: skip
    found = displaced(film.fit, field_ut, depth)
    work.goodness["displacement_rms_mm"] = rms((found - place).ravel())
    work.goodness["blocks_left_out"] = float(np.sum(~good))
    work.draw("film", np.hypot(*place), np.hypot(*place), np.hypot(*found))


def _end_of_table(one: Topology, film: Fit, longest_mm: float) -> float:
    """Displacement up to which a decoder can use R(psi, H) at all depths."""
    table = film.values[[film.names.index(f"field_angle_mm[{k}]") for k in range(16)]]
    depth = np.linspace(0.0, float(one.parameters["field_reference_mm"][0]), DEPTHS)
    most, before = longest_mm, np.inf
    while most < before:
        p = one.parameters | {"field_angle_mm": table[:, np.newaxis],
                              "field_angle_max_mm": np.array([most])}  # fmt: skip
        angle, end_mm = (float(end[0]) for end in field_angle_ends(replace(one, parameters=p)))
        before = most
        if end_mm < most:
            angles = np.full(DEPTHS, max(angle - BEFORE_FOLD_RAD, 0.0))
            # the decoder looks deeper than the reference
            most = min(float((angle_powers(angles, depth) @ table).min()), end_mm)
    if most < SHORTEST * longest_mm:
        raise ScanError(
            "field_ut: must have an angle that grows with displacement over the scan; got one that "
            f"ceases to grow at {most:.3g} mm"
        )
    return most


def _shear(work: UnitResult, blocks: Blocks, mount_radius_mm: float | None) -> None:
    p = work.p
    slope = float(p["frequency_slope_hz_per_mm"])
    normal_n = force(slope * blocks.displacement[2], normal_law(p))
    fit, kept = laws.fit_shear(p, blocks, normal_n)
    work.take(fit, kept)
    for axis in "xyz":
        work.goodness[f"sensor_turn_{axis}_deg"] = float(np.degrees(fit[f"turn_{axis}"]))
    sideways = blocks.force[:2] - np.stack([fit["turn_y"] * normal_n, -fit["turn_x"] * normal_n])
    seen = np.isfinite(sideways).all(axis=0)
    place, law = blocks.displacement[:, seen], laws.sheared(p, blocks.displacement[:, seen])
    radius = np.hypot(*place[:2])
    push = np.sum(sideways[:, seen] * place[:2], axis=0) / np.maximum(radius, 1e-9)
    work.goodness["shear_rms_n"] = rms(push - law)
    spread = law_spread(push - law, law)
    unknown = work.fits[-1].unknown(lambda at: laws.sheared(p | at, place)) / max(rms(law), 1e-9)
    bent = 0.0 if mount_radius_mm is None else CURVED_MM / mount_radius_mm
    work.say(shear_sigma_relative=float(np.sqrt(spread.relative**2 + unknown**2 + bent**2)),
             shear_sigma_n=spread.absolute)  # fmt: skip
    work.draw("shear", radius, push, law)


# -- relaxation -----------------------------------------------------------------------------------


@dataclass
class _Relaxation:
    """Terms of each law that was held, and why there are none of others; what the face bore beyond
    its elastic force, of all cycles, in the axes of the sensor, N; and of the steps the time, the
    force that was measured, N, and that of the terms."""

    over_n: np.ndarray  # (3, t)
    fits: dict[str, CreepFit] = field(default_factory=dict)
    kept: dict[str, str] = field(default_factory=dict)
    steps: dict[str, tuple[np.ndarray, ...]] = field(default_factory=dict)


def _relaxation(topology: Topology, series: Series, result: UnitResult) -> _Relaxation:
    """Fit terms to the holds, on the elastic laws of `result`."""
    unit = topology.index(result.unit)
    known = with_fits(alone(topology, unit), {result.unit: tuple(result.fits)})
    elastic = _elastic(known, series, unit)
    turn = np.radians([result.goodness.get(f"sensor_turn_{a}_deg", 0.0) for a in "xyz"])
    measured = np.isfinite(series.displacement).any()
    steps = series if measured else replace(series, displacement=elastic)
    held = _near_steps(steps.blocks(topology, unit, HOLD_S).of("hold"))
    if measured:  # a face that is held is where the stage is
        held = _elastic_of(known, held, result.goodness.get("touch_mm", 0.0))
    pushed = held.force - np.cross(turn, np.nan_to_num(held.force), axisb=0, axisc=0)
    found = _Relaxation(np.zeros_like(elastic))
    for law, axes in AXES_OF.items():
        rows = list(axes)
        seen = np.isfinite(pushed[rows]).all(axis=0)
        moved, borne = held.displacement[rows][:, seen], pushed[rows][:, seen]
        runs = np.concatenate([3 * held.segment[seen] + axis for axis in axes])
        time_s = held.time_s[seen]
        try:
            fit = fit_creep(np.tile(time_s, len(axes)), moved.ravel(), borne.ravel(), law, run=runs)
        except ScanError as error:
            found.kept[f"{law}_creep"] = f"hold: {error}"
            continue
        found.fits[law] = fit
        for axis in axes:
            found.over_n[axis] = unrelaxed(fit, series.counts.time_s, elastic[axis])
        over = np.interp(time_s, series.counts.time_s, found.over_n[axes[0]])
        found.steps[f"{law} hold"] = time_s - time_s[0], borne[0], fit.gain * moved[0] + over
    found.over_n[:] += np.cross(turn, found.over_n, axisb=0, axisc=0)
    return found


def _near_steps(held: Blocks) -> Blocks:
    """All blocks that are near a step, and few of the others."""
    held = held.where(np.asarray(np.isfinite(held.force).any(axis=0)))
    if not len(held):
        raise ScanError("hold: must be a segment whose force was measured; got none")
    pushed = np.nan_to_num(held.force)
    moved: Any = morphological_gradient(pushed, size=(1, 2 * round(QUICK_S / HOLD_S) + 1))
    steps = (moved > MOVED_SHARE * np.ptp(pushed)).any(axis=0)
    return held.where(steps | (np.arange(len(held)) % LATER == 0))


def _elastic(known: Topology, series: Series, unit: int) -> np.ndarray:
    """Elastic force of all cycles, as decoded, shape (3, t); that of the one before where there is
    none."""
    reading = decoded(known, series, unit, creep=False)
    good = series.counts.heard[:, unit] & (reading.status[:, 0] & INVALID == 0)
    good &= np.isfinite(reading.force[:, :, 0]).all(axis=1)
    last = np.maximum.accumulate(np.where(good, np.arange(good.size), -1))
    return np.where(last >= 0, reading.force[last, :, 0].T, 0.0)


def _elastic_of(known: Topology, held: Blocks, touch_mm: float) -> Blocks:
    """The blocks with the elastic force of a displacement in its place."""
    law, (x, y, z) = Elastic(known), held.displacement
    depth, radius = np.maximum(z - touch_mm, 0.0)[:, np.newaxis], np.hypot(x, y)
    push = law.tangential(radius[:, np.newaxis], depth)[:, 0] / np.maximum(radius, 1e-9)
    return replace(held, displacement=np.stack([push * x, push * y, law.normal(depth)[:, 0]]))


def _take_relaxation(result: UnitResult, found: _Relaxation) -> None:
    """The elastic laws with the terms of the holds.

    What these leave unknown of the relaxation is unknown of all stiffnesses in common. In a decoder
    it is part of the terms' sigma; of a unit that has none, of that of the elastic law.
    """
    result.kept |= found.kept
    result.plots |= found.steps
    for law, fit in found.fits.items():
        sigma = fit.fit[f"{law}_creep_sigma_relative"]
        for k, each in enumerate(result.fits):
            share = np.where(np.isin(each.names, STIFFNESSES[law]), sigma * each.values, 0.0)
            wider = each.covariance + np.outer(share, share)
            result.fits[k] = replace(each, covariance=wider)
        result.fits.append(fit.fit)
        result.goodness[f"{law}_hold_rms_n"] = fit.rms_n
        result.goodness[f"{law}_creep_share"] = float(fit.weights.sum())
        if not fit.weights.any():
            result.kept[f"{law}_creep"] = "terms predict no better than none, by cross-validation"
            before = float(result.p[f"{law}_sigma_relative"])
            result.say(**{f"{law}_sigma_relative": float(np.hypot(before, sigma))})
        for k in np.flatnonzero(~np.array(fit.determined)):
            result.kept[f"{law}_creep_relative[{k}]"] = "the holds do not determine it"
