"""Trials of the grip control on brushes: unknown things, late grippers, units that feel nothing.

What a user has is in the loop: counts of the plant of `benchmarks.trust_plant` (films as dipoles,
each felt by all chips near it, noise, rounding), a calibrated and tared skin with the defaults of
`skin.open`, `GripControl`, and an adapter of the gripper. Not in it: frames and their assembly, and
a clock (each cycle is in time).

A thing stands on a floor between the pads, is gripped, lifted by 15 mm, rests for 3 s, is pulled as
in the paper's Fig. 4c, scaled to its weight, until 6.5 s, and is let alone until 10 s. In half of
the trials somebody bears most of its weight after the pulls, and lets go within 10 to 50 ms.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from benchmarks.brush_gripper import LateGripper, Servo
from benchmarks.brush_pads import FACES, Body, Pads
from benchmarks.trust_plant import Touch
from benchmarks.trust_quick import QuickPlant
from benchmarks.trust_skin import BAG, Player, Skin, skin_of
from fig4c_adaptive_grasp import DOWNWARDS, DROPPED_M, PAPER_WEIGHT_N, SIDEWAYS
from shared.people import knots_between, loads_at
from skin.behaviours import Decision
from skin.behaviours.grip import GripControl, GripParameters

__all__ = ["Cell", "Fixed", "Trial", "run_trial", "thing_of"]

G = 9.81
REST_END_S, PULLED_S, DONE_S = 3.0, 6.5, 10.0
"""From the end of the lift on."""
GRASPED_S = 4.0
"""By when it must be lifted [assumed]."""
LIFT_MM, LIFT_S = 15.0, 0.5
AWAY_MM = 4.0
TURN, ARM_MM = 0.25, 12.0
"""Torque of a pull: share of the weight times this arm [assumed]."""
OFF_MM = 3.0
WEIGHT_N, FRICTION = (0.3, 3.0), (0.3, 0.9)
KINETIC, BRITTLE = (0.85, 1.0), (0.6, 1.0)
"""Friction in motion over that at rest: of cells, and of the mixed one."""
RADIUS_MM, HALF_MM = (15.0, 30.0), (12.0, 30.0)
SOFT_MM_PER_N = 1.0
BEAR_S, BEAR, LET_GO_S = 7.0, (0.8, 1.1), (0.01, 0.05)
"""When somebody bears the thing, how much of its weight, and how quickly he lets go."""
DELAYS_S = (0.0, 0.02, 0.04, 0.06)


class Cell(NamedTuple):
    """What is alike in the trials of a cell; None: drawn."""

    delay_s: float | None = None
    face: str | None = None
    stuck: int | None = None
    mixed: bool = False


class Thing(NamedTuple):
    """What is drawn for a trial: a body, its gripper, its pulls, and units that feel nothing."""

    body: Body
    servo: Servo
    place_mm: tuple[float, float]
    knots_s: np.ndarray
    pull: np.ndarray
    stuck: np.ndarray
    let_go_s: float

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Pull along y and z, and torque, half cosines between the knots."""
        return loads_at(self.knots_s, self.pull, time_s)


@dataclass
class Trial:
    """Record of a trial, cycle by cycle; loads are of one pad, by the truth if not `felt`.

    Attributes
    ----------
    thing : Thing
    lifted_s : float
        End of the lift; NaN if it failed.
    time_s, grip_n, felt_n, wanted_n, drag_n, felt_drag_n, offset_mm, slid : list of float
        `drag_n` is half of the tangential load; `slid` the share of the load on bristles that
        slide. A thing that falls lands on the floor after 15 mm.
    decisions : tuple of Decision
    """

    thing: Thing
    lifted_s: float = float("nan")
    time_s: list[float] = field(default_factory=list)
    grip_n: list[float] = field(default_factory=list)
    felt_n: list[float] = field(default_factory=list)
    wanted_n: list[float] = field(default_factory=list)
    drag_n: list[float] = field(default_factory=list)
    felt_drag_n: list[float] = field(default_factory=list)
    offset_mm: list[float] = field(default_factory=list)
    slid: list[float] = field(default_factory=list)
    decisions: tuple[Decision, ...] = ()

    @property
    def dropped(self) -> bool:
        """Whether it moved along the pads by more than 10 mm, or was never lifted."""
        return not np.isfinite(self.lifted_s) or max(self.offset_mm) > 1e3 * DROPPED_M


