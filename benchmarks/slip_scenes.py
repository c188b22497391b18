"""Trials for slip detectors: bodies that press, slide and turn on skins, by the simulator.

The detector fits one rigid motion to the displacements of units that stick. The trials know nothing
of that: faces are springs on an elastic half space that couples them all, a body of its own shape
presses and drags them through Coulomb's return map (`skin.sim.mechanics`), on flat and curved
skins, and the elastomer relaxes. What units see of it is for `benchmarks.slip_seen`.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path

import numpy as np

from skin.physics.elastic import Elastic
from skin.physics.halbach import HalbachField
from skin.sim.mechanics.body import Body, Pose, penetration
from skin.sim.mechanics.contact import Mechanics
from skin.sim.mechanics.foundation import Foundation
from skin.sim.mechanics.friction import Friction
from skin.sim.mechanics.viscoelastic import Prony
from topology import Topology, load

__all__ = ["KINDS", "SKINS", "Plan", "Trial", "play", "skin_of", "stage"]

KINDS = ("slip", "hold", "modulation")
SKINS = {
    "flat": 'kind = "grid"\nrows = 8\ncolumns = 8',
    "cylinder": 'kind = "cylinder"\nrows = 8\ncolumns = 8\nradius_m = 0.06',
    "dome": 'kind = "dome"\nrings = 4\nradius_m = 0.15',
}
PITCH_M = 0.012
RATE_HZ = 250.0
SETTLE_S = 0.4
LONGEST_S = 6.0
FARTHEST_MM, DEEPEST_MM = 2.45, 2.9
"""What units can be asked to see."""
FEW, BEARS_N = (3, 5), 0.05
"""Units that bear load where they are few, and what counts as load."""
FIRST, ONSET, GROSS = 0.02, 0.1, 0.95
"""Shares of the load that have slipped: below the first nothing slips; slip begins; all slides."""


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
        all_films, own_film = (field(*films, warm)[:, :2] for field in _fields(self.plan.skin))
        stray = all_films - own_film
        return stray - stray[0]

    @property
    def units(self) -> int:
        """Units in contact when the motion begins."""
        at = min(np.searchsorted(self.time_s, self.plan.begins_s), len(self.time_s) - 1)
        return int((self.force[at, 2] > 0.0).sum())


@cache
def skin_of(name: str) -> Topology:
    """A skin of `SKINS`, 12 mm pitch, its apex in the origin."""
    text = f"""format = 1
name = "{name}"
[[buses]]
name = "main"
interface = "memory"
channel = "{name}"
bitrate = 1_000_000
data_bitrate = 5_000_000
cycle_rate_hz = {RATE_HZ}
sync_id = 0x080
[[patches]]
name = "skin"
{SKINS[name]}
pitch_m = {PITCH_M}
bus = "main"
layout = "f3t-fd64"
first_id = 0x100
"""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "skin.toml"
        path.write_text(text, "utf-8")
        return load(path)


@cache
def _fields(name: str) -> tuple[HalbachField, HalbachField]:
    """The field of all films in reach, and of the own one."""
    skin = skin_of(name)
    return HalbachField(skin, reach_m=1.6 * PITCH_M), HalbachField(skin, reach_m=0.0)


def stage(seed: int, kind: str, number: int, *, few: bool = False) -> Trial:
    """Draw and play trial `number` of its kind; each is the same every time.

    At least six units bear load; where `few` is wanted, three to five.

    Plans are drawn until the truth is of the kind: a slip reaches a tenth of the load; of what is
    held, less than `FIRST` has slipped at any time.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind), number, few])
    while True:
        plan = _drawn(rng, kind)
        units = int((_pressed(plan, plan.depth_mm)[0] > BEARS_N).sum())
        if not (FEW[0] <= units <= FEW[1] if few else units > FEW[1]):
            continue
        if kind == "slip":
            trial = play(plan)
            if trial.share[trial.moving].max() >= ONSET:
                return trial
            continue
        coarse = play(replace(plan, kind="slip", modulation=0.0), until=FIRST, dt_s=4.0 / RATE_HZ)
        slipped = coarse.moving & (coarse.share >= FIRST)
        if slipped.any():
            reach_mm = coarse.travel_mm[np.argmax(slipped)]
            trial = play(replace(plan, farthest_mm=rng.uniform(0.1, 0.9) * reach_mm))
            if trial.share[trial.moving].max() < FIRST:
                return trial


