"""Microseconds a cycle of a behaviour, on states of a simulated grasp that are kept."""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import numpy as np

from skin.grasp.object import GraspObject
from skin.grasp.world import grasp

__all__ = ["microseconds"]

CYCLES, ROUNDS = 250, 5


@cache
def _states() -> list[Any]:
    """A second of something that is held."""
    thing = GraspObject(name="it", size_m=(0.02, 0.02, 0.025), mass_kg=0.1)
    states: list[Any] = []
    with grasp("gripper", objects=[thing], want=("force", "temperature", "sigma")) as world:
        world.joints["left"] = world.joints["right"] = 0.032
        for state in world:
            if world.time_s > 1.0:
                states.append(state.copy())
            if len(states) == CYCLES:
                return states
    return states


def microseconds(behaviour: Any) -> dict[str, float]:
    """Median, mean and largest of a cycle; the first round warms up, and is not counted. Stamps go
    on from round to round."""
    states = _states()
    span_ns = states[-1].stamp_ns - states[0].stamp_ns + 4_000_000
    took = []
    for number in range(ROUNDS):
        for state in states:
            state.stamp_ns += span_ns if number else 0
            began = time.perf_counter_ns()
            behaviour.update(state)
            if number:
                took.append(1e-3 * (time.perf_counter_ns() - began))
    for state in states:
        state.stamp_ns -= (ROUNDS - 1) * span_ns
    return {
        "us_median": float(np.median(took)), "us_mean": float(np.mean(took)),
        "us_p99": float(np.percentile(took, 99)),
    }  # fmt: skip
