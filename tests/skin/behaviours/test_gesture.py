"""Gestures on a block in a gripper, whose forces are made by hand, and of people simulated."""

import math

import numpy as np
import pytest

from bus.status import Status
from fig4b_gestures import run, story
from skin.behaviours.gesture import Gestures
from tests.fixtures.cases import long_after_first
from tests.skin.behaviours.held import Held, half_sine, nothing, play, ramp

PULL = ramp(1.2, 0.15, 0.7)


def rested(held=None, **parameters):
    """Gestures that know the rest of a block that is held."""
    held = Held() if held is None else held
    gestures = Gestures(held.topology, **parameters)
    assert play(gestures, held, nothing, 0.6) == []
    assert gestures.disturbance.held
    return gestures, held


def ended(told):
    return [gesture for _, gesture in told if gesture.ended]


@pytest.mark.parametrize("degrees", range(-170, 190, 40))
def test_a_pull_is_told_with_its_angle_before_it_ends(degrees):
    gestures, held = rested()
    angle = math.radians(degrees)
    way = math.cos(angle) * gestures.right + math.sin(angle) * gestures.up
    told = play(gestures, held, PULL, 1.0, way)
    first_s, first = told[0]
    (last,) = ended(told)
    assert (first.kind, last.kind) == ("pull", "pull")
    assert first_s < 0.4
    assert not first.ended
    off = math.remainder(last.angle_rad - angle, 2.0 * math.pi)
    assert abs(off) < math.radians(4.0)
    assert abs(off) < 4.0 * last.angle_sigma_rad
    assert last.confidence > 0.99
    assert sum(last.probabilities.values()) == pytest.approx(1.0)
    assert len(gestures.decisions) == len(told)


@pytest.mark.parametrize(
    ("kind", "course", "way", "turns"),
    [
        ("tap", half_sine(2.0, 0.05), (0.0, 0.0, 1.0), False),
        ("tap", half_sine(2.0, 0.05), (1.0, 0.0, 0.0), False),
        ("brush", half_sine(0.35, 0.15), (0.0, 1.0, 0.0), False),
        ("press", PULL, (1.0, 0.0, 0.0), False),
        ("twist", ramp(0.04, 0.15, 0.7), (1.0, 0.0, 0.0), True),
        ("twist", ramp(0.04, 0.15, 0.7), (0.0, 0.6, 0.8), True),
    ],
)
def test_what_a_hand_does_is_told_by_its_name(kind, course, way, turns):
    gestures, held = rested(Held(noise_n=0.01))
    (last,) = ended(play(gestures, held, course, 1.2, way, turns=turns))
    assert last.kind == kind


def test_away_from_the_person_is_a_push():
    gestures, held = rested(towards=(0.0, -1.0, 0.0))
    (away,) = ended(play(gestures, held, PULL, 1.2, (0.0, 1.0, 0.0)))
    (here,) = ended(play(gestures, held, PULL, 1.2, (0.0, -1.0, 0.0)))
    assert (away.kind, here.kind) == ("push", "pull")


@long_after_first("rise_s", [0.02, 0.15, 0.5])
def test_a_pull_of_fifteen_seconds_is_told_once_and_its_end_is_no_gesture(rise_s):
    gestures, held = rested()
    told = play(gestures, held, ramp(1.2, rise_s, 15.0), 16.0, (0.0, 1.0, 0.0))
    (last,) = ended(told)
    assert (last.kind, last.duration_s) == ("pull", pytest.approx(10.0, abs=0.1))
    assert max(time_s for time_s, _ in told) < 10.1
    assert gestures.disturbance.rest.load[1] == pytest.approx(0.0, abs=0.1)
    (again,) = ended(play(gestures, held, PULL, 1.2, (0.0, -1.0, 0.0)))
    assert again.kind == "pull"
    assert math.degrees(abs(again.angle_rad)) == pytest.approx(180.0, abs=6.0)


def test_another_gesture_during_a_long_pull_is_told():
    gestures, held = rested()
    tap = half_sine(2.0, 0.05)
    way = np.array([0.0, 1.0, 0.0])
    told = []
    for cycle in range(round(16.0 / 0.004)):
        t = 0.004 * cycle
        force = ramp(1.2, 0.15, 15.0)(t) * way + [0.0, 0.0, -tap(t - 12.0)]
        if (gesture := gestures.update(held.cycle(force=force))) is not None and gesture.ended:
            told.append(gesture)
    assert [gesture.kind for gesture in told] == ["pull", "tap"]


def test_a_drift_is_no_gesture():
    gestures, held = rested()
    assert play(gestures, held, lambda t: 0.05 * t, 6.0) == []


def test_units_that_fall_silent_are_no_gesture_and_a_pull_goes_on():
    gestures, held = rested()
    held.status[[3, 20]] = int(Status.FAULT)
    assert play(gestures, held, nothing, 0.6) == []

    def pull(t):
        held.status[[8, 9]] = int(Status.STALE) if t > 0.3 else 0
        return PULL(t)

    (last,) = ended(play(gestures, held, pull, 1.2))
    assert last.kind == "pull"
    assert math.degrees(last.angle_rad) == pytest.approx(90.0, abs=6.0)
    held.status[:] = 0
    assert play(gestures, held, nothing, 0.6) == []


def test_while_the_bus_stops_nothing_is_told_and_a_pull_is_told_after():
    gestures, held = rested()

    def stops(t):
        held.status[:] = int(Status.STALE) if 0.2 < t < 0.4 else 0
        return 0.0

    assert play(gestures, held, stops, 0.8) == []

    def pulled(t):
        stops(t)
        return PULL(t)

    (last,) = ended(play(gestures, held, pulled, 1.2))
    assert last.kind == "pull"
    held.stamp_ns += 200_000_000  # no states at all for that time
    assert play(gestures, held, nothing, 0.4) == []


@pytest.mark.long
def test_people_are_understood_on_the_simulator():
    trial = run(3, lambda random: story(random)[6:])
    assert [seen.is_right for seen in trial.seen] == [True] * 5
    off = [seen.off_rad for seen in trial.seen if math.isfinite(seen.off_rad)]
    assert np.degrees(np.abs(off)).max() < 8.0
    assert trial.others == []
