"""Disturbance of a held object, as in the paper's Fig. 4c: rest, pulls, recovery.

The object stands on the floor between the pads, is grasped and lifted; then 3 s pass at rest, it is
pulled for 4 s with unknown directions and forces, and 3 s pass again. The tangential load follows
the paper's, scaled to the weight: there it hung with 0.8 N, and the load went from -0.62 N to 1.24
N sideways, from 0.08 N to 1.56 N downwards [paper, Fig. 4c].
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from skin.behaviours.decision import Decision
from skin.behaviours.grip import GripControl
from skin.behaviours.grip_parameters import GripParameters
from skin.demos.simulated_gripper import SimulatedGripper
from skin.grasp.episode import Episode
from skin.grasp.object import GraspObject
from skin.grasp.world import World, grasp
from skin.state import State
from topology import Topology, load

__all__ = [
    "DROPPED_M", "Case", "Disturbance", "case_of", "knots_between", "loads_at", "run_disturbance",
]  # fmt: skip

G = 9.81
REST_S, PULLED_S, DONE_S = 3.0, 7.0, 10.0
"""Ends of the paper's phases, from the lift on [paper]."""

PAPER_WEIGHT_N = 0.8
SIDEWAYS, DOWNWARDS = (-0.62, 1.24), (0.08, 1.56)
"""Newton, tangential loads of the paper."""

KNOT_S = (0.2, 0.6)
"""Duration of the transition from one pull to the next [assumed: a hand's]."""

ARM_M, TURN = 0.012, 0.25
"""Torque about the pads' normal: fraction of the weight times this arm [assumed]."""

LIFT_M, LIFT_M_PER_S = 0.015, 0.03
GRASPED_S = 4.0
"""Time by which it must hang [assumed]."""

DROPPED_M = 0.01
"""Longest allowed slide along the pads."""

DEAD = 2
"""Dead units, in a third of the cases."""

START_M = 0.004
"""Distance at which the pads begin to close."""

OPEN_M = 0.045
"""Distance from the middle to a pad of the open gripper."""

KINETIC = (0.85, 1.0)
"""Kinetic over static friction [assumed: silicone slides about as hard as it sticks]."""

OFF_M = 0.003
"""Largest distance of the object from the middle of the pads."""


class Case(NamedTuple):
    """An object and its pulls.

    Attributes
    ----------
    thing : GraspObject
    knots_s : ndarray, shape (k,)
        Time since the lift.
    pull_n : ndarray, shape (2, k)
        Sideways (y) and upwards (z) in newton, on the object.
    torque_nm : ndarray, shape (k,)
        About the pads' normal (x).
    dead : ndarray
        Units without response.
    """

    thing: GraspObject
    knots_s: np.ndarray
    pull_n: np.ndarray
    torque_nm: np.ndarray
    dead: np.ndarray

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Pull sideways and upwards, newton, and torque, newton metre."""
        return loads_at(self.knots_s, np.vstack([self.pull_n, self.torque_nm]), time_s)


def knots_between(random: np.random.Generator, begin_s: float, end_s: float) -> list[float]:
    """Times between which loads change, from `begin_s` to `end_s`."""
    knots = [begin_s]
    while knots[-1] < end_s - 2 * KNOT_S[0]:
        knots.append(min(knots[-1] + float(random.uniform(*KNOT_S)), end_s - KNOT_S[0]))
    return [*knots, end_s]


def loads_at(knots_s: np.ndarray, loads: np.ndarray, time_s: float) -> tuple[float, float, float]:
    """Two forces and a torque, shape (3, k), by half cosines between k knots; 0 outside."""
    if not knots_s[0] < time_s < knots_s[-1]:
        return 0.0, 0.0, 0.0
    k = int(np.searchsorted(knots_s, time_s)) - 1
    share = (time_s - knots_s[k]) / (knots_s[k + 1] - knots_s[k])
    share = 0.5 - 0.5 * np.cos(np.pi * share)
    y, z, turn = (loads[:, k] + share * (loads[:, k + 1] - loads[:, k])).tolist()
    return y, z, turn


@dataclass
class Disturbance:
    """Record of a run, cycle by cycle; shear is the sum of both pads, load that of one.

    Attributes
    ----------
    case : Case
    lifted_s : float
        Time of the lift; NaN if it failed.
    time_s, load_n, true_load_n, wanted_n, needed_n, friction : list of float
        Per pad; `needed_n` is the least grip that holds, by the truth.
    side_n, down_n, true_side_n, true_down_n : list of float
        Tangential load of both pads along y and against z.
    margin : list of float
        Of the truth: static friction times grip, over the tangential load, minus 1.
    slipping : list of int
        Units whose face slips, by the truth.
    slid_m : list of float
    work_us : list of float
        Of the control, per cycle.
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
        """Whether it slid along the pads, or was never lifted."""
        return not np.isfinite(self.lifted_s) or max(self.slid_m) > DROPPED_M

    @property
    def clock_s(self) -> np.ndarray:
        """Time since the lift, shape (t,)."""
        return np.array(self.time_s) - self.lifted_s


