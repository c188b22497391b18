"""Trial of the grip control: an unknown object is grasped, lifted and pulled."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from skin.behaviours.grip import GripControl
from skin.demos.simulated_gripper import SimulatedGripper
from skin.grasp.object import GraspObject
from skin.grasp.world import World, grasp

__all__ = ["OVER_SQUEEZED", "SECONDS", "Trial", "run_trial", "unknown_object"]

SECONDS = 6.0
TRY_S, TRY_M_PER_S = 1.2, 0.004
"""Time at which the hand begins to rise, and its speed until the object hangs: slow, so that a
slide continues while it is probed."""

LIFT_M, LIFT_M_PER_S = 0.04, 0.05
PULL_S, PULLED_S, PULL_SHARE = 4.0, 5.0, 0.8
"""Begin and end of the downward pull, and its size relative to the weight."""

DROPPED_M = 0.01
"""Longest allowed slide down the pads."""

OPEN_M = 0.09
"""Gap between the pads of the open gripper."""

OVER_SQUEEZED = 0.6
"""Margin above which an object counts as over-squeezed, if it lasts over a second."""

GENTLE_S = 0.2
"""Rise time of a pull."""


@dataclass
class Trial:
    """Record of a trial, cycle by cycle.

    Attributes
    ----------
    thing : GraspObject
    time_s, load_n, true_load_n, shear_n, wanted_n, margin, true_margin, belief, height_m, hand_m, \
slid_m, gap_m, pull_n : list of float
    slipping : list of int
        Units whose face slips, by the truth.
    slips : int
        Detected by the control.
    """

    thing: GraspObject
    time_s: list[float] = field(default_factory=list)
    load_n: list[float] = field(default_factory=list)
    true_load_n: list[float] = field(default_factory=list)
    shear_n: list[float] = field(default_factory=list)
    wanted_n: list[float] = field(default_factory=list)
    margin: list[float] = field(default_factory=list)
    true_margin: list[float] = field(default_factory=list)
    belief: list[float] = field(default_factory=list)
    height_m: list[float] = field(default_factory=list)
    hand_m: list[float] = field(default_factory=list)
    slid_m: list[float] = field(default_factory=list)
    gap_m: list[float] = field(default_factory=list)
    pull_n: list[float] = field(default_factory=list)
    slipping: list[int] = field(default_factory=list)
    slips: int = 0

    @property
    def dropped(self) -> bool:
        """Whether it slid down the pads, or was never lifted."""
        return self.slid_m[-1] > DROPPED_M or self.hand_m[-1] < 0.5 * LIFT_M

    @property
    def over_squeezed_s(self) -> float:
        """Longest time with a margin above `OVER_SQUEEZED`, once it hung free."""
        time_s, margin = np.array(self.time_s), np.array(self.true_margin)
        above = (margin > OVER_SQUEEZED) & (time_s > TRY_S + 0.5)
        longest = run = 0
        for is_above in above:
            run = run + 1 if is_above else 0
            longest = max(longest, run)
        return longest * float(np.median(np.diff(time_s)))


def unknown_object(seed: int) -> GraspObject:
    """A box or a cylinder that stands on the floor between the pads."""
    random = np.random.default_rng((seed, 8))
    half_m = 0.03
    is_box = random.random() < 0.5
    width_m = random.uniform(0.012, 0.03)
    size = (width_m, random.uniform(0.012, 0.03), half_m) if is_box else (width_m, half_m)
    return GraspObject(
        name="object", shape="box" if is_box else "cylinder", size_m=size,
        mass_kg=float(random.uniform(0.08, 0.35)), friction=float(random.uniform(0.3, 0.9)),
        kinetic_share=float(random.uniform(0.7, 1.0)),
    )  # fmt: skip


def run_trial(
    seed: int, *, thing: GraspObject | None = None, pace: bool = False, seconds: float = SECONDS
) -> Trial:
    """Grasp, lift and pull one object; the same for the same seed.

    `pace` limits it to real time; on a slow machine no cycle is left out.
    """
    thing = unknown_object(seed) if thing is None else thing
    with grasp("gripper", objects=[thing], seed=seed) as world:
        began_s = time.monotonic()
        control = GripControl(world.skin.topology, SimulatedGripper(world))
        trial = Trial(thing)
        for state in world:
            control.update(state)
            pull_n = _play(world, thing, control.is_tested)
            _note(trial, world, control, pull_n)
            if world.time_s >= seconds - 1e-9:
                break
            if pace:
                time.sleep(max(0.0, began_s + world.time_s - time.monotonic()))
        trial.slips = control.slips
    return trial


def _play(world: World, thing: GraspObject, hangs: bool) -> float:
    """Lift the hand and pull the object as scheduled; returns the pull in newton."""
    time_s, period_s = world.time_s, 1.0 / world.skin.topology.cycle_rate_hz
    height_m = world.joints.targets["lift"]
    if time_s > TRY_S:
        height_m = min(height_m + (LIFT_M_PER_S if hangs else TRY_M_PER_S) * period_s, LIFT_M)
    world.joints["lift"] = height_m
    rise = np.clip((time_s - PULL_S) / GENTLE_S, 0.0, 1.0)
    fall = np.clip((time_s - PULLED_S) / GENTLE_S, 0.0, 1.0)
    pull_n = float(PULL_SHARE * 9.81 * thing.mass_kg * (rise - fall))
    world.push(thing.name, (0.0, 0.0, -pull_n))
    return pull_n


def _note(trial: Trial, world: World, control: GripControl, pull_n: float) -> None:
    truth = world.truth
    height_m, hand_m = float(truth.position[2, 0]), world.joints["lift"]
    trial.time_s.append(world.time_s)
    trial.load_n.append(control.load_n)
    trial.true_load_n.append(float(truth.normal_n.sum()) / 2.0)
    trial.shear_n.append(control.shear_n)
    trial.wanted_n.append(control.wanted_n)
    trial.margin.append(control.margin)
    trial.true_margin.append(truth.margin())
    trial.belief.append(control.friction)
    trial.height_m.append(height_m)
    trial.hand_m.append(hand_m)
    trial.slid_m.append(hand_m - height_m)
    trial.gap_m.append(OPEN_M - world.joints["left"] - world.joints["right"])
    trial.pull_n.append(pull_n)
    trial.slipping.append(int(truth.slipping.sum()))
