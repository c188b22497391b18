"""A grasp in MuJoCo with the skin's own forces: creep, slip, sag, energy, momentum, time.

`creep_um_per_s` is how fast a held object of 60 g goes down when all has settled, beside
`creep_engine_um_per_s` of MuJoCo's own contacts in the same gripper (elliptic cone, impratio 10).
`slip_friction_error` compares the coefficient at which it slips, found by bisection, with
Coulomb's weight over normal force. `sag_error` is against weight over stiffness.
`kick_energy_gain` is the largest rise of energy after a kick over the kick's, `cycle_energy_gain`
what a slow push and release gives back above what it took, over what it took. `third_law_error`
compares the sum of the units' forces with mass times acceleration. Real-time factors are of the
closed loop: engine, forces, units, frames, decoder, contacts.
"""

from __future__ import annotations

import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.grasp_hand import hand_model, hand_topology
from skin.sim.grasping.model import engine_library
from skin.sim.grasping.object import GraspObject
from skin.sim.grasping.plant import Plant
from skin.sim.grasping.world import grasp
from topology import load

G = 9.81
PERIOD_S = 0.004
MASS_KG = 0.06
OFF_M = 0.006  # in front of one unit of each pad
THINGS = {
    "box": (GraspObject(name="it", mass_kg=MASS_KG), 0.035),
    "sphere": (
        GraspObject(name="it", shape="sphere", size_m=(0.025,), mass_kg=MASS_KG,
                    position_m=(0.0, OFF_M, OFF_M)), 0.026,
    ),
    "capsule": (
        GraspObject(name="it", shape="capsule", size_m=(0.015, 0.01), mass_kg=MASS_KG), 0.036,
    ),
}  # fmt: skip
"""Objects, and targets of the fingers, metre."""


