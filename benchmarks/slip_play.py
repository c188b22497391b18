"""What happens when a body presses, slides and turns on a skin: truth, by the simulator.

Faces are springs on an elastic half space that couples them all (`benchmarks.half_space`), a body
of its own shape and compliance presses and drags them through Coulomb's return map, on flat and
curved skins, and the elastomer relaxes. `benchmarks.slip_scenes` draws the plans.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from pathlib import Path

import numpy as np

from benchmarks.half_space import HalfSpace
from skin.physics.elastic import Elastic
from skin.physics.halbach import HalbachField
from skin.sim.mechanics.body import Body, Pose, penetration
from skin.sim.mechanics.contact import Mechanics
from skin.sim.mechanics.springs import Springs
from skin.sim.mechanics.viscoelastic import Prony
from topology import Topology, load

__all__ = [
    "FIRST",
    "GROSS",
    "ONSET",
    "PITCH_M",
    "RATE_HZ",
    "SETTLE_S",
    "SKINS",
    "Plan",
    "Trial",
    "lasting",
    "play",
    "pressed",
    "reached_mm",
    "skin_of",
    "turned",
]  # fmt: skip

SKINS = {
    "flat": 'kind = "grid"\nrows = 8\ncolumns = 8',
    "cylinder": 'kind = "cylinder"\nrows = 8\ncolumns = 8\nradius_m = 0.06',
    "dome": 'kind = "dome"\nrings = 4\nradius_m = 0.15',
}
PITCH_M = 0.012
RATE_HZ = 250.0
SETTLE_S = 0.4
FARTHEST_MM, DEEPEST_MM = 2.45, 2.9
"""What units can be asked to see."""
FIRST, ONSET, GROSS = 0.02, 0.1, 0.95
"""Shares of the load that have slipped: below the first nothing slips; slip begins; all slides."""
STICKS = 1e6
"""Coefficient of friction at which nothing slips."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """One trial: a body comes down on a skin, rests, and is dragged and turned.

    Attributes
    ----------
    kind : str
        Of `KINDS`.
    skin : str
        Key of `SKINS`.
    body : Body
    lean : Pose
        Attitude of the body, and its place when it just touches the skin's apex.
    depth_mm : float
        How far it is pressed.
    friction, kinetic : ndarray, shape (n,)
        Coefficients of each face at rest and in motion.
    modulus_pa : float
        Of the half space; infinite: each unit for itself.
    press_s : float
        How long it takes to come down.
    speed_mm_s : float
        Of the fastest face in contact.
    heading_rad, turn_rad_per_mm : float
        Where it goes, and how much it turns about its `pivot_m` meanwhile.
    slide : float
        0 where it turns on the spot, else 1.
    farthest_mm : float
        Where it stops.
    modulation, modulation_hz : float
        Share of the load by which the grip comes and goes, and how often.
    seed : int
        Of what units see.
    rate_hz, pitch_m : float
        Of the skin.
    longest_s : float
        How long it lasts at most.
    roll_per_m : float
        Inverse radius on which the body rolls off its way; 0: it slides.
    shake_mm, shake_hz, shake_rad : float
        Amplitude and frequency at which it shakes along the skin, and where to.
    """

    kind: str
    skin: str
    body: Body
    lean: Pose
    depth_mm: float
    friction: np.ndarray
    kinetic: np.ndarray
    modulus_pa: float
    press_s: float
    speed_mm_s: float
    heading_rad: float
    turn_rad_per_mm: float
    pivot_m: tuple[float, float]
    slide: float = 1.0
    farthest_mm: float = np.inf
    modulation: float = 0.0
    modulation_hz: float = 1.0
    seed: int = 0
    rate_hz: float = RATE_HZ
    pitch_m: float = PITCH_M
    longest_s: float = 6.0
    roll_per_m: float = 0.0
    shake_mm: float = 0.0
    shake_hz: float = 0.0
    shake_rad: float = 0.0

    @property
    def begins_s(self) -> float:
        """When the body begins to move along the skin, or the grip to come and go."""
        return self.press_s + SETTLE_S


@dataclass(frozen=True)
class Trial:
    """What really happened; t cycles, n units.

    Attributes
    ----------
    plan : Plan
    time_s : ndarray, shape (t,)
    force : ndarray, shape (t, 3, n)
        Newton.
    displacement_mm : ndarray, shape (t, 3, n)
        Of the units, relaxed.
    share : ndarray, shape (t,)
        Share of the load on faces that have slipped since they were touched, and since the plan
        began to move; what slipped on the way down is not carried on.
    travel_mm : ndarray, shape (t,)
    """

    plan: Plan
    time_s: np.ndarray
    force: np.ndarray
    displacement_mm: np.ndarray
    share: np.ndarray
    travel_mm: np.ndarray

    @property
    def moving(self) -> np.ndarray:
        """Cycles after the approach, shape (t,), bool."""
        return self.time_s > self.plan.begins_s

    @cached_property
    def stray_ut(self) -> np.ndarray:
        """What the neighbours' films add to the lateral field since the beginning, (t, 2, n)."""
        films = self.displacement_mm[:, :2], self.displacement_mm[:, 2]
        warm = np.full(films[1].shape[1], 25.0)
        all_films, own_film = (
            field(*films, warm)[:, :2] for field in _fields(self.plan.skin, self.plan.pitch_m)
        )
        stray = all_films - own_film
        return stray - stray[0]

    @property
    def units(self) -> int:
        """Units in contact when the motion begins."""
        at = min(np.searchsorted(self.time_s, self.plan.begins_s), len(self.time_s) - 1)
        return int((self.force[at, 2] > 0.0).sum())


