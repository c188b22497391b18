"""The benchmark of grasps: its figures are within what is asked for, on short runs."""

from __future__ import annotations

import pytest

from benchmarks import grasp
from benchmarks.grasp_hand import hand_model, hand_topology
from topology import load


@pytest.mark.parametrize("name", ["box", "capsule"])
def test_what_is_held_does_not_creep_and_sags_as_springs_do(name):
    found = grasp._held(*grasp.THINGS[name], settle_s=4.0, seconds=0.5)
    assert found["creep_um_per_s"] <= 0.01
    assert found["sag_error"] <= 0.01
    assert found["third_law_error"] <= 1e-6


def test_contacts_of_the_engine_creep():
    assert grasp._engine_creep(*grasp.THINGS["sphere"], 0.5) > 10.0


def test_energy_is_lost_and_never_gained():
    found = grasp._energy()
    assert found["kick_energy_gain"] < 0.01
    assert found["cycle_energy_gain"] == 0.0
    assert found["cycle_energy_lost"] > 0.0


def test_a_hand_of_124_units_feels_what_lies_on_its_palm(tmp_path):
    model = hand_model()
    if model is None:
        pytest.skip("gymnasium-robotics, whose hand it is, is not installed")
    topology = load(hand_topology(tmp_path, model))
    assert topology.n == 124
    with grasp.grasp(topology, objects=["object"]) as world:
        states = iter(world)
        while world.time_s < 0.4:
            state = next(states)
        assert (world.truth.touched_by == 0).sum() >= 4
        assert world.truth.wrench[2, 0] == pytest.approx(0.0709 * grasp.G, rel=0.2)
        assert state.units.force[2].sum() > 0.3
