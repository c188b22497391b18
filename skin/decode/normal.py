"""Depth and normal force, from the frequency of the oscillator under the gel capacitor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bus.compiled.jit import jitable
from skin.decode.parts import Parts
from skin.decode.records import FREQUENCY
from skin.decode.temperature import EXTRAPOLATION

__all__ = ["bent", "normal_stage"]


@jitable(inline=True)
def bent(x, soft, knee, stiffer):
    """Force of a piecewise linear law; not clipped at zero."""
    return soft * x + stiffer * max(x - knee, type(x)(0.0))


@jitable(inline=True)
def normal_law(depth, unit, j):
    """Normal force at a depth."""
    return bent(depth, unit["normal_soft"][j], unit["normal_break"][j], unit["normal_stiffer"][j])


@jitable(inline=True)
def depth_sigma(depth, unit, j):
    real = type(depth)
    over = max(depth - unit["depth_high"][j], unit["depth_low"][j] - depth)
    return unit["depth_sigma"][j] + real(EXTRAPOLATION) * max(over, real(0.0))


@jitable(inline=True)
def normal_sigma(depth, sigma, force, unit, j):
    """Half of what the force changes over the interval of the depth, and of the law itself."""
    half = normal_law(depth + sigma, unit, j) - normal_law(depth - sigma, unit, j)
    half *= type(depth)(0.5)
    return np.sqrt(half * half + unit["normal_variance"][j] * (force * force))


def normal_stage(parts: Parts) -> Callable:
    """The stage that decodes depth and normal force, and their one-sigma."""
    with_sigma = parts.sigma

    @jitable(inline=True)
    def normal(unit, counts, background, span, tile):
        real = tile["force"].dtype.type
        for j in range(span.count):
            frequency = real(counts[span.cycle, FREQUENCY, span.first + j])
            depth = unit["depth_scale"][j] * frequency + unit["depth_offset"][j]
            if background is not None:
                depth -= unit["depth_per_hz"][j] * background[span.cycle, 0, span.first + j]
            force = normal_law(depth, unit, j)
            tile["displacement"][2, j] = depth
            tile["force"][2, j] = force
            if with_sigma:
                sigma = depth_sigma(depth, unit, j)
                tile["displacement_sigma"][2, j] = sigma
                tile["force_sigma"][2, j] = normal_sigma(depth, sigma, force, unit, j)

    return normal
