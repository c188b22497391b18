"""A grip that is pulled, on the simulator: what is drawn, what is scored, what a bus may do."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bus.status import Status
from skin.behaviours.grip import GripControl
from skin.demos.disturbance import REST_S, Disturbance, case_of, run_disturbance
from skin.demos.disturbance_score import figures_of, reactions_s
from skin.demos.simulated_gripper import SimulatedGripper
from skin.grasp.object import GraspObject
from skin.grasp.world import grasp
from topology import load

CUBE = GraspObject(name="cube", size_m=(0.02, 0.02, 0.03), mass_kg=0.1, friction=0.6)


def test_cases_are_within_what_is_said_and_the_same_for_the_same_seed():
    topology = load("gripper")
    cases = [case_of(seed, topology) for seed in range(60)]
    for case in cases:
        weight_n = 9.81 * case.thing.mass_kg
        assert 0.03 <= case.thing.mass_kg <= 0.3
        assert 0.3 <= case.thing.friction <= 0.9
        down_n = (weight_n - case.pull_n[1]) / weight_n
        side_n = case.pull_n[0] / weight_n
        assert -0.776 <= side_n.min() <= side_n.max() <= 1.551
        assert 0.099 <= down_n.min() <= down_n.max() <= 1.951
        assert case.at(2.9) == case.at(7.1) == (0.0, 0.0, 0.0)
    assert 10 <= sum(case.dead.size == 2 for case in cases) <= 30
    again = case_of(3, topology)
    np.testing.assert_array_equal(again.pull_n, cases[3].pull_n)


def test_a_pull_goes_smoothly_through_its_knots():
    case = case_of(1, load("gripper"))
    at = np.array([case.at(t) for t in case.knots_s[1:-1]])
    np.testing.assert_allclose(at[:, 0], case.pull_n[0, 1:-1])
    steps = np.diff([case.at(t)[1] for t in np.arange(REST_S, 7.0, 1e-3)])
    assert np.abs(steps).max() < 0.05 * 9.81 * case.thing.mass_kg


def test_reactions_are_times_from_a_true_slip_to_a_rise_of_the_command():
    run = Disturbance(case_of(0, load("gripper")), lifted_s=0.0)
    run.time_s = list(np.arange(0.0, 10.0, 0.004))
    run.slipping = [3 if 4.0 <= t < 4.1 else 0 for t in run.time_s]
    run.wanted_n = [2.0 if t < 4.0199 else 2.5 for t in run.time_s]
    assert reactions_s(run) == [pytest.approx(0.020)]


class Joints(dict):
    """Targets of fingers between 0 and 50 mm."""

    def limits(self, _name):
        return 0.0, 0.05


@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.04, 0.06])
def test_a_late_gripper_comes_to_a_new_force_without_swinging(delay_s):
    """Its servo answers within 12 ms, on something stiff that stands 10 mm away."""
    skin = SimpleNamespace(topology=SimpleNamespace(cycle_rate_hz=250.0))
    world = SimpleNamespace(joints=Joints(left=0.0), skin=skin)
    gripper, felt_n, felt, moved = SimulatedGripper(world, delay_s=delay_s), 0.0, [], []
    for k in range(1250):
        gripper.squeeze(4.0 if k < 750 else 2.0, felt_n)
        felt_n += 0.28 * (1000.0 * max(world.joints["left"] - 0.01, 0.0) - felt_n)
        felt.append(felt_n)
        moved.append(world.joints["left"])
    cycles = round(250 * delay_s)
    assert moved[:cycles] == [0.0] * cycles
    assert moved[cycles] > 0.0
    assert felt[700:750] == pytest.approx([4.0] * 50, rel=0.02)
    assert felt[750 + cycles - 1] > 3.9
    assert felt[750 + cycles + 20 :] == pytest.approx([2.0] * (480 - cycles), rel=0.05)


def test_an_object_is_held_while_it_is_pulled():
    run = run_disturbance(1)
    found = figures_of(run)
    assert not run.dropped
    assert found["margin_median"] < 0.7
    assert run.load_n[-1] > 0.4


def held():
    """A world in which a cube hangs in the gripper, and its control."""
    world = grasp("gripper", objects=[CUBE], seed=5)
    gripper = SimulatedGripper(world)
    gripper.target_m = 0.02
    return world, GripControl(world.skin.topology, gripper)


def go(world, control, seconds):
    """Play on; lift the cube as soon as it is gripped."""
    end_s = world.time_s + seconds
    for state in world:
        control.update(state)
        if control.load_n > 2.0:
            world.joints["lift"] = min(world.joints.targets["lift"] + 1e-4, 0.01)
        if world.time_s >= end_s:
            return state
    raise AssertionError


def test_a_bus_that_stops_for_200_ms_drops_nothing(monkeypatch):
    world, control = held()
    with world:
        go(world, control, 1.2)
        height_m = world.truth.position[2, 0]
        with monkeypatch.context() as patch:
            patch.setattr(world.skin.nodes, "_send", lambda transport, out: None)
            go(world, control, 0.2)
        told = [one.what for one in control.decisions]
        assert "keeps its grip" in told
        go(world, control, 0.3)
        assert "hears all pads again" in [one.what for one in control.decisions]
        assert world.truth.position[2, 0] > height_m - 0.003


def test_units_of_a_pad_that_fall_silent_drop_nothing(monkeypatch):
    world, control = held()
    with world:
        go(world, control, 1.0)
        height_m = world.truth.position[2, 0]

        def without_some(transport, out):
            frames = out.frames
            transport.send(frames[frames["id"] != 0x101])

        monkeypatch.setattr(world.skin.nodes, "_send", without_some)
        state = go(world, control, 0.5)
        assert 0 < np.count_nonzero(~state.units.valid) < 16
        assert world.truth.margin() > 0.0
        assert world.truth.position[2, 0] > height_m - 0.003


def test_a_magnet_that_comes_near_drops_nothing(monkeypatch):
    world, control = held()
    with world:
        go(world, control, 1.0)
        height_m = world.truth.position[2, 0]
        field = world.scene.units._field

        def disturbed(*arguments):
            found = field(*arguments).copy()
            found[..., 2, :8] *= 0.5  # a magnet takes half of the films' field, at half a pad
            return found

        monkeypatch.setattr(world.scene.units, "_field", disturbed)
        state = go(world, control, 0.5)
        assert np.count_nonzero(state.units.status & int(Status.MAGNETIC_ANOMALY)) > 0
        assert world.truth.position[2, 0] > height_m - 0.003
