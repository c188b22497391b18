"""Relaxation of a unit, from steps that are held, and its elastic laws without it.

Faces that move bear more than those that are held, and so do the laws that are fitted to them. What
a step bears beyond its elastic force is determined by the holds, but for a factor, the gain of
`skin.calibrate.creep`. Taken off all forces of the recording, it leaves those that the elastic laws
are of: they are fitted once more, which is how the gain comes into them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import morphological_gradient

from bus.status import INVALID
from skin.calibrate.bench.alone import alone
from skin.calibrate.bench.file import KINDS
from skin.calibrate.bench.result import UnitResult
from skin.calibrate.bench.series import Blocks, Series
from skin.calibrate.creep import CreepFit, fit_creep, unrelaxed
from skin.calibrate.read import as_fit
from skin.calibrate.write import with_fits
from skin.decode.decoder import Decoder
from skin.errors import ScanError
from skin.physics.elastic import Elastic
from skin.physics.force_law import STIFFNESSES
from skin.physics.least_squares import Fit
from topology import Topology

__all__ = ["relaxed"]

BLOCK_S, LATER = 0.05, 10
"""Block of a hold, six in the time of the fastest term; of those that are not near a step, one
of so many is looked at [derived]."""
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


class _Found(NamedTuple):
    """Terms of each law that was held, and why there are none of others; what the face bore beyond
    its elastic force, of all cycles, in the axes of the sensor, N; and of the steps the time, the
    force that was measured, N, and that of the terms."""

    fits: dict[str, CreepFit]
    kept: dict[str, str]
    over_n: np.ndarray  # (3, t)
    steps: dict[str, tuple[np.ndarray, ...]]

    @property
    def needed(self) -> bool:
        """Whether the unit relaxes at all."""
        return any(fit.weights.any() for fit in self.fits.values())


def relaxed(
    topology: Topology, series: Series, unit: int, fitted: Callable[[Series], UnitResult]
) -> UnitResult:
    """The laws of a unit with its relaxation.

    Parameters
    ----------
    topology : Topology
        Nominal parameters.
    series : Series
    unit : int
    fitted : callable
        Fits the elastic laws to a recording.
    """
    result = fitted(series)
    try:
        found = _fit(topology, series, unit, result)
    except ScanError as error:
        return replace(result, kept=result.kept | {"creep": str(error)})
    if found.needed:
        loaded = np.isin(series.kind, [KINDS.index(k) for k in ("normal", "shear", "circles")])
        parted = loaded & ~(series.force[2] > PARTED_N)
        whole = replace(series, segment=np.where(parted, -1, series.segment))
        for _ in range(ROUNDS):
            result = fitted(replace(whole, force=series.force - found.over_n))
            found = _fit(topology, series, unit, result)
    return _joined(result, found)


def _fit(topology: Topology, series: Series, unit: int, result: UnitResult) -> _Found:
    """Fit terms to the holds, on the elastic laws of `result`."""
    known = with_fits(alone(topology, unit), {result.unit: result.fits})
    elastic = _elastic(known, series, unit)
    turn = np.radians([result.goodness.get(f"sensor_turn_{a}_deg", 0.0) for a in "xyz"])
    measured = np.isfinite(series.displacement).any()
    steps = series if measured else replace(series, displacement=elastic)
    held = _fresh(steps.blocks(topology, unit, BLOCK_S).of("hold"))
    if measured:  # a face that is held is where the stage is
        held = _elastic_of(known, held, result.goodness.get("touch_mm", 0.0))
    force = held.force - np.cross(turn, np.nan_to_num(held.force), axisb=0, axisc=0)
    found = _Found({}, {}, np.zeros_like(elastic), {})
    for law, axes in AXES_OF.items():
        rows = list(axes)
        seen = np.isfinite(force[rows]).all(axis=0)
        moved, borne = held.displacement[rows][:, seen], force[rows][:, seen]
        runs = np.concatenate([3 * held.segment[seen] + axis for axis in axes])
        time_s = np.tile(held.time_s[seen], len(axes))
        try:
            fit = fit_creep(time_s, moved.ravel(), borne.ravel(), law, run=runs)
        except ScanError as error:
            found.kept[f"{law}_creep"] = f"hold: {error}"
            continue
        found.fits[law] = fit
        for axis in axes:
            found.over_n[axis] = unrelaxed(fit, series.counts.time_s, elastic[axis])
        over = np.interp(held.time_s[seen], series.counts.time_s, found.over_n[axes[0]])
        at_s = held.time_s[seen] - held.time_s[0]
        found.steps[f"{law} hold"] = at_s, borne[0], fit.gain * moved[0] + over
    found.over_n[:] += np.cross(turn, found.over_n, axisb=0, axisc=0)
    return found


def _fresh(held: Blocks) -> Blocks:
    """All blocks that are near a step, and few of the others."""
    held = held.where(np.asarray(np.isfinite(held.force).any(axis=0)))
    if not len(held):
        raise ScanError("hold: must be a segment whose force was measured; got none")
    force = np.nan_to_num(held.force)
    moved: Any = morphological_gradient(force, size=(1, 2 * round(QUICK_S / BLOCK_S) + 1))
    steps = (moved > MOVED_SHARE * np.ptp(force)).any(axis=0)
    return held.where(steps | (np.arange(len(held)) % LATER == 0))


def _elastic(known: Topology, series: Series, unit: int) -> np.ndarray:
    """Elastic force of all cycles, as decoded, shape (3, t); that of the one before where there is
    none."""
    decoder = Decoder(known, {"force"}, dtype="float64", creep=False, sweeps=0, ambient=False)
    reading = decoder(np.ascontiguousarray(series.counts.counts[:, :, unit : unit + 1]))
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


def _joined(result: UnitResult, found: _Found) -> UnitResult:
    """The elastic laws with the terms of the holds.

    What these leave unknown of the relaxation is unknown of all stiffnesses in common. In a decoder
    it is part of the terms' sigma; of a unit that has none, of that of the elastic law.
    """
    fits, kept = list(result.fits), result.kept | found.kept
    goodness = dict(result.goodness)
    for law, fit in found.fits.items():
        sigma = fit.fit[f"{law}_creep_sigma_relative"]
        fits = [_wider(each, STIFFNESSES[law], sigma) for each in fits]
        fits.append(fit.fit)
        goodness[f"{law}_hold_rms_n"] = fit.fit.residual_rms
        goodness[f"{law}_creep_share"] = float(fit.weights.sum())
        if not fit.weights.any():
            kept[f"{law}_creep"] = "terms predict no better than none, by cross-validation"
            name = f"{law}_sigma_relative"
            before = next(each[name] for each in fits if name in each.names)
            fits.append(as_fit({name: (float(np.hypot(before, sigma)), np.nan)}, 0))
        for k in np.flatnonzero(~np.array(fit.determined)):
            kept[f"{law}_creep_relative[{k}]"] = "the holds do not determine its time"
    return replace(result, fits=tuple(fits), kept=kept, goodness=goodness,
                   plots=result.plots | found.steps)  # fmt: skip


def _wider(fit: Fit, names: Sequence[str], relative: float) -> Fit:
    """The fit with a relative error that these of its parameters have in common."""
    share = np.where(np.isin(fit.names, names), relative * fit.values, 0.0)
    return replace(fit, covariance=fit.covariance + np.outer(share, share))
