"""How much more lags vary than sigma says: spread and correlation, seen while the body holds."""

from __future__ import annotations

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.slip.data import SlipScratch
from skin.contact.slip.parameters import PARAMETERS, SETTLED

__all__ = ["begin_cycle", "is_noisy", "learn_noise", "noise_ratio", "unlike_readings"]

AT_MOST_RECENT = 0.5
"""[numeric] Share of one cycle in the mean of a lag, however long the cycle: a lag is not its own
mean, and nothing would be left to learn from."""


@jitable(inline=True)
def begin_cycle(noise, dt_s):
    """Forget a little of what all units together have shown, and sum up the rest."""
    keep, prior = max(0.0, 1.0 - dt_s / PARAMETERS.memory_s), PARAMETERS.noise_prior
    for k in range(4):
        noise[k] *= keep
    noise[4] = (noise[0] + prior) / (noise[1] + prior)
    noise[5] = (noise[2] + prior) / (noise[3] + prior)


@jitable(inline=True)
def unlike_readings(noise):
    """Variance of single readings over what sigma says, of all units together; 1 at least."""
    return max(1.0, noise[5])


@jitable(inline=True)
def noise_ratio(noise, unit_sum, unit_count):
    """Variance of the noise of a unit over what sigma says: derivations.md, equation 13."""
    prior = PARAMETERS.unit_noise_prior
    return max(1.0, (unit_sum + prior * noise[4]) / (unit_count + prior))


@jitable(inline=True)
def is_noisy(unit_sum, unit_count, limit):
    """1 where the noise of a unit is greater than sigma says, else 0; `limit` is the logarithm of
    the odds that alarm. A sum of so many squares varies by the root of twice their number."""
    further = unit_sum - unit_count
    return 1.0 if further > 0.0 and further**2 > 4.0 * limit * unit_count else 0.0


@jitable(inline=True)
def learn_noise(length, stuck, motions, share, dt_s, scratch: SlipScratch):
    """Follow the variance of readings and of low-passed lags: derivations.md, equations 12 and 13.

    That of the lags counts noise that is correlated from cycle to cycle, as sigma cannot. Units
    that slip are no judges, and what is an outlier counts as one.
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
        judges = row.held[j] if unit.age_s[j] > settled else 0.0
        square = 0.0
        for c in range(2):
            further = unit.lag[c, j] - unit.lag_mean[c, j]
            unit.lag_mean[c, j] += judges * recent * further
            square += (further * (1.0 - recent)) ** 2
        seen = min(square / (scale * row.told[j]), most)
        lags += judges * seen
        readings += judges * min(row.surprise[j] / (free * row.told[j]), most_reading)
        count += judges
        counted = judges * weight * free
        unit.noise_sum[j] += counted * seen - judges * forget * unit.noise_sum[j]
        unit.noise_count[j] += counted - judges * forget * unit.noise_count[j]
    noise[0] += weight * free * lags
    noise[1] += weight * free * count
    noise[2] += free * readings
    noise[3] += free * count


@jitable(inline=True)
def _left_by_mean(share, recent):
    """Share of the variance of low-passed white noise that is left without its mean, which follows
    by the share `recent`."""
    keep = 1.0 - recent
    common = recent / (1.0 - keep * (1.0 - share))
    mean = 2.0 * recent * keep * (1.0 - share) * common + recent * recent
    return 1.0 - 2.0 * common + mean / (1.0 - keep * keep)
