"""What a contact tells of slip besides its state: who began, where to, how likely."""

import numpy as np
import pytest

from skin.contact.record import SlipState
from tests.skin.contact.slip.hold import Hold

FRICTION = 0.4


def until_slip(seed, heading=0.0, speed_mm=0.016, **settings):
    """A hold that has just begun to slip; what is true, and the probabilities until then."""
    hold, told = Hold(5, 5, seed=seed, **settings), []
    for t in range(400):
        way_mm = speed_mm * max(0, t - 100)
        way = way_mm * np.cos(heading), way_mm * np.sin(heading)
        truth = hold.step(hold.dome(), way, FRICTION)
        told.append(hold.contact.slip_probability)
        if hold.contact.slip >= SlipState.INCIPIENT:
            return hold, truth, np.array(told)
    raise AssertionError("no slip")


def test_slip_began_names_units_that_slip_in_truth():
    named, right, lightest = 0, 0, 0
    for seed in range(8):
        hold, truth, _ = until_slip(seed)
        began = hold.contact.slip_began
        assert began.size
        named += began.size
        right += truth.slips[began].sum()
        lightest += bool(set(began.tolist()) & set(np.argsort(hold.dome())[:4].tolist()))
    assert right / named > 0.8
    assert lightest >= 7


@pytest.mark.parametrize("heading", [0.7, -1.6])
def test_slip_direction_is_where_the_body_goes(heading):
    for seed in range(3):
        hold, _, _ = until_slip(seed, heading)
        x, y, z = hold.contact.slip_direction
        off = np.angle(np.exp(1j * (np.arctan2(y, x) - heading)), deg=True)
        assert abs(off) < 5.0
        assert z == 0.0
        assert 0.95 < np.hypot(x, y) <= 1.0 + 1e-9


def test_probability_of_slip_rises_from_nothing_to_certainty():
    for seed in range(3):
        _, _, told = until_slip(seed)
        assert np.isnan(told[0])
        assert np.median(told[1:100]) < 1e-3
        assert told[-1] > 0.95
        assert np.isfinite(told[1:]).all()


def alone_afterwards(hold, load, displacement_mm, cycles=3):
    """The contact that unit 12 alone makes, long after all others have gone."""
    force, moved = np.zeros((2, 3, hold.n))
    for _ in range(2000):
        hold.now_ns += 4_000_000
        found = hold.stream.update(force, hold.force_sigma, moved, hold.sigma, stamp_ns=hold.now_ns)
    assert not found
    force[2, 12], moved[0, 12] = load, displacement_mm
    for _ in range(cycles):
        hold.now_ns += 4_000_000
        (found,) = hold.stream.update(
            force, hold.force_sigma, moved, hold.sigma, stamp_ns=hold.now_ns
        )
    return found


def test_a_contact_of_one_unit_says_nothing_of_the_slip_of_one_before():
    hold, _, _ = until_slip(0)
    contact = alone_afterwards(hold, 1.0, 0.5)
    assert contact.slip == SlipState.UNKNOWN
    assert np.isnan(contact.slip_probability)
    assert np.isnan(contact.slip_direction).all()


def test_a_copy_keeps_who_began_and_the_noise():
    hold, _, _ = until_slip(0)
    kept = hold.contact.copy()
    began, noise = hold.contact.slip_began.copy(), hold.contact.noise_ratio.copy()
    for _ in range(300):
        hold.step(hold.dome(), (3.0, 0.0), noise=0.1 * hold.rng.standard_normal((2, 25)))
    np.testing.assert_array_equal(kept.slip_began, began)
    np.testing.assert_array_equal(kept.noise_ratio, noise)
    assert not np.array_equal(hold.contact.noise_ratio, noise)
