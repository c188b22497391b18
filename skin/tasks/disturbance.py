"""A held object is pulled and turned, as in the paper's Fig. 4c: rest, pulls, recovery.

The object stands on the floor between the pads, is grasped and lifted; then 3 s pass at rest, it is
pulled for 4 s in directions and by forces that nobody knows, and 3 s pass again. The tangential
load goes where the paper's did, scaled to the weight: there 0.8 N hung, and the load went from
-0.62 N to 1.24 N sideways, from 0.08 N to 1.56 N downwards [paper, Fig. 4c].
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from skin.behaviours.decision import Decision
from skin.behaviours.grip import GripControl
from skin.behaviours.grip_parameters import GripParameters
from skin.grasp.episode import Episode
from skin.grasp.world import World, grasp
from skin.sim.engine.object import GraspObject
from skin.state import State
from skin.tasks.simulated_gripper import SimulatedGripper
from topology import Topology, load

__all__ = ["DROPPED_M", "Case", "Disturbance", "case_of", "run_disturbance"]

G = 9.81
REST_S, PULLED_S, DONE_S = 3.0, 7.0, 10.0
"""Ends of the paper's phases, since the object was lifted [paper]."""

PAPER_WEIGHT_N = 0.8
SIDEWAYS, DOWNWARDS = (-0.62, 1.24), (0.08, 1.56)
"""Newton, tangential loads of the paper."""

KNOT_S = (0.2, 0.6)
"""From one pull to the next, in which it rises or falls [assumed: a hand's]."""

ARM_M, TURN = 0.012, 0.25
"""Torque about the pads' normal: share of the weight at this arm [assumed]."""

LIFT_M, LIFT_M_PER_S = 0.015, 0.03
GRASPED_S = 4.0
"""By when it must hang [assumed]."""

DROPPED_M = 0.01
"""How far it may go along the pads."""

DEAD = 2
"""Units that feel nothing, in a third of the cases."""

START_M = 0.004
"""From which distance the pads begin to close."""

OPEN_M = 0.045
"""From the middle to a pad of the open gripper."""

KINETIC = (0.85, 1.0)
"""Friction in motion over that at rest [assumed: silicone slides about as hard as it sticks]."""

OFF_M = 0.003
"""How far from the middle of the pads it stands, at most."""


