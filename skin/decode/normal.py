"""Depth and normal force, from the frequency of the oscillator under the gel capacitor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.decode.parts import Parts
from skin.decode.records import FREQUENCY
from skin.decode.span import lanes_of
from skin.decode.temperature import EXTRAPOLATION
from skin.physics.force_law import at, force, lines

__all__ = ["law_variance", "normal_stage"]


@jitable(inline=True)
def law_variance(force, relative2, absolute2):
    """What a law is off by that is not the unit's: a share of the force, and as much for all loads;
    but never more than the force itself, for the law goes through zero as the unit does."""
    square = force * force
    return relative2 * square + min(absolute2, square)


def normal_stage(parts: Parts) -> Callable:
    """The stage that decodes depth and normal force, and their one-sigma."""
    with_sigma, push_of = parts.sigma, force if parts.cubes else lines

    @jitable(inline=True)
    def normal(unit, counts, background, span, tile):
        assume_noalias()
        first, _, size = lanes_of(span)
        real = tile["force"].dtype.type
        for j in range(size):
            frequency = real(counts[span.cycle, FREQUENCY, first + j])
            depth = unit["depth_scale"][j] * frequency + unit["depth_offset"][j]
            if background is not None:
                depth -= unit["depth_per_hz"][j] * background[span.cycle, 0, first + j]
            law = at(unit["normal_law"], j)
            push = push_of(depth, law)
            tile["displacement"][2, j] = depth
            tile["force"][2, j] = push
            if with_sigma:
                over = max(depth - unit["depth_high"][j], unit["depth_low"][j] - depth)
                beyond = real(EXTRAPOLATION) * max(over, real(0.0))
                tile["displacement_sigma"][2, j] = unit["depth_sigma"][j] + beyond
                # half of what the force changes over the interval of the frequency, and of the law
                sigma = unit["normal_sigma"][j] + beyond
                half = push_of(depth + sigma, law)
                half -= push_of(depth - sigma, law)
                half *= real(0.5)
                law2 = law_variance(push, unit["normal_variance"][j], unit["normal_floor"][j])
                tile["force_sigma"][2, j] = np.sqrt(half * half + law2)

    return normal
