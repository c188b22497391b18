"""Zeros of the units: followed while provably nothing presses, and never while something does."""

from __future__ import annotations

import numpy as np
import pytest

from skin.decode.ambient import Ambient
from tests.fixtures.ambient import World, apart, without_bz
from tests.fixtures.cases import long_after_first

UNITS = 24
SIGMA_HZ = 6.0
HOUR_S = 3600.0
BEGIN_S = 120.0  # until every zero is followed, at 10 Hz


def begun(skin=None, **options):
    skin = apart(UNITS) if skin is None else skin
    ambient, world = Ambient(skin, **options), World(skin)
    world.run(ambient, BEGIN_S)
    assert ambient.followed.mean() > 0.8
    return ambient, world


def creep(world, ambient, seconds, *, press=0.0, drift=0.0):
    """Let frequencies fall by a press or by drift, Hz a minute, in steps of a minute's tenth."""
    for _ in range(round(seconds / 6.0)):
        world.drop_hz += np.asarray(press) / 10.0
        world.drift_hz += np.asarray(drift) / 10.0
        world.run(ambient, 6.0)


def load_hz(ambient, world):
    """Fall of the frequency that is left in the readings, without noise, shape (n,)."""
    return world.drop_hz + world.drift_hz - ambient.background[0]


def test_held_press_has_not_moved_after_an_hour():
    """Whatever it is: also one too light to be a contact, at the edge of what counts as calm."""
    ambient, world = begun()
    light = [0.5, 1.0, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 17.0, 18.0]
    world.drop_hz[:] = [*light, 19.0, 20.0, 30.0, 60.0, 100.0, 500.0, 1000.0, 1500.0, 1800.0]
    zero = ambient.zero
    world.run(ambient, HOUR_S)
    moved = np.abs(load_hz(ambient, world) - (world.drop_hz - zero[0]))
    assert moved.max() < SIGMA_HZ
    assert moved[world.drop_hz > SIGMA_HZ].max() < 0.35 * SIGMA_HZ
    assert not ambient.followed[world.drop_hz > SIGMA_HZ].any()
    # sideways too: the field of a unit that is held stays what it is
    held = world.drop_hz > SIGMA_HZ
    assert np.abs(ambient.zero[1:, held] - zero[1:, held]).max() < 1.0


def test_drift_under_a_press_is_made_up_for_after_it():
    """Bz tells that the unit is at rest, though its frequency is not where it was."""
    ambient, world = begun(apart(UNITS, 20.0))
    world.drop_hz[[4, 13]] = 300.0
    creep(world, ambient, 600.0, drift=1.0)
    world.drop_hz[:] = 0.0
    assert load_hz(ambient, world)[[4, 13]] == pytest.approx([10.0, 10.0], abs=1.0)
    creep(world, ambient, 900.0)
    assert np.abs(load_hz(ambient, world)).max() < 0.3 * SIGMA_HZ


def test_what_may_have_drifted_under_a_press_silences_no_unit_after_it():
    """10 Hz at a Hertz a minute, on half of the units: by itself it would be a light touch."""
    ambient, world = begun()
    pressed = np.arange(UNITS) < UNITS // 2
    world.drop_hz[pressed] = 300.0
    creep(world, ambient, 600.0, drift=1.0 * pressed)
    assert ambient.voters.tolist() == [UNITS // 2]
    world.drop_hz[:] = 0.0
    world.run(ambient, 3.0)
    assert ambient.voters.tolist() == [UNITS]


@long_after_first("rate_hz_per_min", [0.5, -0.5, 0.9])
def test_drift_of_unloaded_units_is_followed(rate_hz_per_min):
    ambient, world = begun()
    creep(world, ambient, 1200.0, drift=rate_hz_per_min)
    assert np.abs(world.drift_hz).min() > 9.9
    assert np.abs(load_hz(ambient, world)).max() < 0.5 * SIGMA_HZ
    assert ambient.followed.mean() > 0.8


@long_after_first("rate_hz_per_min", [0.3, 0.5, 0.9, 1.2, 2.0, 5.0])
def test_press_that_creeps_is_not_taken_for_drift(rate_hz_per_min):
    """Three units of 24, slower and faster than a zero may follow: Bz tells it from drift."""
    ambient, world = begun()
    press = np.zeros(UNITS)
    press[[3, 11, 19]] = rate_hz_per_min
    creep(world, ambient, 20.0 / rate_hz_per_min * 60.0, press=press)
    pressed = press > 0.0
    assert np.all(world.drop_hz[pressed] > 19.9)
    assert np.abs(ambient.zero[0, pressed]).max() < 1.3 * SIGMA_HZ
    assert not ambient.followed[pressed].any()
    assert ambient.followed[~pressed].mean() > 0.8


def test_zero_goes_no_farther_than_its_span_and_wants_a_tare():
    ambient, world = begun(without_bz(apart(UNITS)))
    drift = np.zeros(UNITS)
    drift[:2] = 0.8
    creep(world, ambient, 5400.0, drift=drift)
    assert ambient.zero[0, :2] == pytest.approx([60.0, 60.0])
    assert load_hz(ambient, world)[0] == pytest.approx(12.0)


# -- with the decoder ------------------------------------------------------------------------------


def test_drift_of_an_offset_is_followed():
    ambient, world = begun()
    for _ in range(60):
        world.stray_ut[0, ::2] += 0.5
        world.stray_ut[0, 1::2] -= 0.5
        world.run(ambient, 30.0)  # 1 µT a minute
    assert np.abs(world.stray_ut[0]).min() > 29.0
    assert np.abs(world.stray_ut[:2] - ambient.zero[1:]).max() < 15.0


def test_press_that_creeps_without_bz_is_absorbed_only_if_slower_than_said():
    ambient, world = begun(without_bz(apart(UNITS)))
    press = np.zeros(UNITS)
    press[:4] = 0.5, 2.0, 5.0, 20.0
    creep(world, ambient, 1200.0, press=press)
    taken = ambient.zero[0, :4]
    assert taken[0] > 8.0
    assert taken[1:].max() < SIGMA_HZ
