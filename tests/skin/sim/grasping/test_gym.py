"""The environment for learning, as gymnasium itself checks it."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from shared.grasp_env import GraspEnv
from skin.errors import OptionError
from skin.sim import GraspObject, Ranges

CUBE = GraspObject(name="cube", size_m=(0.02, 0.02, 0.03), mass_kg=0.06)


@pytest.fixture
def env():
    """A gripper that squeezes a cube; no episode is like another."""
    made = GraspEnv("gripper", [CUBE], cycles=2, steps=30, ranges=Ranges(friction=(0.5, 1.5)))
    yield made
    made.close()


@pytest.mark.long
def test_gymnasium_finds_no_fault(env: GraspEnv) -> None:
    check_env(env, skip_render_check=True, skip_close_check=True)


def test_an_action_closes_the_pads_until_units_feel_it(env: GraspEnv) -> None:
    seen, _ = env.reset(seed=1)
    for _ in range(30):
        seen, _, ended, truncated, told = env.step(np.array([-0.7, 0.0, 0.0]))
    assert seen["force"][2].sum() > 2.0
    assert np.isfinite(told["margin"])
    assert truncated
    assert not ended


def test_a_step_before_reset_is_refused(env: GraspEnv) -> None:
    with pytest.raises(OptionError, match="must come after reset"):
        env.step(np.zeros(3))
