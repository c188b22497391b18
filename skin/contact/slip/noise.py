"""Variance of the lags over sigma squared: spread and correlation, measured while the body
sticks."""

from __future__ import annotations

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.slip.data import SlipScratch
from skin.contact.slip.parameters import PARAMETERS, SETTLED

__all__ = ["begin_cycle", "is_noisy", "learn_noise", "noise_ratio", "unlike_readings"]

AT_MOST_RECENT = 0.5
"""[numeric] Largest weight of one cycle in the mean of a lag: with more, the lag would equal its
mean and have no residual."""


@jitable(inline=True)
def begin_cycle(noise, dt_s):
    """Decay the sums of all units, and compute their ratios."""
    keep, prior = max(0.0, 1.0 - dt_s / PARAMETERS.memory_s), PARAMETERS.noise_prior
    for k in range(4):
        noise[k] *= keep
    noise[4] = (noise[0] + prior) / (noise[1] + prior)
    noise[5] = (noise[2] + prior) / (noise[3] + prior)


@jitable(inline=True)
def unlike_readings(noise):
    """Variance of single readings over sigma squared, of all units together; 1 at least."""
    return max(1.0, noise[5])


@jitable(inline=True)
def noise_ratio(noise, unit_sum, unit_count):
    """Variance of the noise of a unit over sigma squared: derivations.md, equation 13."""
    prior = PARAMETERS.unit_noise_prior
    return max(1.0, (unit_sum + prior * noise[4]) / (unit_count + prior))


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
    weight, recent = 0.5 * share, min(AT_MOST_RECENT, dt_s / PARAMETERS.rest_s)
    forget = min(1.0, dt_s / PARAMETERS.memory_s)
    outlier = PARAMETERS.outlier_sigmas**2
    most, most_reading = outlier * noise[4], outlier * noise[5]
    settled = SETTLED * PARAMETERS.slow_s
    scale = free * share / (2.0 - share) * _left_by_mean(share, recent)
    lags, readings, count = 0.0, 0.0, 0.0
    for j in range(length):
        included = row.held[j] if unit.age_s[j] > settled else 0.0
        square = 0.0
        for c in range(2):
            further = unit.lag[c, j] - unit.lag_mean[c, j]
            unit.lag_mean[c, j] += included * recent * further
            square += (further * (1.0 - recent)) ** 2
        seen = min(square / (scale * row.reported[j]), most)
        lags += included * seen
        readings += included * min(row.surprise[j] / (free * row.reported[j]), most_reading)
        count += included
        counted = included * weight * free
        unit.noise_sum[j] += counted * seen - included * forget * unit.noise_sum[j]
        unit.noise_count[j] += counted - included * forget * unit.noise_count[j]
    noise[0] += weight * free * lags
    noise[1] += weight * free * count
    noise[2] += free * readings
    noise[3] += free * count


@jitable(inline=True)
def _left_by_mean(share, recent):
    """Fraction of the variance of low-passed white noise that remains without its mean, which has
    the gain `recent`."""
    keep = 1.0 - recent
    common = recent / (1.0 - keep * (1.0 - share))
    mean = 2.0 * recent * keep * (1.0 - share) * common + recent * recent
    return 1.0 - 2.0 * common + mean / (1.0 - keep * keep)