class Fixed:
    """A grip that never changes, with the part of `GripControl` that trials use."""

    def __init__(self, gripper: LateGripper, grip_n: float) -> None:
        self.gripper, self.wanted_n = gripper, grip_n
        self.load_n, self.shear_n, self.is_steady = float("nan"), float("nan"), False
        self.decisions: tuple[Decision, ...] = ()

    def update(self, _state: Any) -> None:
        """Squeeze."""
        self.gripper.squeeze(self.wanted_n, float("nan"))


def thing_of(seed: int, cell: Cell, n: int = 32) -> Thing:
    """A trial drawn by a seed; the same draws in every cell, as far as the cell leaves them."""
    rng = np.random.default_rng((seed, 52))
    weight_n = float(np.exp(rng.uniform(*np.log(WEIGHT_N))))
    friction, kinetic = float(rng.uniform(*FRICTION)), float(rng.uniform())
    faces, delays, stucks = rng.integers(4), rng.integers(4), rng.integers(5)
    face = FACES[faces] if cell.face is None else cell.face
    low, high = BRITTLE if cell.mixed else KINETIC
    body = Body(
        face, weight_n / G, friction, low + (high - low) * kinetic,
        (float(rng.uniform(*HALF_MM)), 30.0), float(rng.uniform(*RADIUS_MM)),
        SOFT_MM_PER_N if face == "soft" else 0.0,
    )  # fmt: skip
    place = float(rng.uniform(-OFF_MM, OFF_MM)), float(rng.uniform(-OFF_MM, OFF_MM))
    lag, stiction, rate, felt = rng.uniform(size=4)
    delay_s = DELAYS_S[delays] if cell.delay_s is None else cell.delay_s
    servo = Servo(delay_s)
    if cell.mixed:
        servo = Servo(delay_s, 0.005 + 0.025 * lag, 0.3 * stiction, 30.0 + 170.0 * rate, felt < 0.5)
    knots = knots_between(rng, REST_END_S, PULLED_S)
    scale = weight_n / PAPER_WEIGHT_N
    pull = np.stack([
        scale * rng.uniform(*SIDEWAYS, len(knots)),
        weight_n - scale * rng.uniform(*DOWNWARDS, len(knots)),
        weight_n * ARM_MM * rng.uniform(-TURN, TURN, len(knots)),
    ])  # fmt: skip
    pull[:, [0, -1]] = 0.0
    bears = rng.uniform() < 0.5
    rise_s, hold_s = rng.uniform(0.2, 0.5), rng.uniform(0.2, 1.0)
    borne, off_s = rng.uniform(*BEAR) * weight_n, rng.uniform(*LET_GO_S)
    let_go_s = float("nan")
    if bears:
        let_go_s = BEAR_S + rise_s + hold_s
        knots += [BEAR_S, BEAR_S + rise_s, let_go_s, let_go_s + off_s]
        up = np.zeros((3, 4))
        up[1, 1:3] = borne
        pull = np.concatenate([pull, up], axis=1)
    count = int(stucks) if cell.stuck is None else cell.stuck
    stuck = rng.permutation(n)[:count]
    return Thing(body, servo, place, np.array(knots), pull, stuck, let_go_s)


@lru_cache(4)
def plant_of(bag: int) -> tuple[Skin, QuickPlant]:
    """The gripper's skin, and its units as they are."""
    skin = skin_of("gripper", bag=bag)
    return skin, QuickPlant(skin)


def run_trial(
    seed: int, cell: Cell, *, parameters: GripParameters | None = None,
    fixed_n: float | None = None, bag: int = BAG,
) -> Trial:  # fmt: skip
    """Grip, lift and pull one thing; the same for the same seed.

    Parameters
    ----------
    seed : int
    cell : Cell
    parameters : GripParameters, optional
    fixed_n : float, optional
        A grip that never changes, in place of the control: no unit is read then.
    bag : int
        See `benchmarks.trust_skin.skin_of`.
    """
    skin, plant = plant_of(bag)
    thing = thing_of(seed, cell, skin.n)
    period_s = 1.0 / skin.rate_hz
    gripper = LateGripper(thing.servo, period_s, AWAY_MM)
    control: Any = (Fixed(gripper, fixed_n) if fixed_n is not None
                    else GripControl(skin.known, gripper, parameters))  # fmt: skip
    control.is_steady = False
    pads, place = pads_of(skin, thing, seed), _Place(skin)
    rng = np.random.default_rng((seed, 53))
    states = None if fixed_n is not None else _States(skin, plant, rng)
    trial, lift_s, first_n = Trial(thing), float("nan"), GripParameters().first_grip_n
    start, raised = np.array(thing.place_mm), 0.0
    for cycle in range(round((GRASPED_S + DONE_S) / period_s)):
        time_s = cycle * period_s
        forces = place.unit_forces(pads.forces())
        state = None if states is None else states.next(forces, thing.stuck)
        control.update(state)
        if np.isnan(lift_s) and gripper.force_n >= 0.9 * min(first_n, control.wanted_n):
            lift_s = time_s
        clock_s = time_s - lift_s - LIFT_S
        control.is_steady = clock_s >= 0.0
        if control.is_steady and np.isnan(trial.lifted_s):
            trial.lifted_s = time_s
        raised, lifts = _lifted(clock_s + LIFT_S)
        grip_n = gripper.step()
        pads.step(grip_n, period_s, thing.at(clock_s), start[1] - raised, lifts)
        _note(trial, time_s, grip_n, control, pads, start)
        if clock_s >= DONE_S or (np.isnan(clock_s) and time_s > GRASPED_S):
            break
        if trial.offset_mm[-1] > 2e3 * DROPPED_M and clock_s > 0.0:
            break
    trial.decisions = tuple(control.decisions)
    return trial


