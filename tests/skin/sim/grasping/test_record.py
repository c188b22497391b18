"""A grasp that is recorded is replayed to the bit, with its joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import skin
import skin.sim
from skin.sim.grasping.object import GraspObject

pytest.importorskip("mcap", reason="mcap is not installed")


def test_joints_that_move_are_replayed_to_the_bit(tmp_path: Path) -> None:
    file = tmp_path / "grasp.mcap"
    cube = GraspObject(name="cube", size_m=(0.02, 0.02, 0.03))
    wrenches = []
    with skin.sim.grasp("gripper", objects=[cube], record=file) as world:
        world.joints["left"] = world.joints["right"] = 0.035
        for state in world:
            wrenches.append(state.wrench.copy())
            if world.time_s >= 0.4:
                break
    assert np.abs(wrenches[-1]).max() > 0.1
    replay = skin.replay(file)
    again = [state.wrench.copy() for state in replay]
    assert np.array_equal(again, wrenches)
    assert not replay.faults
    assert replay.same == len(wrenches)
