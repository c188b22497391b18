"""The filter of each unit: its lag behind the rigid motion, its gain error and its anchor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.record import UnitSlip
from skin.contact.slip.data import SlipArrays, SlipScratch, UnitFilter, UnitRows, padded
from skin.contact.slip.noise import unit_noise
from skin.contact.slip.parameters import PARAMETERS, SETTLED, SlipModel
from skin.contact.slip.rigid_fit import design_motions

__all__ = ["Pace", "correct", "gather", "lowpass_share", "predict", "scatter"]

LEAST_SIGMA_MM = 1e-6
"""[numeric] Lower bound of the sigma of a displacement, millimetre."""


@jitable(inline=True)
def gather(record, reading, units, geometry, size, motions, slip: SlipArrays):
    """Gather the units of a contact into rows, and initialise new ones.

    Returns the padded length, the number of sticking units, and the number of units anchored to
    this body, sticking or slipping.
    """
    kept, history, scratch = slip.kept, slip.history, slip.scratch
    unit, row = scratch.unit, scratch.row
    displacement, sigma = reading.displacement, reading.displacement_sigma
    first = record["begin"]
    count = record["end"] - first
    body, parent = np.float64(record["id"]), np.float64(record["parent"])
    stuck, known = 0, 0
    remembered = _remembered_share(first, count, displacement, units, kept)
    for j in range(count):
        i = units.members[first + j]
        # At the edge of a contact: its film recovers and no longer follows the body.
        at_most = displacement[2, i] + PARAMETERS.outlier_sigmas * sigma[2, i]
        recovers = at_most < remembered * kept.anchor_depth[i]
        if recovers:
            units.slip[i] = UnitSlip.NO_CONTACT
        new = units.slip[i] == UnitSlip.NO_CONTACT
        if history.body[i] == parent:
            history.body[i] = body
        anchored = not new and history.body[i] == body
        history.body[i] = body
        _copy(kept, i, unit, j)
        held = anchored and units.slip[i] != UnitSlip.SLIPPING
        known += anchored
        stuck += held
        row.held[j] = 1.0 if held else 0.0
        row.in_pattern[j], row.body_variance[j] = 0.0, 0.0
        row.new[j] = 1.0 if new else 0.0
        row.joined[j] = 1.0 if not (new or anchored) else 0.0
        row.displacement[0, j] = displacement[0, i]
        row.displacement[1, j] = displacement[1, i]
        reported = 0.5 * (np.float64(sigma[0, i]) ** 2 + np.float64(sigma[1, i]) ** 2)
        row.reported[j] = max(reported, LEAST_SIGMA_MM**2)
        row.load[j] = reading.force[2, i]
        depth = np.float64(displacement[2, i])
        if new:
            unit.anchor_depth[j] = unit.anchor_depth[j] if recovers else depth
            history.slid_shear[i], history.slid_load[i] = 0.0, 0.0
            history.slid_variance[i], history.borne[i] = 0.0, 0.0
        row.deeper[j] = depth - unit.anchor_depth[j]
        design_motions(geometry.pose[i], scratch.fit, size, motions, row, j)
    length = _pad(count, scratch)
    unit_noise(length, scratch)
    return length, stuck, known


@jitable(inline=True)
def _remembered_share(first, count, displacement, units, kept: UnitFilter):
    """Fraction of its depth at anchoring that a unit's film may keep without load."""
    deep, was_deep = 0.0, 0.0
    for j in range(count):
        i = units.members[first + j]
        if units.slip[i] != UnitSlip.NO_CONTACT:
            deep += displacement[2, i]
            was_deep += kept.anchor_depth[i]
    return PARAMETERS.film_memory * deep / max(was_deep, 1e-9)


@jitable(inline=True)
def _pad(count, scratch: SlipScratch):
    """Pad all rows with units of weight zero; returns the length in whole vectors."""
    length = padded(count, scratch.unit_rows)
    padded(count, scratch.rows)
    for j in range(count, length):
        scratch.row.reported[j] = 1.0
        scratch.unit.gain_information[j] = 1.0
    return length


@jitable(inline=True)
def scatter(first, count, members, unit: UnitFilter, kept: UnitFilter):
    """Store the rows of each unit."""
    for j in range(count):
        _copy(unit, j, kept, members[first + j])