def lasting(trial: Trial, seconds: float) -> Trial:
    """A trial that is held for `seconds` at least, as it was in its last cycle."""
    further = max(0, round(seconds * trial.plan.rate_hz) - len(trial.time_s))
    last = trial.time_s[-1] + np.arange(1, further + 1) / trial.plan.rate_hz

    def held(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, np.repeat(values[-1:], further, axis=0)])

    return Trial(
        trial.plan, np.append(trial.time_s, last), held(trial.force), held(trial.displacement_mm),
        held(trial.share), held(trial.travel_mm),
    )  # fmt: skip


@cache
def skin_of(name: str, pitch_m: float = PITCH_M) -> Topology:
    """A skin of `SKINS`, its apex in the origin.

    What is played does not know of its bus; the rate of a trial is that of its plan.
    """
    text = f"""format = 1
name = "{name}"
cycle_rate_hz = {RATE_HZ}
sync_id = 0x080
[[buses]]
name = "main"
interface = "memory"
channel = "{name}"
bitrate = 1_000_000
data_bitrate = 5_000_000
[[patches]]
name = "skin"
{SKINS[name]}
pitch_m = {pitch_m}
bus = "main"
layout = "f3t-fd64"
first_id = 0x100
"""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "skin.toml"
        path.write_text(text, "utf-8")
        return load(path)


@cache
def _fields(name: str, pitch_m: float) -> tuple[HalbachField, HalbachField]:
    """The field of all films in reach, and of the own one."""
    skin = skin_of(name, pitch_m)
    return HalbachField(skin, reach_m=1.6 * pitch_m), HalbachField(skin, reach_m=0.0)


@lru_cache(4)
def _foundation(skin: str, pitch_m: float, modulus_pa: float) -> HalfSpace | Springs:
    topology = skin_of(skin, pitch_m)
    if np.isinf(modulus_pa):
        return Springs.of(topology)
    return HalfSpace.of(topology, modulus_pa)


def reached_mm(plan: Plan) -> np.ndarray:
    """How deep the body reaches into each unit where its way down begins."""
    skin = skin_of(plan.skin, plan.pitch_m)
    return penetration(plan.body, _pose(plan, 0.0, 0.0), skin.position, skin.rotation)


