"""How much more lags vary than sigma says: spread and correlation, seen while the body holds."""

from __future__ import annotations

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.contact.slip.data import SlipScratch
from skin.contact.slip.parameters import PARAMETERS

__all__ = ["learn_noise", "unlike_readings"]


@jitable(inline=True)
def unlike_readings(noise):
    """Variance of single readings over what sigma says, of all units together; 1 at least."""
    prior = PARAMETERS.noise_prior
    return max(1.0, (noise[2] + prior) / (noise[3] + prior))


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
    weight, recent = 0.5 * share, min(1.0, dt_s / PARAMETERS.rest_s)
    keep = max(0.0, 1.0 - dt_s / PARAMETERS.noise_memory_s)
    prior, unit_prior = PARAMETERS.noise_prior, PARAMETERS.unit_noise_prior
    outlier = PARAMETERS.outlier_sigmas**2
    pool = (noise[0] + prior) / (noise[1] + prior)
    unlike = (noise[2] + prior) / (noise[3] + prior)
    lags, readings, count = 0.0, 0.0, 0.0
    for j in range(length):
        judges = row.held[j] * (1.0 - row.new[j])
        square = 0.0
        for c in range(2):
            further = unit.lag[c, j] - unit.lag_mean[c, j]
            unit.lag_mean[c, j] += judges * recent * further
            square += (further * (1.0 - recent)) ** 2
        seen = min(square * (2.0 - share) / (share * free * row.told[j]), outlier * pool)
        lags += judges * seen
        readings += judges * min(row.surprise[j] / (free * row.told[j]), outlier * unlike)
        count += judges
        counted = judges * weight * free
        unit.noise_sum[j] += counted * seen - judges * (1.0 - keep) * unit.noise_sum[j]
        unit.noise_count[j] += counted - judges * (1.0 - keep) * unit.noise_count[j]
    noise[0] = keep * noise[0] + weight * free * lags
    noise[1] = keep * noise[1] + weight * free * count
    noise[2] = keep * noise[2] + free * readings
    noise[3] = keep * noise[3] + free * count
    pool = (noise[0] + prior) / (noise[1] + prior)
    for j in range(length):
        ratio = (unit.noise_sum[j] + unit_prior * pool) / (unit.noise_count[j] + unit_prior)
        unit.noise_ratio[j] = max(ratio, 1.0)
