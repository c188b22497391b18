"""Forces of a skin on bodies of the engine: against statics, momentum, energy and plain Python."""

from __future__ import annotations

import numpy as np
import pytest

from skin.sim.grasping.object import GraspObject
from tests.fixtures.grasp import G, go, pinched, place, put

BOX = GraspObject(name="it", mass_kg=0.06)
CAPSULE = GraspObject(name="it", shape="capsule", size_m=(0.015, 0.01), mass_kg=0.06)
OFF_M = 0.006  # a ball in front of one unit of each pad, not of a gap
BALL = GraspObject(
    name="it", shape="sphere", size_m=(0.025,), mass_kg=0.06, position_m=(0.0, OFF_M, OFF_M)
)
TARGET_M = {"box": 0.027, "capsule": 0.036, "sphere": 0.027}
SHAPES = pytest.mark.parametrize("thing", [BOX, CAPSULE, BALL], ids=lambda t: t.shape)


@pytest.mark.long
@SHAPES
def test_what_is_held_sags_by_weight_over_stiffness_and_then_stays(thing: GraspObject) -> None:
    plant = pinched(thing, target_m=TARGET_M[thing.shape], seconds=1.5)
    before = place(plant)
    stiffness_n_per_m = 500.0 * (plant.touch.body >= 0).sum()
    plant.model.opt.gravity[2] = -G
    go(plant, 6.0)
    hand = plant.data.qpos[0]
    settled = place(plant)
    sag = before[2] - settled[2] + hand
    assert sag == pytest.approx(0.06 * G / stiffness_n_per_m, rel=0.01)
    assert not plant.touch.slipping.any()
    go(plant, 1.0)
    assert np.abs(place(plant) - settled).max() < 1e-8


@pytest.mark.parametrize("side", [-1, 1])
def test_it_slips_where_coulomb_says(side: int) -> None:
    plant = pinched(BOX)
    normal_n = plant.touch.normal_n.sum()
    friction = 0.06 * G / normal_n * (1.0 + 0.01 * side)
    plant.surfaces.static[:] = plant.surfaces.kinetic[:] = friction
    for share in np.linspace(0.0, 1.0, 300):  # without a blow
        plant.model.opt.gravity[2] = -G * share
        go(plant, 0.004)
    go(plant, 0.1)
    before = place(plant)[2]
    go(plant, 0.4)
    fallen = before - place(plant)[2]
    assert fallen < 1e-5 if side > 0 else fallen > 1e-4


@SHAPES
def test_forces_on_units_are_what_moves_the_object(thing: GraspObject) -> None:
    plant = pinched(thing, target_m=TARGET_M[thing.shape])
    plant.model.opt.gravity[2] = -G
    plant.pushes[plant.object_bodies[0], :3] = [0.0, 0.5, 0.0]
    for _ in range(200):
        plant.step(2e-4)
    mounted, touch, data = plant.mounted, plant.touch, plant.data
    turn = data.xmat[mounted.body].reshape(-1, 3, 3)
    world = np.einsum("nij,jkn,kn->i", turn, mounted.rotation, touch.force)
    before = data.qvel[-6:-3].copy()
    plant.engine.mj_step2(plant.model, data)
    gained = 0.06 * (data.qvel[-6:-3] - before) / plant.model.opt.timestep
    told = np.array([0.0, 0.5, -0.06 * G]) - world
    assert gained == pytest.approx(told, rel=1e-6, abs=1e-9)


def test_what_one_body_is_given_the_other_loses() -> None:
    plant = pinched(BALL)
    plant.pushes[plant.object_bodies[0]] = [0.1, 0.2, 0.3, 0.001, 0.0, 0.002]
    go(plant, 0.02)
    wrench, middle = plant.data.xfrc_applied - plant.pushes, plant.data.xipos
    about_origin = wrench[:, 3:] + np.cross(middle, wrench[:, :3])
    assert wrench[:, :3].sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert about_origin.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)


def test_force_is_the_slope_of_what_is_stored() -> None:
    thing = GraspObject(name="it", shape="sphere", size_m=(0.025,), friction=10.0)
    plant = pinched(thing, seconds=0.0)
    for depth_m in np.linspace(0.0, 1.5e-3, 50):
        put(plant, np.array([-0.02 - depth_m, 0.006, 0.006]))
    step = 1e-7
    stored = []
    for side in (-1, 1):
        put(plant, np.array([-0.0215, 0.006, 0.006 + side * step]))
        stored.append(plant.touch.energy_j.sum())
    force = put(plant, np.array([-0.0215, 0.006, 0.006]))[2]
    slope = (stored[1] - stored[0]) / (2.0 * step)
    assert force == pytest.approx(-slope, rel=1e-3, abs=1e-6)


def test_a_kick_never_gains_energy() -> None:
    plant = pinched(BOX)
    plant.data.qvel[-6:] = [0.02, 0.02, 0.05, 1.0, 1.0, 1.0]
    kp = 1000.0

    def energy() -> float:
        servo = 0.5 * kp * ((plant.data.ctrl[1:] - plant.data.qpos[1:3]) ** 2).sum()
        return plant.energy_j() + servo

    plant.engine.mj_forward(plant.model, plant.data)
    rest = energy()
    kick = 0.5 * 0.06 * (0.02**2 + 0.02**2 + 0.05**2) + 0.5 * 3 * 0.06 * 0.04**2 / 6.0
    told = []
    for _ in range(4000):
        plant.step(1e-4)
        told.append(energy())
    gained = np.max(np.array(told) - np.minimum.accumulate(told))
    assert gained < 0.02 * kick
    assert told[-1] < rest


def test_a_slipping_face_is_dragged_by_what_friction_has_in_motion() -> None:
    thing = GraspObject(name="it", mass_kg=0.06, friction=0.4, kinetic_share=0.5)
    plant = pinched(thing)
    plant.pushes[plant.object_bodies[0], 2] = -1.1 * 0.4 * plant.touch.normal_n.sum()
    go(plant, 0.012)
    slips = plant.touch.slipping
    assert slips.any()
    assert plant.touch.drag_n[slips] == pytest.approx(0.2 * plant.touch.normal_n[slips])


def test_pads_that_meet_share_their_depth_and_push_alike() -> None:
    plant = pinched(target_m=0.045, seconds=1.0)
    plant.data.ctrl[1:] = 0.05
    go(plant, 1.0)
    left, right = plant.touch.force[2, :16], plant.touch.force[2, 16:]
    assert left.sum() > 1.0
    assert left.sum() == pytest.approx(right.sum(), rel=1e-6)
    wrench = plant.data.xfrc_applied
    pad = plant.model.body("left_pad").id
    assert -wrench[pad, 0] == pytest.approx(left.sum(), rel=1e-6)
