"""The holder and its probe: what they believe of friction, and of what hangs."""

from __future__ import annotations

import pytest

from skin.grasp.probe import Probe
from skin.grasp.trial import run_trial, unknown_object
from skin.sim.engine.object import GraspObject

PERIOD_S = 0.004


def asked(shear_of_load) -> tuple[Probe, float | None]:
    """A probe and its first answer, where the tangential load is a function of the grip."""
    probe = Probe(PERIOD_S)
    for _ in range(250):
        load_n = 2.0 * probe.factor
        ratio = probe.update(load_n, shear_of_load(load_n))
        if ratio is not None or probe.hangs:
            return probe, ratio
    raise AssertionError


def test_what_bears_the_same_when_gripped_harder_hangs() -> None:
    probe, ratio = asked(lambda load_n: 0.8)
    assert probe.hangs
    assert ratio is None


def test_what_follows_the_grip_slides_and_tells_its_friction() -> None:
    probe, ratio = asked(lambda load_n: 0.35 * load_n)
    assert not probe.hangs
    assert ratio == pytest.approx(0.35)


@pytest.mark.parametrize("friction", [0.33, 0.6])
def test_a_box_whose_faces_slide_alike_is_held(friction: float) -> None:
    thing = GraspObject(name="object", size_m=(0.025, 0.022, 0.03), mass_kg=0.2, friction=friction)
    trial = run_trial(0, thing=thing)
    assert not trial.dropped
    assert trial.belief[-1] < max(friction + 0.05, 0.51)
    assert trial.height_m[-1] > 0.03


def test_a_glassy_thing_is_dropped_and_said_to_be() -> None:
    thing = GraspObject(name="object", size_m=(0.025, 0.022, 0.03), mass_kg=0.3, friction=0.01)
    trial = run_trial(0, thing=thing, seconds=4.5)
    assert trial.dropped


def test_every_seed_has_an_object_of_its_own() -> None:
    things = [unknown_object(seed) for seed in range(20)]
    assert len({thing.mass_kg for thing in things}) == 20
    assert {thing.shape for thing in things} == {"box", "cylinder"}
    assert unknown_object(7) == unknown_object(7)