def run(quick: bool) -> dict[str, Any]:
    """Measure; see the module for what the figures are."""
    seconds = 1.0 if quick else 5.0
    held = {name: _held(*case, settle_s=4.0 if quick else 8.0, seconds=seconds)
            for name, case in THINGS.items()}  # fmt: skip
    return {
        "creep_um_per_s": {name: row["creep_um_per_s"] for name, row in held.items()},
        "creep_engine_um_per_s": {
            name: _engine_creep(*case, seconds) for name, case in THINGS.items()
        },
        "sag_error": {name: row["sag_error"] for name, row in held.items()},
        "third_law_error": {name: row["third_law_error"] for name, row in held.items()},
        **_slip(4 if quick else 9),
        **_energy(),
        **_pinch_time(1.0 if quick else 4.0),
        **_hand_time(1.0 if quick else 4.0),
        **_joints(quick),
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [f"{'':<10}{'creep um/s':>12}{'MuJoCo um/s':>13}{'sag error':>11}{'third law':>11}"]
    for name, creep in figures["creep_um_per_s"].items():
        lines.append(
            f"{name:<10}{creep:>12.1e}{figures['creep_engine_um_per_s'][name]:>13.1f}"
            f"{figures['sag_error'][name]:>11.1e}{figures['third_law_error'][name]:>11.1e}"
        )
    lines += [
        f"slip at friction {figures['slip_friction']:.5f}, Coulomb "
        f"{figures['coulomb_friction']:.5f}: error {figures['slip_friction_error']:.2%}",
        f"energy gained after a kick {figures['kick_energy_gain']:.1e}, in a cycle of push and "
        f"release {figures['cycle_energy_gain']:.1e}",
        f"real time: pinch x {figures['real_time_factor_pinch']:.1f} (engine and forces alone "
        f"x {figures['engine_factor_pinch']:.1f}), hand x {figures['real_time_factor_hand']}",
    ]
    return "\n".join(lines)


def _pinched(thing: GraspObject, target_m: float, seconds: float = 1.5) -> Plant:
    """An object between closed pads, without weight."""
    topology = load("gripper")
    assert topology.robot is not None
    plant = Plant(topology.robot.path, topology, [thing])
    plant.model.opt.gravity[:] = 0.0
    plant.data.ctrl[1:] = target_m
    _go(plant, seconds)
    return plant


def _go(plant: Plant, seconds: float) -> None:
    for _ in range(round(seconds / PERIOD_S)):
        plant.advance(PERIOD_S)


def _height(plant: Plant) -> float:
    return float(plant.data.xipos[plant.object_bodies[0], 2])


def _held(thing: GraspObject, target_m: float, settle_s: float, seconds: float) -> dict[str, float]:
    """Creep, sag, and the sum of forces of one held object."""
    plant = _pinched(thing, target_m)
    start_m, touching = _height(plant), int((plant.touch.body >= 0).sum())
    plant.model.opt.gravity[2] = -G
    _go(plant, settle_s)
    settled_m = _height(plant)
    sag_m = start_m - settled_m + float(plant.data.qpos[0])
    stiffness = 1e3 * plant.mounted.springs.shear[0, 0] * touching
    _go(plant, seconds)
    creep = abs(_height(plant) - settled_m) / seconds * 1e6
    return {
        "creep_um_per_s": creep,
        "sag_error": abs(sag_m * stiffness / (MASS_KG * G) - 1.0),
        "third_law_error": _third_law(plant),
    }


def _third_law(plant: Plant) -> float:
    """The sum of the units' forces against mass times acceleration, over the weight, at worst in
    50 steps after a blow."""
    plant.data.qvel[-6:-3] = [0.0, 0.01, 0.02]
    worst = 0.0
    mounted, data = plant.mounted, plant.data
    for _ in range(50):
        plant.step(2e-4)
        turn = data.xmat[mounted.body].reshape(-1, 3, 3)
        told = -np.einsum("nij,jkn,kn->i", turn, mounted.rotation, plant.touch.force)
        told[2] -= MASS_KG * G
        before = data.qvel[-6:-3].copy()
        kept = data.qpos.copy(), data.qvel.copy()
        plant.engine.mj_step2(plant.model, data)
        gained = MASS_KG * (data.qvel[-6:-3] - before) / plant.model.opt.timestep
        worst = max(worst, float(np.abs(gained - told).max()) / (MASS_KG * G))
        data.qpos[:], data.qvel[:] = kept
        plant.engine.mj_step1(plant.model, data)
    return worst


def _engine_creep(thing: GraspObject, target_m: float, seconds: float) -> float:
    """The same held by contacts of MuJoCo: elliptic cone, impratio 10."""
    mujoco = engine_library()
    robot = load("gripper").robot
    assert robot is not None
    spec = mujoco.MjSpec.from_file(str(robot.path))
    body = spec.worldbody.add_body(name="it", pos=list(thing.position_m))
    body.add_freejoint()
    body.add_geom(
        type=getattr(mujoco.mjtGeom, f"mjGEOM_{thing.shape.upper()}"),
        size=[*thing.size_m, 0.0, 0.0][:3], mass=thing.mass_kg,
        friction=[thing.friction, 0.005, 0.0001],
    )  # fmt: skip
    model = spec.compile()
    model.opt.impratio, model.opt.timestep = 10.0, 5e-4
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    data.ctrl[1:] = target_m
    mujoco.mj_step(model, data, nstep=3000)
    model.opt.gravity[2] = -G
    mujoco.mj_step(model, data, nstep=4000)
    before = float(data.qpos[-5])
    mujoco.mj_step(model, data, nstep=round(seconds / 5e-4))
    return abs(float(data.qpos[-5]) - before) / seconds * 1e6


def _slip(halvings: int) -> dict[str, float]:
    """The friction at which a held box begins to slip, between half and twice Coulomb's."""
    plant = _pinched(*THINGS["box"])
    coulomb = MASS_KG * G / float(plant.touch.normal_n.sum())
    low, high = 0.5 * coulomb, 2.0 * coulomb
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        if _slips(middle):
            low = middle
        else:
            high = middle
    found = 0.5 * (low + high)
    return {
        "slip_friction": found,
        "coulomb_friction": coulomb,
        "slip_friction_error": abs(found / coulomb - 1.0),
    }


def _slips(friction: float) -> bool:
    """Whether weight that comes slowly pulls the box down."""
    plant = _pinched(*THINGS["box"])
    plant.surfaces.static[:] = plant.surfaces.kinetic[:] = friction
    for share in np.linspace(0.0, 1.0, 300):
        plant.model.opt.gravity[2] = -G * share
        _go(plant, PERIOD_S)
    before = _height(plant)
    _go(plant, 0.5)
    return before - _height(plant) > 1e-4


def _energy() -> dict[str, float]:
    """What is gained after a kick, and in a cycle of push and release."""
    plant = _pinched(*THINGS["box"])
    gain = np.array([1000.0, 1000.0])  # of the fingers' servos, N/m

    def energy() -> float:
        servo = 0.5 * gain @ (plant.data.ctrl[1:] - plant.data.qpos[1:3]) ** 2
        return plant.energy_j() + float(servo)

    plant.data.qvel[-6:] = [0.02, 0.02, 0.05, 1.0, 1.0, 1.0]
    plant.engine.mj_forward(plant.model, plant.data)
    kick_j = 0.5 * MASS_KG * (2 * 0.02**2 + 0.05**2) + 0.5 * 3 * MASS_KG * 0.04**2 / 6.0
    told = []
    for _ in range(4000):
        plant.step(1e-4)
        told.append(energy())
    rise_j = float(np.max(np.array(told) - np.minimum.accumulate(told)))
    _go(plant, 1.0)
    body, taken, given, dt_s = plant.object_bodies[0], 0.0, 0.0, 2e-4
    for force_n in 2.0 * np.sin(np.linspace(0.0, np.pi, 5000)) ** 2:
        plant.pushes[body, :3] = [0.3 * force_n, 0.2 * force_n, force_n]
        plant.step(dt_s)
        work = float(plant.pushes[body, :3] @ plant.data.qvel[-6:-3]) * dt_s
        taken, given = taken + max(work, 0.0), given - min(work, 0.0)
    return {
        "kick_energy_gain": rise_j / kick_j,
        "cycle_energy_gain": max(given - taken, 0.0) / taken,
        "cycle_energy_lost": max(taken - given, 0.0) / taken,
    }


def _pinch_time(seconds: float) -> dict[str, float]:
    """Simulated over real seconds of a pinched box, 2 x 16 units at 250 Hz."""
    thing, target_m = THINGS["box"]
    with grasp("gripper", objects=[thing]) as world:
        world.joints["left"] = world.joints["right"] = target_m
        factor = _factor(world, 0.6, seconds)
    plant = _pinched(thing, target_m, 0.5)
    started = time.perf_counter()
    _go(plant, seconds)
    alone = seconds / (time.perf_counter() - started)
    return {"real_time_factor_pinch": factor, "engine_factor_pinch": alone}


def _hand_time(seconds: float) -> dict[str, float | None]:
    """The same of a Shadow hand with 124 units and a block on its palm."""
    model = hand_model()
    if model is None:
        return {"real_time_factor_hand": None}
    with tempfile.TemporaryDirectory() as folder:
        topology = load(hand_topology(Path(folder), model))
    with grasp(topology, objects=["object"]) as world:
        return {"real_time_factor_hand": _factor(world, 0.6, seconds)}


def _factor(world: Any, warm_s: float, seconds: float) -> float:
    """Simulated over real seconds, after what is compiled or settles at first."""
    started = 0.0
    for _ in world:
        if world.time_s < warm_s:
            started = time.perf_counter()
        if world.time_s >= warm_s + seconds:
            break
    return seconds / (time.perf_counter() - started)


def _joints(quick: bool) -> dict[str, Any]:
    """How joints move a skin, where that is measured."""
    if find_spec("benchmarks.grasp_joints") is None:
        return {}
    from benchmarks import grasp_joints

    return {"joints": grasp_joints.joint_figures(quick)}
