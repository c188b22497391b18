"""Depth and normal force, from the frequency of the oscillator under the gel capacitor."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bus.compiled.jit import jitable
from skin.decode.plan import Plan
from skin.decode.records import FREQUENCY
from skin.decode.rows import read
from skin.decode.temperature import EXTRAPOLATION
from skin.physics.force_law import at as law_at
from skin.physics.force_law import force, lines

__all__ = ["Normal", "law_variance", "normal_law"]


class Normal(NamedTuple):
    """Depth, mm, and normal force, N, with their one-sigma."""

    depth: float
    push: float
    depth_sigma: float
    push_sigma: float


@jitable
def law_variance(force, relative2, absolute2):
    """What a law is off by that is not the unit's: a share of the force, and as much for all loads;
    but never more than the force itself, for the law goes through zero as the unit does."""
    square = force * force
    return relative2 * square + min(absolute2, square)


def normal_law(plan: Plan) -> Callable:
    """Depth and normal force of a unit, and their one-sigma."""
    with_sigma, push_of = plan.sigma, force if plan.cubes else lines

    @jitable
    def normal(unit, counts, background, j):
        real = unit["depth_scale"].dtype.type
        depth = unit["depth_scale"][j] * real(read(counts, FREQUENCY, j))
        depth += unit["depth_offset"][j]
        if background is not None:
            depth -= unit["depth_per_hz"][j] * read(background, 0, j)
        law = law_at(unit["normal_law"], j)
        push = push_of(depth, law)
        depth_sigma = push_sigma = real(0.0)
        if with_sigma:
            over = max(depth - unit["depth_high"][j], unit["depth_low"][j] - depth)
            beyond = real(EXTRAPOLATION) * max(over, real(0.0))
            depth_sigma = unit["depth_sigma"][j] + beyond
            # half of what the force changes over the interval of the frequency, and of the law
            sigma = unit["normal_sigma"][j] + beyond
            half = push_of(depth + sigma, law)
            half -= push_of(depth - sigma, law)
            half *= real(0.5)
            law2 = law_variance(push, unit["normal_variance"][j], unit["normal_floor"][j])
            push_sigma = np.sqrt(half * half + law2)
        return Normal(depth, push, depth_sigma, push_sigma)

    return normal