def pads_of(skin: Skin, thing: Thing, seed: int | None) -> Pads:
    """Brushes in the places of the gripper's units, with the laws of each."""
    position, true = 1e3 * skin.known.position, skin.plant.true
    slope = true["frequency_slope_hz_per_mm"]
    normal = np.stack([true["normal_soft_n_per_hz"] * slope, true["normal_break_hz"] / slope,
                       true["normal_stiff_n_per_hz"] * slope])  # fmt: skip
    soft, knee = true["shear_soft_n_per_mm"], true["shear_break_mm"]
    shear = np.stack([soft, knee, soft + true["shear_stiff_n_per_mm"]])
    middle = position[1:].mean(axis=1, keepdims=True)
    return Pads(position[1:] - middle, skin.known.patch, normal, shear, thing.body,
                thing.place_mm, seed)  # fmt: skip


def _lifted(since_s: float) -> tuple[float, float]:
    """Height of the hand, mm, and its acceleration, m/s²: half a cosine."""
    if not since_s > 0.0:
        return 0.0, 0.0
    share = min(since_s / LIFT_S, 1.0)
    rate = np.pi / LIFT_S
    lifts = 0.5e-3 * LIFT_MM * rate * rate * np.cos(np.pi * share) if share < 1.0 else 0.0
    return float(0.5 * LIFT_MM * (1.0 - np.cos(np.pi * share))), float(lifts)


def _note(
    trial: Trial, time_s: float, grip_n: float, control: Any, pads: Pads, start: np.ndarray
) -> None:
    trial.time_s.append(time_s)
    trial.grip_n.append(grip_n)
    trial.felt_n.append(control.load_n)
    trial.wanted_n.append(control.wanted_n)
    trial.drag_n.append(0.5 * float(np.hypot(*pads.data.drag[:2])))
    trial.felt_drag_n.append(control.shear_n)
    trial.offset_mm.append(float(np.hypot(*(pads.offset_mm - start))))
    trial.slid.append(float(pads.data.slid[0]))


class _Place:
    """From the plane of the pads to the frames of the units."""

    def __init__(self, skin: Skin) -> None:
        self._rotation = skin.known.rotation

    def unit_forces(self, forces: np.ndarray) -> np.ndarray:
        """Forces along y, z and into the pad, shape (3, n), in the units' frames."""
        turn = self._rotation
        out = turn[1] * forces[0] + turn[2] * forces[1]
        out[2] = forces[2]
        return out


class _States:
    """States of an open skin, fed with the counts of the plant."""

    def __init__(self, skin: Skin, plant: QuickPlant, rng: np.random.Generator) -> None:
        self._plant, self._rng = plant, rng
        self._counts = np.zeros((1, *plant.counts(Touch.none(1, skin.n), None).shape[1:]), np.int16)
        self._states = Player(skin.known).play(self._endless())
        rest = plant.counts(skin.resting(), rng)
        for counts in rest:
            self._counts[0] = counts
            next(self._states)

    def _endless(self) -> Iterator[np.ndarray]:
        while True:
            yield self._counts[0]

    def next(self, forces: np.ndarray, stuck: np.ndarray) -> Any:
        """The state under forces in the units' frames, shape (3, n)."""
        plant = self._plant
        depth = plant.depth_at(forces[2])
        size = np.hypot(forces[0], forces[1])
        per_n = np.divide(plant.length_at(size), size, out=np.zeros_like(size), where=size > 0.0)
        moved = per_n * forces[:2]
        depth[stuck], moved[:, stuck] = 0.0, 0.0
        touch = Touch(depth[np.newaxis], moved[np.newaxis])
        self._counts[0] = plant.counts(touch, self._rng)[0]
        return next(self._states)
