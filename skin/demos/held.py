"""Held: an object that is grasped, lifted and held with a steady force."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from skin.behaviours.pads import Pads
from skin.grasp.object import GraspObject
from skin.grasp.world import World, grasp
from skin.state import State

__all__ = ["SteadyGrip", "held_object", "thing_of"]

SERVO_N_PER_M = 1000.0
"""Gain from the fingers' target to the grip [the gripper's actuators]."""

GAIN_PER_S = 10.0
OPEN_M_PER_S = 0.05
"""Speed of opening: gentle, and free within a tenth of a second [assumed]."""

LIFT_M, LIFT_M_PER_S = 0.02, 0.15
CLOSE_S, SETTLE_S = 0.4, 0.4
MARGIN = 0.6
"""Factor above the demand of weight and strongest pull: no slip is wanted here [assumed]."""


def thing_of(random: np.random.Generator) -> GraspObject:
    """A block that stands on the floor between the pads, 80 to 300 g."""
    return GraspObject(
        name="block", size_m=(float(random.uniform(0.014, 0.026)), 0.024, 0.03),
        mass_kg=float(random.uniform(0.08, 0.3)), friction=float(random.uniform(0.6, 0.9)),
    )  # fmt: skip


class SteadyGrip:
    """A `skin.behaviours.gripper.Gripper` of the simulated gripper: force control by position
    servos."""

    def __init__(self, world: World, target_m: float) -> None:
        self.world, self.target_m = world, target_m
        self.opening = False
        self._period_s = 1.0 / world.skin.topology.cycle_rate_hz

    def squeeze(self, wanted_n: float, felt_n: float) -> None:
        """See `Gripper`."""
        if math.isfinite(felt_n) and not self.opening:
            self.target_m += GAIN_PER_S * self._period_s * (wanted_n - felt_n) / SERVO_N_PER_M
        self._set()

    def release(self) -> None:
        """See `Gripper`."""
        self.opening = True
        self.target_m -= OPEN_M_PER_S * self._period_s
        self._set()

    def _set(self) -> None:
        lower, upper = self.world.joints.limits("left")
        self.target_m = min(max(self.target_m, lower), upper)
        self.world.joints["left"] = self.world.joints["right"] = self.target_m


@contextmanager
def held_object(
    thing: GraspObject, *, strongest_n: float = 0.0, seed: int = 0, **options: Any
) -> Iterator[tuple[World, SteadyGrip, Iterator[State]]]:
    """Open a world, grasp the object, lift it, and wait until it is still.

    Parameters
    ----------
    thing : GraspObject
        On the floor between the pads.
    strongest_n : float
        Newton: largest pull by people.
    seed, **options
        See `skin.grasp.world.grasp`.

    Yields
    ------
    world : World
    grip : SteadyGrip
    states : iterator of State
        From the time when it hangs still; the grip is held until its release.
    """
    weight_n = 9.81 * thing.mass_kg
    wanted_n = (1.0 + MARGIN) * 0.5 * (weight_n + strongest_n) / thing.friction + 1.0
    with grasp("gripper", objects=[thing], seed=seed, **options) as world:
        grip = SteadyGrip(world, 0.045 - thing.size_m[0])
        states = _states(world, grip, wanted_n)
        for _ in states:
            height_m = LIFT_M_PER_S * (world.time_s - CLOSE_S)
            world.joints["lift"] = float(np.clip(height_m, 0.0, LIFT_M))
            if world.time_s >= CLOSE_S + LIFT_M / LIFT_M_PER_S + SETTLE_S:
                break
        yield world, grip, states


def _states(world: World, grip: SteadyGrip, wanted_n: float) -> Iterator[State]:
    pads = Pads(world.skin.topology)
    for state in world:
        if grip.opening:
            grip.release()
        else:
            grip.squeeze(wanted_n, float(pads.read(state).load_n.mean()))
        yield state