def _drawn(rng: np.random.Generator, kind: str) -> Plan:
    skin_name = str(rng.choice(list(SKINS), p=[0.5, 0.25, 0.25]))
    skin = skin_of(skin_name)
    shape = rng.choice(["sphere", "cylinder", "plate"])
    if shape == "sphere":
        radius = np.exp(rng.uniform(np.log(0.05), np.log(1.0)))
        body, height = Body.sphere(radius), radius
    elif shape == "cylinder":
        radius = np.exp(rng.uniform(np.log(0.03), np.log(0.5)))
        body, height = Body.cylinder(radius, rng.uniform(0.04, 0.2)), radius
    else:
        body, height = Body.plate(*rng.uniform(0.03, 0.09, 2)), 0.0
    middle = np.append(rng.uniform(-0.012, 0.012, 2), height)
    lean = _turned((np.eye(3), middle), np.array([0.0, 0.0, 1.0]), rng.uniform(-np.pi, np.pi))
    tilt_about = np.append(rng.standard_normal(2), 0.0)
    foot = np.append(middle[:2], 0.0)
    lean = _turned(lean, tilt_about, np.radians(rng.uniform(0.0, 1.5)), about=foot)
    coefficient = rng.uniform(0.3, 0.9)
    friction = coefficient * (1.0 + 0.03 * rng.standard_normal(skin.n))
    way = rng.choice(["slide", "both", "spin"], p=[0.55, 0.3, 0.15])
    turn = 0.0 if way == "slide" else rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.15)
    plan = Plan(
        kind=kind, skin=skin_name, body=body, lean=lean, depth_mm=1.0, friction=friction,
        kinetic=rng.uniform(0.8, 1.0) * friction,
        modulus_pa=np.inf if rng.random() < 0.15 else np.exp(rng.uniform(np.log(3e5), np.log(2e6))),
        press_s=rng.uniform(0.15, 0.5),
        speed_mm_s=np.exp(rng.uniform(np.log(0.5), np.log(10.0))),
        heading_rad=rng.uniform(-np.pi, np.pi), turn_rad_per_mm=turn,
        pivot_m=tuple(middle[:2] + rng.uniform(-0.012, 0.012, 2)), slide=float(way != "spin"),
        modulation=rng.uniform(0.1, 0.3) if kind == "modulation" else 0.0,
        modulation_hz=np.exp(rng.uniform(np.log(0.5), np.log(5.0))),
        seed=int(rng.integers(2**31)),
    )  # fmt: skip
    # How deep: until full slip drags some face as far as wanted.
    far_mm = rng.uniform(0.4, 2.2)
    low, high = 0.02, 6.0
    for _ in range(20):
        depth = 0.5 * (low + high)
        load_n, own_mm = _pressed(plan, depth)
        drag_mm = Elastic(skin).displacement(friction * load_n, own_mm)
        deep = drag_mm.max() > far_mm or own_mm.max() > 2.0
        low, high = (low, depth) if deep else (depth, high)
    return replace(plan, depth_mm=low)


@lru_cache(4)
def _foundation(skin: str, modulus_pa: float) -> Foundation:
    topology = skin_of(skin)
    if np.isinf(modulus_pa):
        return Foundation.winkler(topology)
    return Foundation.half_space(topology, modulus_pa)


def _pressed(plan: Plan, depth_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Load and own depth of each unit under a body that has come down straight."""
    skin = skin_of(plan.skin)
    depth = penetration(plan.body, _pose(plan, depth_mm, 0.0), skin.position, skin.rotation)
    load_n, own_mm = np.zeros(skin.n), np.zeros(skin.n)
    _foundation(plan.skin, plan.modulus_pa).press(depth, load_n, own_mm)
    return load_n, own_mm


def _turned(
    pose: Pose, axis: np.ndarray, angle_rad: float, about: np.ndarray | None = None
) -> Pose:
    """The pose after a turn about an axis through a point; the body's origin if not given."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(3) + math.sin(angle_rad) * cross + (1.0 - math.cos(angle_rad)) * cross @ cross
    rotation, position = pose
    centre = position if about is None else np.asarray(about, float)
    return turn @ rotation, centre + turn @ (position - centre)


def _pose(plan: Plan, depth_mm: float, travel_mm: float) -> Pose:
    rotation, place = plan.lean
    heading = np.array([np.cos(plan.heading_rad), np.sin(plan.heading_rad), 0.0])
    shift = 1e-3 * (plan.slide * travel_mm * heading - depth_mm * np.array([0.0, 0.0, 1.0]))
    angle = plan.turn_rad_per_mm * travel_mm
    pivot = np.append(plan.pivot_m, 0.0)
    rotation, place = _turned((rotation, place), np.array([0.0, 0.0, 1.0]), angle, about=pivot)
    return rotation, place + shift


def _travel_speed(plan: Plan) -> float:
    """mm/s of travel at which the fastest face in contact moves at the plan's speed."""
    position = skin_of(plan.skin).position
    touched = _pressed(plan, plan.depth_mm)[0] > 0.0
    away = 1e3 * (position[:2, touched] - np.array(plan.pivot_m)[:, np.newaxis])
    heading = plan.slide * np.array([np.cos(plan.heading_rad), np.sin(plan.heading_rad)])
    per_mm = heading[:, np.newaxis] + plan.turn_rad_per_mm * np.array([-away[1], away[0]])
    return plan.speed_mm_s / np.hypot(*per_mm).max()


def play(plan: Plan, *, until: float = GROSS, dt_s: float = 1.0 / RATE_HZ) -> Trial:
    """Let a plan happen; slip ends soon after the share `until` of the load has slipped."""
    skin = skin_of(plan.skin)
    foundation = _foundation(plan.skin, plan.modulus_pa)
    mechanics = Mechanics(
        skin,
        plan.body,
        foundation=foundation,
        friction=Friction(skin.n, plan.friction, plan.kinetic),
    )
    prony = Prony((3, skin.n))
    grip = _grip(plan)
    travel_speed = _travel_speed(plan)
    needed, force, shares, travelled = [], [], [], []
    slipped = np.zeros(skin.n, bool)
    rest_s = 0.1 if plan.kind == "slip" else 1.5
    time_s, travel, ends_s = 0.0, 0.0, plan.begins_s + LONGEST_S
    moving = False
    while time_s < ends_s:
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
        truth = mechanics.step(time_s, _pose(plan, depth, travel))
        slipped |= truth.slipping
        slipped &= truth.contact
        share = float(truth.load @ slipped) / max(float(truth.load.sum()), 1e-12)
        force.append(truth.force.copy())
        needed.append(prony.elastic(truth.force, dt_s))
        shares.append(share)
        travelled.append(travel)
        if moving and plan.kind == "slip":
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
    loads = np.array([_pressed(plan, depth)[0].sum() for depth in depths])
    middle = float(np.interp(plan.depth_mm, depths, loads))

    def depth(since_s: float) -> float:
        swing = np.sin(2.0 * np.pi * plan.modulation_hz * since_s)
        return float(np.interp(middle * (1.0 + plan.modulation * swing), loads, depths))

    return depth
