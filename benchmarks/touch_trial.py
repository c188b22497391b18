"""Trials of gestures of a finger on a bare skin, by a scene whose bodies do them one by one."""

from __future__ import annotations

import math

import numpy as np

import skin.opening
from fig4b_gestures import Asked, Trial, match
from shared.people import Person, bump
from skin.behaviours.gesture import Gesture, Gestures
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.script import BodyTable, Key, SceneFile, Sphere
from topology import load

__all__ = ["TOUCH_KINDS", "run_touches"]

TOUCH_KINDS = ("tap", "brush", "press", "pull", "slide", "twist")
FINGER_M = 0.06
"""Radius of what touches: a soft fingertip that is pressed flat lies on several units so."""

FIRST_S, PAUSE_S = 0.6, 0.5


def run_touches(seed: int, each: int = 1) -> Trial:
    """Play gestures on the palm, some of each kind, in any order; the same for the same seed."""
    random = np.random.default_rng((seed, 42))
    kinds = [kind for kind in TOUCH_KINDS for _ in range(each)]
    bodies, begun, begin_s = [], [], FIRST_S
    for i in random.permutation(len(kinds)):
        keys, seconds, angle = _finger(kinds[i], begin_s, random)
        bodies.append(BodyTable(
            name=f"finger{len(bodies)}", shape=Sphere(radius_m=FINGER_M), keys=tuple(keys),
            friction=float(random.uniform(0.5, 0.9)),
            compliance_mm_per_n=float(random.uniform(0.05, 0.15)),
        ))  # fmt: skip
        begun.append((begin_s, Asked(kinds[i], angle, bump((0.0, 0.0, 0.0), seconds))))
        begin_s += seconds + PAUSE_S
    palm = load("palm")
    scene = ScriptedScene(
        palm, SceneFile(format=1, seconds=begin_s, bodies=tuple(bodies), seed=seed)
    )
    gestures, trial = Gestures(palm), Trial(Person())
    told: list[tuple[float, Gesture]] = []
    want = {"force", "sigma", "contacts"}
    with skin.opening.open(palm, simulate=scene, pace=False, want=want) as opened:
        for cycle, state in enumerate(opened):
            time_s = cycle / palm.cycle_rate_hz
            found = gestures.update(state)
            if found is not None:
                told.append((time_s, found))
            if time_s > begin_s:
                break
    match(trial, begun, told)
    return trial


def _finger(
    kind: str, begin_s: float, random: np.random.Generator
) -> tuple[list[Key], float, float]:
    """Keys of a finger, how long it takes from its first touch, and the angle of a drag."""
    x, y = random.uniform(-0.02, 0.02, 2).tolist()
    angle = float(random.uniform(-math.pi, math.pi))
    u, v = math.cos(angle), math.sin(angle)
    high_m, deep_m = 0.0005, -float(random.uniform(0.0010, 0.0018))
    rise_s = float(random.uniform(0.1, 0.3))
    hold_s = float(random.uniform(0.2, 0.8))
    way_m = turn_deg = 0.0
    told = angle
    if kind == "tap":
        rise_s, hold_s, told = float(random.uniform(0.02, 0.04)), 0.0, math.nan
    elif kind == "brush":
        rise_s, hold_s, deep_m = float(random.uniform(0.04, 0.12)), 0.02, -0.0009
        way_m = float(random.uniform(0.012, 0.03))
    elif kind == "pull":
        way_m = float(random.uniform(0.0008, 0.0015))
    elif kind == "slide":
        way_m = float(random.uniform(0.015, 0.03))
    elif kind == "twist":
        turn_deg, told = float(random.choice([-1.0, 1.0]) * random.uniform(10.0, 25.0)), math.nan
    else:
        told = math.nan
    if way_m > 0.005:  # it goes through the middle of the skin
        x, y = -0.5 * way_m * u, -0.5 * way_m * v
    end = (x + way_m * u, y + way_m * v)
    turn = (0.0, 0.0, turn_deg)
    keys = [
        Key(t_s=0.0, xyz_m=(x, y, high_m), rpy_deg=(0.0, 0.0, 0.0)),
        Key(t_s=begin_s, xyz_m=(x, y, high_m)),
    ]
    now_s = begin_s + rise_s
    if kind == "brush":
        middle = (0.5 * (x + end[0]), 0.5 * (y + end[1]), deep_m)
        keys.append(Key(t_s=now_s, xyz_m=middle, ease="linear"))
        now_s += rise_s
        keys.append(Key(t_s=now_s, xyz_m=(*end, high_m), ease="linear", rpy_deg=turn))
        return keys, now_s - begin_s, told
    keys.append(Key(t_s=now_s, xyz_m=(x, y, deep_m), rpy_deg=(0.0, 0.0, 0.0)))
    if hold_s > 0.0:
        move_s = 0.4 * hold_s if kind != "slide" else hold_s
        keys.append(Key(t_s=now_s + move_s, xyz_m=(*end, deep_m), rpy_deg=turn))
        if kind != "slide":
            keys.append(Key(t_s=now_s + hold_s, xyz_m=(*end, deep_m), rpy_deg=turn))
        now_s += hold_s
    now_s += rise_s
    keys.append(Key(t_s=now_s, xyz_m=(*end, high_m), rpy_deg=turn))
    return keys, now_s - begin_s, told