def case_of(seed: int, topology: Topology) -> Case:
    """A case drawn by a seed: mass 30 to 300 g, friction 0.3 to 0.9, pulls, dead units."""
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
    knots_s = np.array(knots_between(random, REST_S, PULLED_S))
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
    seed: int, *, parameters: GripParameters | None = None, pace: bool = False,
    delay_s: float = 0.0,
) -> Disturbance:  # fmt: skip
    """Grasp, lift and pull one object; the same for the same seed.

    `pace` limits it to real time; on a slow machine no cycle is left out. `delay_s` is that of the
    gripper.
    """
    topology = load("gripper")
    case = case_of(seed, topology)
    gain = np.ones((3, topology.n))
    gain[:, case.dead] = 0.0
    with grasp(topology, objects=[case.thing], episode=Episode(gain=gain), seed=seed) as world:
        gripper = SimulatedGripper(world, delay_s=delay_s)
        return _played(world, case, gripper, parameters, pace)


def _played(
    world: World, case: Case, gripper: SimulatedGripper, parameters: GripParameters | None,
    pace: bool,
) -> Disturbance:  # fmt: skip
    began_s = time.monotonic()
    gripper.target_m = max(OPEN_M - case.thing.size_m[0] - START_M, 0.0)
    control = GripControl(world.skin.topology, gripper, parameters)
    control.is_steady = False
    run = Disturbance(case)
    for state in world:
        started = time.perf_counter()
        control.update(state)
        run.work_us.append(1e6 * (time.perf_counter() - started))
        if np.isnan(run.lifted_s):
            _lift(world, control, run)
        since_s = world.time_s - run.lifted_s
        side, up, turn = case.at(since_s)
        world.push(case.thing.name, (0.0, side, up), (turn, 0.0, 0.0))
        _note(run, world, control, state)
        if since_s >= DONE_S or (np.isnan(since_s) and world.time_s > GRASPED_S):
            break
        if pace:
            time.sleep(max(0.0, began_s + world.time_s - time.monotonic()))
    run.decisions = tuple(control.decisions)
    run.slips = control.slips
    return run


def _lift(world: World, control: GripControl, run: Disturbance) -> None:
    """Raise the hand, once the object is gripped."""
    height_m = world.joints.targets["lift"]
    if height_m == 0.0 and control.load_n < 0.9 * control.parameters.first_grip_n:
        return
    height_m += LIFT_M_PER_S / world.skin.topology.cycle_rate_hz
    world.joints["lift"] = min(height_m, LIFT_M)
    control.is_steady = height_m >= LIFT_M
    if control.is_steady:
        run.lifted_s = world.time_s


def _note(run: Disturbance, world: World, control: GripControl, state: State) -> None:
    truth, units = world.truth, state.units
    turn = world.skin.topology.rotation
    felt = np.einsum("ijn,jn->i", turn, np.where(units.valid, units.force, 0.0))
    real = np.einsum("ijn,jn->i", turn, truth.units.force)
    drag_n = float(np.hypot(real[1], real[2]))
    load_n = 0.5 * float(truth.normal_n.sum())
    offset = truth.position[1:, 0] - (run.case.thing.position_m[1], world.joints["lift"])
    run.time_s.append(world.time_s)
    run.load_n.append(control.load_n)
    run.true_load_n.append(load_n)
    run.wanted_n.append(control.wanted_n)
    needed_n = 0.5 * drag_n / run.case.thing.friction
    run.needed_n.append(needed_n)
    run.friction.append(control.friction)
    run.side_n.append(float(felt[1]))
    run.down_n.append(float(-felt[2]))
    run.true_side_n.append(float(real[1]))
    run.true_down_n.append(float(-real[2]))
    run.margin.append(load_n / needed_n - 1.0 if needed_n > 0.0 else float("nan"))
    run.slipping.append(int(truth.slipping.sum()))
    run.slid_m.append(float(np.hypot(*offset)))