class Case(NamedTuple):
    """What is pulled, and how.

    Attributes
    ----------
    thing : GraspObject
    knots_s : ndarray, shape (k,)
        Since it was lifted.
    pull_n : ndarray, shape (2, k)
        Sideways (y) and upwards (z) in newton, on the object.
    torque_nm : ndarray, shape (k,)
        About the pads' normal (x).
    dead : ndarray
        Units that feel nothing.
    """

    thing: GraspObject
    knots_s: np.ndarray
    pull_n: np.ndarray
    torque_nm: np.ndarray
    dead: np.ndarray

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Pull sideways and upwards, newton, and torque, newton metre."""
        if not self.knots_s[0] < time_s < self.knots_s[-1]:
            return 0.0, 0.0, 0.0
        k = int(np.searchsorted(self.knots_s, time_s)) - 1
        share = (time_s - self.knots_s[k]) / (self.knots_s[k + 1] - self.knots_s[k])
        share = 0.5 - 0.5 * np.cos(np.pi * share)
        y, z = self.pull_n[:, k] + share * (self.pull_n[:, k + 1] - self.pull_n[:, k])
        turn = self.torque_nm[k] + share * (self.torque_nm[k + 1] - self.torque_nm[k])
        return float(y), float(z), float(turn)


@dataclass
class Disturbance:
    """What happened, cycle by cycle; shear is the sum of both pads, load that of one.

    Attributes
    ----------
    case : Case
    lifted_s : float
        When it hung; NaN if never.
    time_s, load_n, true_load_n, wanted_n, needed_n, friction : list of float
        Of each pad; `needed_n` is the least grip that holds, by the truth.
    side_n, down_n, true_side_n, true_down_n : list of float
        Tangential load of both pads along y and against z.
    margin : list of float
        Of the truth: friction at rest times grip, over the tangential load, minus 1.
    slipping : list of int
        Units whose face really slips.
    slid_m : list of float
    work_us : list of float
        Of the control, each cycle.
    decisions : tuple of Decision
    """

    case: Case
    lifted_s: float = float("nan")
    time_s: list[float] = field(default_factory=list)
    load_n: list[float] = field(default_factory=list)
    true_load_n: list[float] = field(default_factory=list)
    wanted_n: list[float] = field(default_factory=list)
    needed_n: list[float] = field(default_factory=list)
    friction: list[float] = field(default_factory=list)
    side_n: list[float] = field(default_factory=list)
    down_n: list[float] = field(default_factory=list)
    true_side_n: list[float] = field(default_factory=list)
    true_down_n: list[float] = field(default_factory=list)
    margin: list[float] = field(default_factory=list)
    slipping: list[int] = field(default_factory=list)
    slid_m: list[float] = field(default_factory=list)
    work_us: list[float] = field(default_factory=list)
    decisions: tuple[Decision, ...] = ()
    slips: int = 0

    @property
    def dropped(self) -> bool:
        """Whether it went along the pads, or never hung."""
        return not np.isfinite(self.lifted_s) or max(self.slid_m) > DROPPED_M

    @property
    def clock_s(self) -> np.ndarray:
        """Time since it hung, shape (t,)."""
        return np.array(self.time_s) - self.lifted_s


def case_of(seed: int, topology: Topology) -> Case:
    """What is drawn by a seed: mass 30 to 300 g, friction 0.3 to 0.9, pulls, dead units."""
    random = np.random.default_rng((seed, 4))
    half_m = 0.03
    is_box = random.random() < 0.5
    width_m = random.uniform(0.012, 0.03)
    size = (width_m, random.uniform(0.012, 0.03), half_m) if is_box else (width_m, half_m)
    thing = GraspObject(
        name="object", shape="box" if is_box else "cylinder", size_m=size,
        mass_kg=float(random.uniform(0.03, 0.3)), friction=float(random.uniform(0.3, 0.9)),
        kinetic_share=float(random.uniform(*KINETIC)),
        position_m=(0.0, float(random.uniform(-OFF_M, OFF_M)), 0.0),
    )  # fmt: skip
    knots = [REST_S]
    while knots[-1] < PULLED_S - 2 * KNOT_S[0]:
        knots.append(min(knots[-1] + random.uniform(*KNOT_S), PULLED_S - KNOT_S[0]))
    knots_s = np.array([*knots, PULLED_S])
    weight_n, scale = G * thing.mass_kg, G * thing.mass_kg / PAPER_WEIGHT_N
    side = random.uniform(*SIDEWAYS, knots_s.size) * scale
    down = random.uniform(*DOWNWARDS, knots_s.size) * scale
    torque = random.uniform(-TURN, TURN, knots_s.size) * weight_n * ARM_M
    pull = np.array([side, weight_n - down])
    pull[:, [0, -1]], torque[[0, -1]] = 0.0, 0.0
    is_third = random.random() < 1.0 / 3.0
    dead = random.permutation(topology.n)[: DEAD if is_third else 0]
    return Case(thing, knots_s, pull, torque, dead)


def run_disturbance(
    seed: int, *, parameters: GripParameters | None = None, pace: bool = False
) -> Disturbance:
    """Grasp, lift and pull one object; the same for the same seed.

    With `pace` no faster than real time; where the machine is too slow, no cycle is left out.
    """
    topology = load("gripper")
    case = case_of(seed, topology)
    gain = np.ones((3, topology.n))
    gain[:, case.dead] = 0.0
    with grasp(topology, objects=[case.thing], episode=Episode(gain=gain), seed=seed) as world:
        return _played(world, case, parameters, pace)


def _played(world: World, case: Case, parameters: GripParameters | None, pace: bool) -> Disturbance:
    began_s = time.monotonic()
    gripper = SimulatedGripper(world)
    gripper.target_m = max(OPEN_M - case.thing.size_m[0] - START_M, 0.0)
    control = GripControl(world.skin.topology, gripper, parameters)
    control.is_steady = False
    told = Disturbance(case)
    for state in world:
        started = time.perf_counter()
        control.update(state)
        told.work_us.append(1e6 * (time.perf_counter() - started))
        if np.isnan(told.lifted_s):
            _lift(world, control, told)
        since_s = world.time_s - told.lifted_s
        side, up, turn = case.at(since_s)
        world.push(case.thing.name, (0.0, side, up), (turn, 0.0, 0.0))
        _note(told, world, control, state)
        if since_s >= DONE_S or (np.isnan(since_s) and world.time_s > GRASPED_S):
            break
        if pace:
            time.sleep(max(0.0, began_s + world.time_s - time.monotonic()))
    told.decisions = tuple(control.decisions)
    told.slips = control.slips
    return told


def _lift(world: World, control: GripControl, told: Disturbance) -> None:
    """Raise the hand, once the object is gripped."""
    height_m = world.joints.targets["lift"]
    if height_m == 0.0 and control.load_n < 0.9 * control.parameters.first_grip_n:
        return
    height_m += LIFT_M_PER_S / world.skin.topology.cycle_rate_hz
    world.joints["lift"] = min(height_m, LIFT_M)
    control.is_steady = height_m >= LIFT_M
    if control.is_steady:
        told.lifted_s = world.time_s


def _note(told: Disturbance, world: World, control: GripControl, state: State) -> None:
    truth, units = world.truth, state.units
    turn = world.skin.topology.rotation
    felt = np.einsum("ijn,jn->i", turn, np.where(units.valid, units.force, 0.0))
    real = np.einsum("ijn,jn->i", turn, truth.units.force)
    drag_n = float(np.hypot(real[1], real[2]))
    load_n = 0.5 * float(truth.normal_n.sum())
    offset = truth.position[1:, 0] - (told.case.thing.position_m[1], world.joints["lift"])
    told.time_s.append(world.time_s)
    told.load_n.append(control.load_n)
    told.true_load_n.append(load_n)
    told.wanted_n.append(control.wanted_n)
    needed_n = 0.5 * drag_n / told.case.thing.friction
    told.needed_n.append(needed_n)
    told.friction.append(control.friction)
    told.side_n.append(float(felt[1]))
    told.down_n.append(float(-felt[2]))
    told.true_side_n.append(float(real[1]))
    told.true_down_n.append(float(-real[2]))
    told.margin.append(load_n / needed_n - 1.0 if needed_n > 0.0 else float("nan"))
    told.slipping.append(int(truth.slipping.sum()))
    told.slid_m.append(float(np.hypot(*offset)))
