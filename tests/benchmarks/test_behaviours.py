"""Trials of simulated people, as the benchmarks of behaviours play them."""

import math

import numpy as np
import pytest

from benchmarks.handover_trial import run_carry, run_take
from benchmarks.touch_trial import TOUCH_KINDS, run_touches

pytestmark = pytest.mark.long


@pytest.mark.parametrize("seed", [1, 4])
def test_a_person_takes_a_block_out_of_the_gripper(seed):
    trial = run_take(seed)
    assert trial.recognised, trial.why
    assert trial.latency_s < 0.3
    assert np.nanmax(trial.true_support) > 0.75


def test_bumps_and_brushes_on_the_way_release_nothing():
    carry = run_carry(12, 4.0)
    assert carry.released == []
    assert carry.bumps + carry.brushes + carry.tugs >= 1


def test_a_finger_on_a_bare_skin_is_understood():
    trial = run_touches(5)
    kinds = {seen.asked.kind: seen.reported for seen in trial.seen}
    assert set(kinds) == set(TOUCH_KINDS)
    assert sum(seen.is_right for seen in trial.seen) >= 5
    slide = next(seen for seen in trial.seen if seen.asked.kind == "slide")
    assert math.degrees(abs(slide.off_rad)) < 5.0
