"""Variance of the lags over sigma squared: spread, correlation, slow noise and its growth, measured
while the body sticks."""

from __future__ import annotations

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.slip.data import (
    GROWTH,
    LAG_RATIO,
    LAGS,
    READING_RATIO,
    READINGS,
    RECENT_STEPS,
    SLOW,
    STEPS,
    WANDER,
    SlipScratch,
)  # fmt: skip
from skin.contact.slip.parameters import PARAMETERS, SETTLED

__all__ = ["begin_cycle", "is_noisy", "learn_noise", "unit_noise", "unlike_readings"]

AT_MOST_RECENT = 0.5
"""[numeric] Largest weight of one cycle in the mean of a lag: with more, the lag would equal its
mean and have no residual."""
TINY = 1e-12
"""[numeric] Lower bound of a weight times a variance."""


@jitable(inline=True)
def begin_cycle(noise, dt_s):
    """Decay the sums of all units, and compute their ratios."""
    keep, prior = max(0.0, 1.0 - dt_s / PARAMETERS.memory_s), PARAMETERS.noise_prior
    for k in (LAGS, READINGS, STEPS, SLOW):
        noise[k] *= keep
        noise[k + 1] *= keep
    for k in (RECENT_STEPS, RECENT_STEPS + 1):
        noise[k] *= np.exp(-dt_s / PARAMETERS.slow_s)
    noise[LAG_RATIO] = (noise[LAGS] + prior) / (noise[LAGS + 1] + prior)
    noise[READING_RATIO] = (noise[READINGS] + prior) / (noise[READINGS + 1] + prior)
    usual = (noise[STEPS] + prior) / (noise[STEPS + 1] + prior)
    now = (noise[RECENT_STEPS] + prior * usual) / (noise[RECENT_STEPS + 1] + prior)
    # Squares of successive changes, which have a reading in common, correlate by a quarter.
    chance = PARAMETERS.outlier_sigmas * np.sqrt(3.0 / (noise[RECENT_STEPS + 1] + prior))
    noise[GROWTH] = max(1.0, now / usual - chance)
    noise[WANDER] = max(0.0, noise[SLOW] / (noise[SLOW + 1] + prior))


@jitable(inline=True)
def unlike_readings(noise):
    """Variance of single readings over sigma squared, of all units together; 1 at least."""
    return max(1.0, noise[READING_RATIO])


@jitable(inline=True)
def unit_noise(length, scratch: SlipScratch):
    """Variance of the noise of each unit, and of its slow noise over sigma squared: derivations.md,
    equations 13 and 13a."""
    assume_noalias()
    unit, row, noise = scratch.unit, scratch.row, scratch.noise
    prior, growth = PARAMETERS.unit_noise_prior, noise[GROWTH]
    lags, slow = prior * noise[LAG_RATIO], prior * noise[WANDER]
    for j in range(length):
        share = 1.0 / (unit.noise_count[j] + prior)
        ratio = growth * max(1.0, (unit.noise_sum[j] + lags) * share)
        unit.noise_ratio[j] = ratio
        row.noise[j] = row.reported[j] * ratio
        row.wander[j] = max(0.0, (unit.slow_sum[j] + slow) * share)


@jitable(inline=True)
def is_noisy(unit_sum, unit_count, limit):
    """1 where the noise of a unit exceeds its sigma, else 0; `limit` is the log-odds of an alarm.
    The one-sigma of a sum of squares is the root of twice their number."""
    further = unit_sum - unit_count
    return 1.0 if further > 0.0 and further**2 > 4.0 * limit * unit_count else 0.0


@jitable(inline=True)
def learn_noise(length, stuck, motions, share, dt_s, scratch: SlipScratch):
    """Update the variance of readings and of low-passed lags: derivations.md, equations 12 and 13.

    That of the lags contains noise that is correlated from cycle to cycle, which sigma does not.
    Units that slip are excluded, and outliers are clipped.
    """
    assume_noalias()
    unit, row, noise = scratch.unit, scratch.row, scratch.noise
    free = 2.0 * stuck - motions
    if free < 1.0:
        return
    free /= stuck
    # Independent readings: a low-pass has one in twice its time constant.
    weight, recent = 0.5 * share * free, min(AT_MOST_RECENT, dt_s / PARAMETERS.rest_s)
    forget = min(1.0, dt_s / PARAMETERS.memory_s)
    outlier = PARAMETERS.outlier_sigmas**2
    most, most_reading = outlier * noise[LAG_RATIO], outlier * noise[READING_RATIO]
    settled = SETTLED * PARAMETERS.slow_s
    scale = share / (2.0 - share) * _left_by_mean(share, recent)
    lags, readings, steps, slow, count = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(length):
        included = row.held[j] if unit.age_s[j] > settled else 0.0
        square, whole = 0.0, 0.0
        for c in range(2):
            further = unit.lag[c, j] - unit.lag_mean[c, j]
            unit.lag_mean[c, j] += included * recent * further
            square += (further * (1.0 - recent)) ** 2
            whole += unit.lag[c, j] ** 2
        told = free * row.reported[j]
        seen = min(square / (scale * told), most)
        # What the model of a lag explains but for slow noise.
        expected = free / max(row.weight[j] * told, TINY) - row.wander[j]
        beyond = min(whole / told, outlier * (expected + row.wander[j])) - expected
        lags += included * seen
        slow += included * beyond
        readings += included * min(row.surprise[j] / told, most_reading)
        steps += included * min(0.5 * row.step[j] / told, most_reading)
        count += included
        counted = included * weight
        unit.noise_sum[j] += counted * seen - included * forget * unit.noise_sum[j]
        unit.slow_sum[j] += counted * beyond - included * forget * unit.slow_sum[j]
        unit.noise_count[j] += counted - included * forget * unit.noise_count[j]
    _add(noise, LAGS, weight, lags, count)
    _add(noise, SLOW, weight, slow, count)
    _add(noise, READINGS, free, readings, count)
    _add(noise, STEPS, free, steps, count)
    _add(noise, RECENT_STEPS, free, steps, count)


@jitable(inline=True)
def _add(noise, at, weight, total, count):
    """Add to a sum, and to its number of terms."""
    noise[at] += weight * total
    noise[at + 1] += weight * count


@jitable(inline=True)
def _left_by_mean(share, recent):
    """Fraction of the variance of low-passed white noise that remains without its mean, which has
    the gain `recent`."""
    keep = 1.0 - recent
    common = recent / (1.0 - keep * (1.0 - share))
    mean = 2.0 * recent * keep * (1.0 - share) * common + recent * recent
    return 1.0 - 2.0 * common + mean / (1.0 - keep * keep)
