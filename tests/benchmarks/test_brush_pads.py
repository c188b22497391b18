"""Brushes that hold a body, against closed formulas and against the simulator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from benchmarks.brush_pads import FACES, Body, Pads, law_of
from shared.gripper import SimulatedGripper
from skin.sim.grasping.object import GraspObject
from skin.sim.grasping.world import grasp

G = 9.81
AT_MM = np.array([[y, z] for _ in (0, 1) for y in (-18.0, -6.0, 6.0, 18.0)
                  for z in (-18.0, -6.0, 6.0, 18.0)]).T  # fmt: skip
PAD = np.repeat([0, 1], 16)
NORMAL = np.repeat([[1.5], [0.6], [4.5]], 32, axis=1)
SHEAR = np.repeat([[0.5], [2.0], [2.9]], 32, axis=1)
BODY = Body("flat", 0.1, 0.5, 0.8)
WEIGHT_N = G * BODY.mass_kg
LEAST_N = 0.5 * WEIGHT_N / BODY.friction


def pads_of(body=BODY, **options):
    return Pads(AT_MM, PAD, NORMAL, SHEAR, body, **options)


def held(pads, grip_n, seconds=0.4, push=(0.0, 0.0, 0.0)):
    """Gripped by so much, with a push, after some time."""
    for _ in range(round(seconds / 0.004)):
        pads.step(grip_n, 0.004, push)
    return pads


@pytest.mark.parametrize("face", ["flat", "soft"])
def test_a_flat_body_holds_where_friction_bears_its_weight_and_slides_below(face):
    body = BODY._replace(face=face, compliance_mm_per_n=1.0 if face == "soft" else 0.0)
    above = held(held(pads_of(body), 3.0 * LEAST_N), 1.05 * LEAST_N)
    assert np.abs(above.data.body[3:]).max() < 1e-3
    below = held(held(pads_of(body), 3.0 * LEAST_N), 0.95 * LEAST_N, 0.2)
    assert below.offset_mm[1] < -5.0


def test_a_slide_is_as_fast_as_kinetic_friction_lets_it_be():
    pads = held(held(pads_of(), 3.0 * LEAST_N), 0.9 * LEAST_N, 0.04)
    before = pads.data.body[4]
    held(pads, 0.9 * LEAST_N, 0.02)
    drag_n = 2.0 * BODY.kinetic_share * BODY.friction * 0.9 * LEAST_N
    expected = 1e3 * (drag_n / BODY.mass_kg - G) * 0.02
    assert pads.data.body[4] - before == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("face", FACES)
def test_a_stuck_body_sags_by_its_weight_over_the_stiffness_of_what_touches(face):
    yields = 1.0 if face == "soft" else 0.0
    body = BODY._replace(face=face, friction=50.0, compliance_mm_per_n=yields)
    pads = pads_of(body)
    # pressed without weight, so that the whole weight then hangs on stuck bristles
    held(pads, 4.0, 0.2, (0.0, WEIGHT_N, 0.0))
    start = pads.offset_mm[1]
    touched = (pads.data.force[2] > 0.0).sum() / 9.0
    held(pads, 4.0, 1.0)
    stiffness = touched * law_of(*SHEAR[:, :1], yields)[0, 0]
    # a curved body also climbs its own slope a little
    assert start - pads.offset_mm[1] == pytest.approx(WEIGHT_N / stiffness, rel=0.12)


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_flat_body_turns_where_torque_exceeds_the_friction_of_all_faces(share):
    body = BODY._replace(half_mm=(30.0, 30.0), kinetic_share=1.0)
    pads = pads_of(body)
    away = np.hypot(*pads.model.at)
    most = 2.0 * 2.0 * body.friction * away.mean()  # 2 N on each of two pads, evenly
    lifted = (0.0, WEIGHT_N, 0.0)
    held(pads, 2.0, 0.2, lifted)
    for k in range(100):
        pads.step(2.0, 0.004, (0.0, WEIGHT_N, share * most * (k + 1) / 100))
    held(pads, 2.0, 0.2, (0.0, WEIGHT_N, share * most))
    turns_rad_s = abs(pads.data.body[5])
    assert turns_rad_s > 1.0 if share > 1.0 else turns_rad_s < 0.01


@pytest.mark.parametrize("face", ["cylinder", "sphere"])
def test_the_depth_under_a_curved_body_is_that_of_the_sum_of_its_springs(face):
    pads = held(pads_of(BODY._replace(face=face, friction=0.9)), 3.0, 0.3, (0.0, WEIGHT_N, 0.0))
    y, z = pads.model.at - pads.offset_mm[:, np.newaxis]
    square = y**2 + (z**2 if face == "sphere" else 0.0)
    gap = 20.0 - np.sqrt(np.maximum(400.0 - square, 0.0))
    one = PAD[pads.model.unit] == 0

    def load_n(approach):
        depth = np.clip(approach - gap[one], 0.0, None)
        return np.where(depth < 0.6, 1.5 * depth, 0.9 + 4.5 * (depth - 0.6)).sum() / 9.0 - 3.0

    assert pads.data.approach[0] == pytest.approx(brentq(load_n, 0.0, 5.0), rel=1e-4)
    forces = pads.forces()
    for pad in (0, 1):
        assert forces[2, pad == PAD].sum() == pytest.approx(3.0, rel=1e-4)


@pytest.mark.parametrize("face", FACES)
def test_no_bristle_bears_more_than_friction_on_the_surface_where_it_touches(face):
    yields = 1.0 if face == "soft" else 0.0
    pads = pads_of(BODY._replace(face=face, compliance_mm_per_n=yields), seed=3)
    rng = np.random.default_rng(4)
    for _ in range(60):
        pads.step(rng.uniform(0.5, 3.0), 0.004, tuple(rng.normal(0.0, (1.0, 1.0, 10.0))))
        fy, fz, press = pads.data.force
        slopes = pads.data.gap[1:]
        normal = np.stack([np.ones_like(press), *slopes]) / np.sqrt(1.0 + (slopes**2).sum(axis=0))
        force = np.stack([press, -fy, -fz])
        along = (force * normal).sum(axis=0)
        across = np.sqrt(np.maximum((force**2).sum(axis=0) - along**2, 0.0))
        touched = press > 0.0
        assert np.all(across[touched] <= pads.model.friction[0, touched] * along[touched] + 1e-6)


def slide_in_the_simulator(share, seconds):
    """Times, heights in mm and true loads of a block in MuJoCo whose grip falls to a share of the
    least one."""
    thing = GraspObject(name="it", size_m=(0.02, 0.03, 0.03), mass_kg=BODY.mass_kg,
                        friction=BODY.friction, kinetic_share=BODY.kinetic_share)  # fmt: skip
    rows = []
    with grasp("gripper", objects=[thing], seed=1) as world:
        gripper = SimulatedGripper(world)
        gripper.target_m, wanted_n = 0.021, 3.0 * LEAST_N
        for _ in world:
            load_n = 0.5 * float(world.truth.normal_n.sum())
            gripper.squeeze(wanted_n, load_n)
            if world.time_s > 0.6:
                world.joints["lift"] = min(world.joints.targets["lift"] + 2e-4, 0.04)
            if world.time_s > 1.6:
                wanted_n = max(wanted_n - 0.02 * LEAST_N, share * LEAST_N)
                rows.append((world.time_s, 1e3 * float(world.truth.position[2, 0]), load_n))
            if rows and world.time_s > 1.6 + 0.4 * (3.0 - share) / 2.0 + seconds:
                break
    return np.array(rows).T


def slide_on_brushes(share, seconds):
    """The same on brushes: the grip falls as evenly."""
    pads, rows = held(pads_of(), 3.0 * LEAST_N), []
    wanted_n = 3.0 * LEAST_N
    for k in range(round((0.4 * (3.0 - share) / 2.0 + seconds) / 0.004)):
        wanted_n = max(wanted_n - 0.02 * LEAST_N, share * LEAST_N)
        pads.step(wanted_n, 0.004)
        rows.append((0.004 * k, pads.offset_mm[1], 0.5 * float(pads.forces()[2].sum())))
    return np.array(rows).T


@pytest.mark.parametrize("slide", [slide_on_brushes, slide_in_the_simulator])
def test_both_plants_let_a_flat_block_go_at_the_least_grip_and_slide_by_coulombs_law(slide):
    """A flat block on flat pads is so simple that both plants must obey the same formulas."""
    time_s, height, load = slide(1.1, 0.2)
    assert abs(height[-1] - height[0]) < 0.5
    time_s, height, load = slide(0.85, 0.16)
    begins = int(np.argmax(height < height[0] - 0.1))
    assert load[begins] == pytest.approx(LEAST_N, rel=0.1)
    # at constant grip: a = g - 2 kinetic friction F / m
    falls = slice(begins + 16, begins + 40)
    bend = 2.0 * np.polyfit(time_s[falls], height[falls], 2)[0]
    kinetic = BODY.kinetic_share * BODY.friction
    expected = -1e3 * (G - 2.0 * kinetic * load[falls].mean() / BODY.mass_kg)
    assert bend == pytest.approx(expected, rel=0.1)