@jitable(inline=True)
def _copy(source: UnitFilter, i, target: UnitFilter, j):
    """Copy one unit."""
    for c in range(2):
        target.anchor[c, j] = source.anchor[c, i]
        target.lag[c, j] = source.lag[c, i]
        target.moved[c, j] = source.moved[c, i]
        target.moved_slow[c, j] = source.moved_slow[c, i]
        target.followed[c, j] = source.followed[c, i]
        target.followed_out[c, j] = source.followed_out[c, i]
        target.lag_mean[c, j] = source.lag_mean[c, i]
        target.behind[c, j] = source.behind[c, i]
    target.anchor_variance[j] = source.anchor_variance[i]
    target.lag_variance[j] = source.lag_variance[i]
    target.gain_error[j] = source.gain_error[i]
    target.gain_information[j] = source.gain_information[i]
    target.anchor_depth[j] = source.anchor_depth[i]
    target.noise_ratio[j] = source.noise_ratio[i]
    target.noise_sum[j] = source.noise_sum[i]
    target.noise_count[j] = source.noise_count[i]
    target.age_s[j] = source.age_s[i]
    target.slow_sum[j] = source.slow_sum[i]


@jitable(inline=True)
def lowpass_share(length, motions, stuck, dt_s, unit: UnitFilter, row: UnitRows):
    """Gain of the low-pass of lags in this cycle: derivations.md, equation 5."""
    assume_noalias()
    square, total, noise = 0.0, 0.0, 0.0
    for j in range(length):
        ahead_x = row.now[0, j] - unit.moved_slow[0, j]
        ahead_y = row.now[1, j] - unit.moved_slow[1, j]
        heavy = row.held[j] * row.load[j]
        total += heavy
        square += heavy * (ahead_x * ahead_x + ahead_y * ahead_y)
        noise += heavy * row.noise[j]
    slow = 1.0 - np.exp(-dt_s / PARAMETERS.slow_s)
    if not total > 0.0:
        return slow
    # Error of a fit of so many motions to so many units, relative to a unit's noise.
    square -= noise * motions / max(stuck, 1)
    rms = np.sqrt(square / total) if square > 0.0 else 0.0
    span = PARAMETERS.outlier_sigmas * np.sqrt(noise / total)
    return max(slow, 1.0 - span / max(rms, span))


class Pace(NamedTuple):
    """Gains of the lags in this cycle."""

    share: float  # gain of the low-pass
    dt_s: float
    unlike: float  # variance of single readings over sigma squared


@jitable(inline=True)
def predict(length, pace: Pace, model: SlipModel, unit: UnitFilter, row: UnitRows):
    """Lag of each unit behind its predicted displacement: equations 6 to 9."""
    assume_noalias()
    share, unlike = pace.share, pace.unlike
    prior, floor = 1.0 / model.gain_error**2, model.floor_mm**2
    for j in range(length):
        unit.gain_error[j] *= 1.0 - row.new[j]
        unit.gain_information[j] += row.new[j] * (prior - unit.gain_information[j])
        row.surprise[j] = 0.0
        row.step[j] = 0.0
        spread = max(row.noise[j], unlike * row.reported[j]) + unit.lag_variance[j] + floor
        row.most[j] = PARAMETERS.outlier_sigmas * np.sqrt(spread)
    for c in range(2):
        moved, lag, anchor = unit.moved[c], unit.lag[c], unit.anchor[c]
        here, followed, predicted = row.displacement[c], unit.followed[c], row.now[c]
        slow, mean, last = unit.moved_slow[c], unit.lag_mean[c], unit.behind[c]
        out, out_now = unit.followed_out[c], row.moved_out[c]
        for j in range(length):
            now = predicted[j]
            # From another contact that became part of this one: the same lag, another motion.
            joined, new = row.joined[j], row.new[j]
            anchor[j] += joined * (moved[j] - now)
            anchor[j] += new * (here[j] - now - anchor[j])
            followed[j] += joined * (now - moved[j])
            followed[j] += new * (now - followed[j])
            out[j] += max(new, joined) * (out_now[j] - out[j])
            slow[j] += joined * (now - moved[j])
            slow[j] += new * (now - slow[j])
            slow[j] += share * (now - slow[j])
            behind = here[j] - anchor[j] - now - unit.gain_error[j] * (now - followed[j])
            further = behind - lag[j]
            row.surprise[j] += further * further
            step = behind - last[j]
            row.step[j] += step * step
            last[j] = behind
            most = row.most[j]
            lag[j] = (1.0 - new) * (lag[j] + share * min(max(further, -most), most))
            mean[j] *= 1.0 - new
            moved[j] = now
    _score(length, pace, model, unit, row)


