"""Friction that differs over the face: a posterior, against the truth."""

import numpy as np
import pytest

from skin.contact.record import SlipState
from tests.skin.contact.slip.hold import Hold

MEAN = 0.5


def slid(seed, spread, share=0.6):
    """A hold whose units have slipped so far as that share of them; what is true, and friction."""
    hold = Hold(5, 5, seed=seed)
    load = hold.dome()
    friction = MEAN * np.maximum(1.0 + spread * hold.rng.standard_normal(hold.n), 0.2)
    for t in range(1000):
        truth = hold.step(load, (0.008 * max(0, t - 50), 0.0), friction)
        if truth.slips.mean() > share or hold.contact.slip == SlipState.GROSS:
            return hold, truth, friction, load
    raise AssertionError("too slow")


def test_friction_that_differs_by_a_third_is_told_without_bias():
    found, true, few = [], [], []
    for seed in range(12):
        hold, truth, friction, _ = slid(seed, 0.3)
        found.append(hold.contact.friction)
        true.append(friction.mean())
        few.append(friction[truth.slips].mean())
    # those that slid first have least of it
    assert np.mean(few) < 0.95 * MEAN
    assert np.mean(found) == pytest.approx(np.mean(true), rel=0.05)
    assert np.mean(np.abs(np.array(found) / true - 1.0)) < 0.1


def test_the_spread_of_friction_is_learned():
    spreads = [
        np.mean([slid(seed, spread)[0].contact.friction_spread for seed in range(12)])
        for spread in (0.0, 0.3)
    ]
    assert spreads[0] < 0.08 * MEAN
    assert spreads[1] == pytest.approx(0.3 * MEAN, rel=0.3)


def test_sigma_of_friction_and_of_grip_force_covers_the_truth():
    friction_off, grip_off = [], []
    for seed in range(16):
        hold, truth, friction, load = slid(seed, 0.05)
        contact = hold.contact
        # what holds is the friction of all faces, each by its load
        mean = np.average(friction, weights=load)
        grip = 1.2 * np.hypot(*truth.shear.sum(axis=1)) / mean
        friction_off.append((contact.friction - mean) / contact.friction_sigma)
        grip_off.append((contact.grip_force - grip) / contact.grip_force_sigma)
    for off in (friction_off, grip_off):
        assert np.mean(np.abs(off) < 2.0) > 0.9
        # and is no excuse
        assert np.sqrt(np.mean(np.square(off))) > 0.2