def pressed(plan: Plan, depth_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Load and own depth of each unit under a body that has come down straight."""
    skin = skin_of(plan.skin, plan.pitch_m)
    depth = penetration(plan.body, _pose(plan, depth_mm, 0.0), skin.position, skin.rotation)
    load_n, own_mm = np.zeros(skin.n), np.zeros(skin.n)
    _foundation(plan.skin, plan.pitch_m, plan.modulus_pa).press(
        depth, load_n, own_mm, body_mm_per_n=plan.body.compliance_mm_per_n
    )
    return load_n, own_mm


def turned(pose: Pose, axis: np.ndarray, angle_rad: float, about: np.ndarray | None = None) -> Pose:
    """The pose after a turn about an axis through a point; the body's origin if not given."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(3) + math.sin(angle_rad) * cross + (1.0 - math.cos(angle_rad)) * cross @ cross
    rotation, position = pose
    centre = position if about is None else np.asarray(about, float)
    return turn @ rotation, centre + turn @ (position - centre)


def _pose(plan: Plan, depth_mm: float, travel_mm: float, since_s: float = 0.0) -> Pose:
    rotation, place = plan.lean
    heading = np.array([np.cos(plan.heading_rad), np.sin(plan.heading_rad), 0.0])
    shift = 1e-3 * (plan.slide * travel_mm * heading - depth_mm * np.array([0.0, 0.0, 1.0]))
    angle = plan.turn_rad_per_mm * travel_mm
    pivot = np.append(plan.pivot_m, 0.0)
    rotation, place = turned((rotation, place), np.array([0.0, 0.0, 1.0]), angle, about=pivot)
    if plan.roll_per_m:
        about = np.array([-heading[1], heading[0], 0.0])
        rotation, _ = turned((rotation, place), about, 1e-3 * plan.roll_per_m * travel_mm)
    if plan.shake_mm:
        way = 1e-3 * plan.shake_mm * np.sin(2.0 * np.pi * plan.shake_hz * since_s)
        shift[:2] += way * np.array([np.cos(plan.shake_rad), np.sin(plan.shake_rad)])
    return rotation, place + shift


def _travel_speed(plan: Plan) -> float:
    """mm/s of travel at which the fastest face in contact moves at the plan's speed."""
    position = skin_of(plan.skin, plan.pitch_m).position
    touched = pressed(plan, plan.depth_mm)[0] > 0.0
    away = 1e3 * (position[:2, touched] - np.array(plan.pivot_m)[:, np.newaxis])
    heading = plan.slide * np.array([np.cos(plan.heading_rad), np.sin(plan.heading_rad)])
    per_mm = heading[:, np.newaxis] + plan.turn_rad_per_mm * np.array([-away[1], away[0]])
    return plan.speed_mm_s / np.hypot(*per_mm).max()


def play(
    plan: Plan, *, until: float = GROSS, dt_s: float | None = None, sticks_for: int = 0
) -> Trial:
    """Let a plan happen; slip ends soon after the share `until` of the load has slipped.

    Parameters
    ----------
    plan : Plan
    until : float
    dt_s : float, optional
        Step; a cycle of the plan's rate if not given.
    sticks_for : int
        Not 0: nothing slips once the body moves, whatever the friction, and so many cycles follow.
    """
    dt_s = 1.0 / plan.rate_hz if dt_s is None else dt_s
    skin = skin_of(plan.skin, plan.pitch_m)
    mechanics = Mechanics(
        skin, plan.body, foundation=_foundation(plan.skin, plan.pitch_m, plan.modulus_pa),
        static=plan.friction, kinetic=plan.kinetic,
    )  # fmt: skip
    prony = Prony((3, skin.n))
    grip = _grip(plan)
    travel_speed = _travel_speed(plan)
    needed, force, shares, travelled = [], [], [], []
    slipped = np.zeros(skin.n, bool)
    rest_s = 0.1 if plan.kind == "slip" else 1.5
    time_s, travel, ends_s = 0.0, 0.0, plan.begins_s + plan.longest_s
    moving = False
    while len(force) < sticks_for if sticks_for else time_s < ends_s:
        time_s += dt_s
        since = time_s - plan.begins_s
        depth = plan.depth_mm * min(1.0, time_s / plan.press_s)
        if since > 0.0:
            if not moving:
                moving = True
                slipped[:] = False
            if travel < plan.farthest_mm:
                travel = min(travel + travel_speed * dt_s, plan.farthest_mm)
                if travel == plan.farthest_mm:
                    ends_s = min(ends_s, time_s + rest_s)
            depth = grip(since)
        if sticks_for and since > 0.0:
            mechanics.friction = STICKS, STICKS
        truth = mechanics.step(_pose(plan, depth, travel, max(since, 0.0)))
        slipped |= truth.slipping
        slipped &= truth.contact
        share = float(truth.load @ slipped) / max(float(truth.load.sum()), 1e-12)
        force.append(truth.force.copy())
        needed.append(prony.elastic(truth.force, dt_s))
        shares.append(share)
        travelled.append(travel)
        if moving and plan.kind == "slip" and not sticks_for:
            if share >= until:
                ends_s = min(ends_s, time_s + rest_s)
            own = truth.displacement_mm
            if np.hypot(own[0], own[1]).max() > FARTHEST_MM or own[2].max() > DEEPEST_MM:
                break
    elastic = np.array(needed)
    material = Elastic(skin)
    depth_mm = material.depth(np.maximum(elastic[:, 2], 0.0))
    size = np.hypot(elastic[:, 0], elastic[:, 1])
    per_n = material.displacement(size, depth_mm) / np.maximum(size, 1e-300)
    displacement = np.concatenate(
        [per_n[:, np.newaxis] * elastic[:, :2], depth_mm[:, np.newaxis]], axis=1
    )
    time = dt_s * np.arange(1, len(force) + 1)
    return Trial(plan, time, np.array(force), displacement, np.array(shares), np.array(travelled))


def _grip(plan: Plan) -> Callable[[float], float]:
    """Depth of the body, mm, at a time after its motion has begun."""
    if not plan.modulation:
        return lambda since_s: plan.depth_mm
    depths = plan.depth_mm * np.linspace(0.3, 1.7, 29)
    loads = np.array([pressed(plan, depth)[0].sum() for depth in depths])
    middle = float(np.interp(plan.depth_mm, depths, loads))

    def depth(since_s: float) -> float:
        swing = np.sin(2.0 * np.pi * plan.modulation_hz * since_s)
        return float(np.interp(middle * (1.0 + plan.modulation * swing), loads, depths))

    return depth