@jitable(inline=True)
def _score(length, pace: Pace, model: SlipModel, unit: UnitFilter, row: UnitRows):
    """Variance of the lags, and the predicted displacement: equations 7 to 9."""
    assume_noalias()
    share, dt_s, floor = pace.share, pace.dt_s, model.floor_mm**2
    for j in range(length):
        new, noise = row.new[j], row.noise[j]
        variance = unit.lag_variance[j]
        variance += share * (share * noise - (2.0 - share) * variance)
        variance += new * (noise - variance)
        unit.lag_variance[j] = variance
        unsettled = max(new, row.joined[j]) * (noise + row.body_variance[j])
        anchor_variance = (1.0 - new) * unit.anchor_variance[j] + unsettled
        anchor_variance = max(anchor_variance, row.wander[j] * row.reported[j])
        unit.anchor_variance[j] = anchor_variance
        square = (unit.moved[0, j] - unit.followed[0, j]) ** 2
        square += (unit.moved[1, j] - unit.followed[1, j]) ** 2
        weight = 1.0 / (variance + anchor_variance + square / unit.gain_information[j] + floor)
        row.weight[j] = (1.0 - new) * weight
        # Friction drags a unit along: a slipping unit lags against its own displacement.
        x = unit.anchor[0, j] + unit.moved_slow[0, j]
        y = unit.anchor[1, j] + unit.moved_slow[1, j]
        far = np.sqrt(x * x + y * y)
        row.imposed[j] = far
        row.direction[0, j] = x / max(far, 1e-9)
        row.direction[1, j] = y / max(far, 1e-9)
        # Excludes slipping units, and units whose noise is unknown.
        unit.age_s[j] = (1.0 - max(new, row.joined[j])) * (unit.age_s[j] + dt_s)
        settled = 1.0 if unit.age_s[j] > 2.0 * SETTLED * PARAMETERS.slow_s else 0.0
        row.root_weight[j] = np.sqrt(settled * row.held[j] * row.weight[j])


@jitable(inline=True)
def correct(length, dt_s, unit: UnitFilter, row: UnitRows):
    """Anchors and gain errors of sticking units: derivations.md, equations 10 and 11.

    An anchor is the mean displacement while the unit stuck, with a slow decay: creep and a drifting
    tare are no slip. The gain error is the slope of that line.
    """
    assume_noalias()
    slowest = min(1.0, dt_s / PARAMETERS.creep_s)
    for j in range(length):
        # The first reading is the anchor already.
        variance, held = unit.anchor_variance[j], row.held[j] * (1.0 - row.new[j])
        noise = row.noise[j] + row.body_variance[j]
        gain = held * max(variance / (variance + noise), slowest)
        gain_error, rest, square = unit.gain_error[j], 0.0, 0.0
        for c in range(2):
            travel = unit.moved[c, j] - unit.followed[c, j]
            lag = row.displacement[c, j] - unit.anchor[c, j] - unit.moved[c, j]
            step = gain * lag
            unit.anchor[c, j] += step
            unit.lag[c, j] -= step - gain * gain_error * travel
            unit.followed[c, j] += gain * travel
            unit.followed_out[c, j] += gain * (row.moved_out[c, j] - unit.followed_out[c, j])
            square += travel * travel
            rest += travel * (lag - gain_error * travel)
        unit.anchor_depth[j] += gain * row.deeper[j]
        information = held * (1.0 - gain) / row.noise[j]
        unit.gain_information[j] += information * square
        unit.gain_error[j] += information * rest / unit.gain_information[j]
        unit.anchor_variance[j] += gain * (gain * noise - (2.0 - gain) * variance)
