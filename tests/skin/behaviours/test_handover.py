"""Handovers of a block whose forces are made by hand, and of a person on the simulator."""

import numpy as np
import pytest

from bus.status import Status
from skin.behaviours.handover import Handover, Phase
from skin.errors import OptionError
from tests.fixtures.cases import long_after_first
from tests.skin.behaviours.held import Held, half_sine, nothing, play, ramp


def giving(held=None):
    """A handover that gives, at rest."""
    held = Held() if held is None else held
    handover = Handover(held.topology)
    handover.give()
    play(handover, held, nothing, 0.6)
    assert handover.phase is Phase.GIVING
    return handover, held


def taken_s(told):
    return next((time_s for time_s, phase in told if phase is Phase.TAKEN), None)


@pytest.mark.parametrize("rise_s", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("share", [0.8, 1.0, 1.3])
def test_a_hand_that_bears_the_weight_is_recognised_within_three_tenths(rise_s, share):
    handover, held = giving()
    told = play(handover, held, ramp(share * held.weight_n, rise_s, 5.0), 1.5)
    half_s = rise_s * 0.5 / share
    assert half_s < taken_s(told) < half_s + 0.3
    assert handover.decisions[-1].what == "taken"
    assert "borne for" in handover.decisions[-1].why


@pytest.mark.parametrize(
    ("course", "way"),
    [
        (half_sine(4.0, 0.05), (0.0, 0.0, 1.0)),
        (half_sine(1.5, 0.07), (0.0, 0.0, 1.0)),
        (half_sine(4.0, 0.08), (0.3, 0.5, 0.8)),
        (half_sine(1.8, 0.25), (0.0, 0.0, 1.0)),
        (half_sine(3.0, 0.2), (0.0, 0.0, 1.0)),
        (lambda t: 1.5 * np.sin(4.0 * np.pi * t), (0.0, 0.0, 1.0)),
        (half_sine(0.5, 0.3), (0.2, 0.9, 0.4)),
        (ramp(0.5, 0.2, 0.9), (0.0, 0.0, 1.0)),
        (ramp(2.0, 0.2, 0.9), (0.0, 1.0, 0.0)),
        (ramp(-2.0, 0.2, 0.9), (0.0, 0.0, 1.0)),
    ],
    ids=[
        "bump",
        "soft bump",
        "oblique bump",
        "slow bump",
        "strong slow bump",
        "swing",
        "brush",
        "partial",
        "sideways",
        "down",
    ],
)
def test_what_is_not_a_take_releases_nothing(course, way):
    handover, held = giving()
    assert taken_s(play(handover, held, course, 1.2, way)) is None


@long_after_first("size", [1.5, 3.0, 4.5])
def test_who_pulls_it_down_for_long_and_lets_go_bears_nothing(size):
    handover, held = giving()
    told = play(handover, held, lambda t: -size if t < 11.0 else 0.0, 13.0)
    assert taken_s(told) is None
    assert handover.weight_n == pytest.approx(1.5, abs=0.1)
    assert abs(handover.support) < 0.15
    assert taken_s(play(handover, held, ramp(1.5, 0.3, 5.0), 1.0)) < 0.5


def test_who_bears_a_part_for_long_and_lets_go_leaves_the_whole_weight():
    handover, held = giving()
    assert taken_s(play(handover, held, ramp(0.5, 0.1, 11.0), 12.0)) is None
    assert handover.weight_n == pytest.approx(1.5, abs=0.1)
    assert abs(handover.support) < 0.15


def test_who_leans_on_it_so_slowly_that_nothing_is_seen_bears_nothing_either():
    handover, held = giving(Held(weight_n=0.4))
    told = play(handover, held, lambda t: -0.04 * t if t < 25.0 else 0.0, 26.0)
    assert taken_s(told) is None
    assert handover.weight_n == pytest.approx(0.4, abs=0.05)
    assert abs(handover.support) < 0.15


def test_who_leans_on_it_from_the_start_bears_nothing_where_the_weight_is_known():
    held = Held()
    handover = Handover(held.topology)
    handover.give(1.5)
    told = play(handover, held, lambda t: -3.0 if t < 3.0 else 0.0, 4.5)
    assert taken_s(told) is None
    assert taken_s(play(handover, held, ramp(1.5, 0.3, 5.0), 1.0)) < 0.5
    with pytest.raises(OptionError, match="handover: weight_n: must be a number from"):
        handover.give(float("nan"))


def test_a_bump_just_when_the_weight_is_learned_hides_no_hand():
    held = Held()
    handover = Handover(held.topology)
    handover.give()

    def course(t):
        if t < 1.0:
            return 0.0 if t < 0.39 else 1.4 if t < 0.45 else -0.5
        return ramp(1.5, 0.2, 5.0)(t - 1.0)

    assert 1.1 < taken_s(play(handover, held, course, 2.0)) < 1.4


def test_a_hand_that_pulls_too_much_is_recognised_when_it_eases():
    handover, held = giving()
    told = play(handover, held, lambda t: 3.75 if t < 0.8 else 1.5, 2.0)
    assert 0.8 < taken_s(told) < 1.2


def test_without_a_weight_nothing_is_given():
    handover, held = giving(Held(weight_n=0.1))
    assert taken_s(play(handover, held, ramp(1.0, 0.2, 5.0), 1.0)) is None


def test_units_that_fall_silent_release_nothing_and_a_take_is_recognised_without_them():
    handover, held = giving()
    for lost in ([0, 1, 2], [0, 1, 2, 16, 17, 18], [0, 1, 2]):
        held.status[:] = 0
        held.status[lost] = int(Status.STALE)
        assert taken_s(play(handover, held, nothing, 0.4)) is None
    assert taken_s(play(handover, held, ramp(1.4, 0.2, 5.0), 1.0)) < 0.35


def test_while_the_bus_stops_nothing_is_released_and_a_take_in_between_is_found():
    handover, held = giving()

    def course(t):
        held.status[:] = int(Status.STALE) if 0.2 < t < 0.4 else 0
        return ramp(1.4, 0.15, 9.0)(t - 0.2) if t > 0.2 else 0.0

    assert 0.4 < taken_s(play(handover, held, course, 1.0)) < 0.65
    handover.give()
    held.stamp_ns += 200_000_000
    assert taken_s(play(handover, held, lambda _: 1.4, 0.6)) is None


def test_a_magnet_at_one_pad_is_no_hand_whether_it_is_seen_or_not():
    handover, held = giving()
    for cycle in range(250):
        phase = handover.update(held.cycle(lies=min(1.4, 0.05 * cycle)))
        assert phase is Phase.GIVING
    held.status[:16] = int(Status.MAGNETIC_ANOMALY)
    assert taken_s(play(handover, held, nothing, 0.5)) is None
    assert handover.phase is Phase.GIVING
