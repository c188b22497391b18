"""The grip control on a pinch by hand, whose friction and weight are known."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from skin.behaviours.grip import GripControl, GripParameters, Phase
from skin.contact.record import SlipState
from tests.fixtures.cases import long_after_first
from tests.skin.behaviours.pinch import PERIOD_S, Pinch


def held(seconds=3.0, **options):
    """A pinch that is held and has been probed, and its control."""
    pinch = Pinch(**options)
    control = GripControl(pinch.topology, pinch)
    pinch.go(control, seconds)
    assert control.phase is Phase.HOLDING
    return pinch, control


@long_after_first("friction", [0.32, 0.55, 0.85])
@long_after_first("share", [0.8, 1.0])
def test_friction_is_found_and_the_grip_is_hardly_more_than_holds(friction, share):
    shares = []
    for seed in range(5):
        pinch, control = held(friction=friction, kinetic=share * friction, seconds=4.0, seed=seed)
        assert control.is_tested
        assert control.least_friction < 1.02 * friction
        assert control.friction == pytest.approx(friction, rel=0.25)
        assert pinch.slid_m < 0.006
        shares.append(pinch.grip_n / pinch.needed_n)
    assert min(shares) > 1.0
    assert np.median(shares) < 1.6


@pytest.mark.parametrize("rise_s", [0.1, 0.3])
def test_the_grip_rises_with_a_pull_before_it_slips(rise_s):
    pinch, control = held()
    before_m = pinch.slid_m
    for share in np.linspace(0.0, 1.0, round(rise_s / PERIOD_S)):
        pinch.pull_n = 1.5 * share * pinch.mass_kg * 9.81
        pinch.go(control, PERIOD_S)
    pinch.go(control, 0.5)
    assert pinch.slid_m - before_m < 1e-3
    assert 1.0 < pinch.grip_n / pinch.needed_n < 1.6


def test_after_a_pull_the_grip_is_what_it_was():
    pinch, control = held(seconds=5.0)
    before_n = pinch.go(control, 0.5).mean()
    for pull_n in 1.2 * np.sin(np.linspace(0.0, np.pi, 100)):
        pinch.pull_n = pull_n
        pinch.go(control, PERIOD_S)
    pinch.pull_n = 0.0
    pinch.go(control, 2.0)
    assert pinch.go(control, 0.5).mean() == pytest.approx(before_n, rel=0.05)


def test_two_alarms_of_a_slide_double_the_grip():
    """By 1.4 each; the second counts once the gripper has had 0.04 s to answer the first."""
    pinch = Pinch()
    control = GripControl(pinch.topology, pinch, GripParameters(probe=False))
    pinch.go(control, 2.0)
    before_n = control.wanted_n
    sliding = SimpleNamespace(id=1, slip=SlipState.GROSS, onset_s=0.0, load=3.0, arm=0.01)
    pinch.state.contacts = [sliding]
    pinch.go(control, 0.036)
    assert control.wanted_n == pytest.approx(1.4 * before_n, rel=0.05)
    pinch.go(control, 0.012)
    assert control.wanted_n == pytest.approx(1.4 * 1.4 * before_n, rel=0.05)


def test_no_more_than_the_most_is_asked_for_and_that_is_told():
    pinch = Pinch(mass_kg=0.6, friction=0.3, kinetic=0.3)
    control = GripControl(pinch.topology, pinch, GripParameters(most_grip_n=5.0))
    pinch.go(control, 0.8)
    assert pinch.asked_n <= 5.0
    assert any(one.what == "grips no harder" for one in control.decisions)


def test_silent_units_of_a_pad_leave_the_grip_as_it_is():
    pinch, control = held()
    before_n = pinch.go(control, 0.3).mean()
    pinch.silent[[0, 5, 9, 17, 30]] = True
    after = pinch.go(control, 1.0)
    assert after.mean() == pytest.approx(before_n, rel=0.12)
    assert (after > pinch.needed_n).all()


def test_a_silent_pad_keeps_its_grip_and_then_gets_a_safe_one():
    pinch, control = held()
    before_n = control.wanted_n
    pinch.silent[:16] = True
    kept = pinch.go(control, 0.08)
    assert (kept > 0.97 * before_n).all()
    pinch.go(control, 0.3)
    assert control.wanted_n == pytest.approx(1.5 * before_n, rel=0.05)
    assert pinch.felt_n[-1] == pytest.approx(control.wanted_n, rel=0.2)  # by the other pad
    pinch.silent[:] = True
    pinch.go(control, PERIOD_S)
    assert math.isnan(pinch.felt_n[-1])
    told = [one.what for one in control.decisions]
    assert "keeps its grip" in told
    assert told[-1] == "grips harder"


def test_a_pull_that_one_pad_alone_hears_is_gripped_for():
    pinch, control = held()
    pinch.silent[:16] = True
    pinch.go(control, 0.02)
    slid_m = pinch.slid_m
    for pull_n in np.linspace(0.0, 4.0, 100):
        pinch.pull_n = pull_n
        pinch.go(control, PERIOD_S)
    pinch.go(control, 0.3)
    assert pinch.grip_n > pinch.needed_n
    assert pinch.slid_m - slid_m < 1e-3


def test_a_pad_that_comes_and_goes_raises_the_grip_once():
    pinch, control = held()
    before_n = control.wanted_n
    for _ in range(15):
        pinch.silent[:16] = True
        pinch.go(control, 0.12)
        pinch.silent[:16] = False
        pinch.go(control, 0.008)
    assert 1.3 * before_n < control.wanted_n < 1.9 * before_n


def test_a_silent_pad_raises_the_grip_to_the_most_at_most():
    pinch = Pinch()
    control = GripControl(pinch.topology, pinch, GripParameters(most_grip_n=3.0))
    pinch.go(control, 0.5)
    pinch.silent[:16] = True
    pinch.go(control, 0.5)
    assert control.wanted_n == 3.0


def test_a_pad_that_is_silent_from_the_start_does_not_keep_it_from_holding():
    pinch = Pinch()
    pinch.silent[:16] = True
    control = GripControl(pinch.topology, pinch)
    pinch.go(control, 1.0)
    assert control.phase is Phase.HOLDING
    assert [one.what for one in control.decisions][:2] == ["waits", "holds"]
    assert pinch.grip_n > pinch.needed_n
    assert pinch.slid_m < 1e-3


def test_a_grip_that_does_not_loosen_is_not_asked_again():
    pinch = Pinch()
    control = GripControl(pinch.topology, pinch)
    pinch.go(control, 0.55)
    wedged_n = pinch.grip_n = 3.0
    for _ in range(700):
        pinch.grip_n = wedged_n
        pinch.go(control, PERIOD_S)
    told = [one.what for one in control.decisions]
    assert told.count("dips") == told.count("asks no more") == 1
    assert not control.is_tested


def test_numbers_that_are_none_poison_nothing():
    pinch, control = held()
    for value in (np.nan, np.inf):
        show = pinch._show
        pinch._show = lambda shear_n, value=value, show=show: (
            show(shear_n),
            pinch.units.force.__setitem__((slice(0, 2), slice(0, 16)), value),
        )
        pinch.go(control, 0.02)
        pinch._show = show
        pinch.go(control, 0.5)
        assert np.isfinite(pinch.asked_n)
    assert pinch.grip_n > pinch.needed_n


def test_to_close_on_what_is_held_loosens_nothing():
    pinch, control = held(mass_kg=0.3, friction=0.35, kinetic=0.33)
    before_n, slid_m = control.wanted_n, pinch.slid_m
    assert before_n > control.parameters.first_grip_n
    control.close()
    pinch.go(control, 0.1)
    assert control.wanted_n >= 0.99 * before_n
    assert pinch.slid_m == slid_m


def test_a_bus_that_stops_for_200_ms_drops_nothing_and_is_forgotten():
    pinch, control = held(seconds=4.0)
    before_n, slid_m = pinch.go(control, 0.3).mean(), pinch.slid_m
    pinch.silent[:] = True
    stopped = pinch.go(control, 0.2)
    assert (stopped > 0.97 * stopped[0]).all()
    pinch.silent[:] = False
    pinch.go(control, 1.5)
    assert pinch.slid_m == slid_m
    assert pinch.go(control, 0.3).mean() == pytest.approx(before_n, rel=0.1)
    assert any(one.what == "hears all pads again" for one in control.decisions)


def test_states_that_come_late_do_not_let_go():
    pinch, control = held()
    pinch.state.stamp_ns += 200_000_000
    before_n = control.wanted_n
    pinch.go(control, PERIOD_S)
    assert control.wanted_n > 0.9 * min(before_n, 1.1 * pinch.needed_n)


def test_a_release_is_gentle_and_ends_open():
    pinch, control = held()
    control.release()
    before_n = control.wanted_n
    grips = pinch.go(control, before_n / control.parameters.release_n_per_s + 0.1)
    assert np.diff(grips).min() > -0.1
    assert control.phase is Phase.OPEN
    assert pinch.is_open
    assert grips[-1] < 0.1


def test_a_release_goes_on_by_five_periods_at_most_where_states_come_late():
    pinch, control = held()
    control.release()
    before_n = control.wanted_n
    pinch.state.stamp_ns += 1_000_000_000
    pinch.go(control, PERIOD_S)
    assert control.wanted_n == pytest.approx(before_n - 5.0 * 5.0 * PERIOD_S)


def test_a_hand_that_moves_unevenly_is_not_probed():
    pinch = Pinch()
    control = GripControl(pinch.topology, pinch)
    control.is_steady = False
    pinch.go(control, 2.0)
    assert not control.is_tested
    control.is_steady = True
    pinch.go(control, 2.5)
    assert control.is_tested


def test_without_a_probe_the_belief_stays():
    pinch = Pinch()
    control = GripControl(pinch.topology, pinch, GripParameters(probe=False))
    pinch.go(control, 2.0)
    assert control.least_friction == pytest.approx(0.25, rel=0.05)
    assert pinch.slid_m == 0.0


def test_a_pull_while_it_dips_is_gripped_for():
    for start_s in (0.7, 0.8, 0.9, 1.0, 1.1):
        pinch = Pinch()
        control = GripControl(pinch.topology, pinch)
        pinch.go(control, start_s)
        assert any(one.what == "dips" for one in control.decisions)
        for share in np.linspace(0.0, 1.0, 50):
            pinch.pull_n = 1.2 * share * pinch.mass_kg * 9.81
            pinch.go(control, PERIOD_S)
        pinch.go(control, 1.0)
        assert pinch.grip_n > pinch.needed_n
        assert pinch.slid_m < 0.01


def test_units_that_feel_nothing_cost_no_grip_where_the_gripper_has_its_own_sensor():
    pinch, control = held(seconds=4.0)
    show = pinch._show

    def stuck(shear_n):
        show(shear_n)
        pinch.units.force[:, [1, 7, 18, 29]] = 0.0  # an eighth, which no flag shows

    pinch._show = stuck
    pinch.go(control, 3.0)
    assert control.gain == pytest.approx(32 / 28, rel=0.05)
    assert pinch.grip_n / pinch.needed_n > 1.1
    assert pinch.grip_n == pytest.approx(control.wanted_n * 32 / 28, rel=0.1)


def test_what_hung_is_gripped_for_while_somebody_bears_it():
    pinch, control = held(seconds=4.0)
    slid_m = pinch.slid_m
    pinch.pull_n = -0.95 * pinch.mass_kg * 9.81
    pinch.go(control, 1.5)
    pinch.pull_n = 0.0  # lets go within a cycle
    pinch.go(control, 0.5)
    assert pinch.slid_m - slid_m < 1e-3


@pytest.mark.parametrize("share", [0.5, 0.7])
def test_what_was_borne_before_a_grip_falls_is_no_bound_of_friction(share):
    for seed in range(5):
        pinch, control = held(seconds=4.0, friction=0.5, kinetic=0.45, seed=seed)
        fallen_n = share * pinch.needed_n
        for _ in range(8):  # a gripper that sticks, and lets go at once
            pinch.grip_n = fallen_n
            pinch.go(control, PERIOD_S)
        pinch.go(control, 0.5)
        assert control.least_friction < 1.02 * pinch.friction
