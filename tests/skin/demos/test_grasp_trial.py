"""The trial of the demo: objects that nobody has described are lifted and pulled."""

from __future__ import annotations

import pytest

from skin.demos.grasp_trial import run_trial, unknown_object
from skin.grasp.object import GraspObject


@pytest.mark.parametrize("friction", [0.33, 0.6])
def test_a_box_whose_faces_slide_alike_is_held(friction: float) -> None:
    thing = GraspObject(name="object", size_m=(0.025, 0.022, 0.03), mass_kg=0.2, friction=friction)
    trial = run_trial(0, thing=thing)
    assert not trial.dropped
    assert trial.belief[-1] == pytest.approx(friction, rel=0.15)
    assert trial.height_m[-1] > 0.03


def test_a_glassy_thing_is_dropped_and_said_to_be() -> None:
    thing = GraspObject(name="object", size_m=(0.025, 0.022, 0.03), mass_kg=0.3, friction=0.01)
    trial = run_trial(0, thing=thing, seconds=3.0)
    assert trial.dropped


def test_every_seed_has_an_object_of_its_own() -> None:
    things = [unknown_object(seed) for seed in range(20)]
    assert len({thing.mass_kg for thing in things}) == 20
    assert {thing.shape for thing in things} == {"box", "cylinder"}
    assert unknown_object(7) == unknown_object(7)
