"""The ambient field, told from units that nothing touches."""

from __future__ import annotations

import numpy as np
import pytest

import topology
from skin.decode import ambient_kernels
from skin.decode.ambient import Ambient
from tests.fixtures.ambient import World, apart, look
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import calibrated

EARTH = np.array([[20.0], [30.0], [-44.0]])


def settled(skin, *, seed=0, noise=True, seconds=8.0, **options):
    """A world at rest, and an `Ambient` that has got to know it."""
    ambient, world = Ambient(skin, **options), World(skin, seed=seed, noise=noise)
    world.run(ambient, seconds)
    return ambient, world


@long_after_first("name", ["palm", "fingertip", "strip"])
def test_uniform_field_is_found_on_skins_of_any_shape(name):
    skin = calibrated(topology.load(name).exact(), seed=3)
    ambient, world = settled(skin, noise=False, dtype="float64")
    world.ambient_ut[:] = EARTH
    world.run(ambient, 4.0)
    assert np.abs(ambient.field_ut - EARTH).max() < 0.1
    left = world.cycle(ambient.background).field_ut
    left[2] -= ambient.rest_ut
    assert np.abs(left).max() < 0.5  # beside the chip's gain, of which the loop knows nothing
    assert np.abs(ambient.zero[1:]).max() < 0.5


def test_covariance_holds_for_a_field_that_wanders_as_assumed():
    ambient, world = settled(topology.load("palm").exact())
    rng = np.random.default_rng(4)
    step = np.sqrt(ambient_kernels.WALK_UT2 / 250.0)
    misses = []
    for _ in range(6000):
        world.ambient_ut += step * rng.standard_normal((3, 1))
        look(ambient, world.cycle(ambient.background))
        misses.append(ambient.field_ut[:, 0] - world.ambient_ut[:, 0])
    spread = np.mean(np.square(misses[500:]), axis=0) / np.diag(ambient.covariance_ut2[0])
    assert np.all((0.7 < spread) & (spread < 1.4))


@pytest.mark.parametrize("lie_ut", [300.0, 2000.0, 20000.0])
def test_units_that_lie_do_not_count(lie_ut):
    """Two of eight units far from each other have their own field; plain means would give in."""
    skin = apart(8, 250.0)
    ambient, world = settled(skin)
    world.stray_ut[:, [2, 5]] = lie_ut
    world.ambient_ut[:] = EARTH
    world.run(ambient, 20.0)
    found = []
    for _ in range(500):
        look(ambient, world.cycle(ambient.background))
        found.append(ambient.field_ut[:, 0])
    bias = np.abs(np.mean(found, axis=0) - EARTH[:, 0])
    assert bias.max() < 8.0  # the plain mean is a quarter of the lie off


def test_a_unit_that_lies_all_at_once_counts_as_five_sigma():
    """By hand: the covariance over the variance of a reading, times five of its sigma."""
    ambient, world = settled(apart(8, 250.0), noise=False)
    before_ut, sigma_ut = ambient.field_ut, world.skin.parameters["field_noise_ut"][2]
    world.stray_ut[0, 2] = 2000.0
    look(ambient, world.cycle(ambient.background))
    moved_ut = np.linalg.norm(ambient.field_ut - before_ut)
    assert moved_ut == pytest.approx(5.0 * ambient.covariance_ut2[0, 0, 0] / sigma_ut, rel=0.05)


def test_too_few_unloaded_units_hold_the_field_and_say_so():
    skin = apart(8, 250.0)
    ambient, world = settled(skin)
    world.ambient_ut[:] = EARTH
    world.run(ambient, 3.0)
    world.drop_hz[:5] = 200.0
    world.run(ambient, 0.2)
    held, sigma = ambient.field_ut, [np.sqrt(ambient.residue_ut2[0])]
    assert ambient.voters.tolist() == [3]
    world.ambient_ut[:] = -EARTH
    for _ in range(4):
        world.run(ambient, 1.0)
        sigma.append(np.sqrt(ambient.residue_ut2[0]))
    assert np.array_equal(ambient.field_ut, held)
    assert np.all(np.diff(sigma) > 0.0)
    assert sigma[0] < 15.0
    assert 25.0 < sigma[1] < sigma[-1] <= 50.0
    world.drop_hz[:] = 0.0
    world.run(ambient, 3.0)
    assert np.abs(ambient.field_ut + EARTH).max() < 25.0
    assert np.sqrt(ambient.residue_ut2[0]) < 10.0


def test_the_field_of_before_a_touch_is_as_uncertain_as_it_is_old():
    """At 10 Hz one is kept each half second and gone back to after another: 0.9 s in cycle 605. A
    field wanders by 400 µT²/s, and by 833 µT² times the square of the time as the robot turns."""
    ambient, world = settled(apart(8), noise=False, seconds=60.4)
    expected = ambient.covariance_ut2[0, 0, 0]
    world.drop_hz[:] = 200.0
    world.run(ambient, 0.1)
    assert ambient.voters.tolist() == [0]
    for added in (0.9 * (400.0 + 833.0 * 0.9), 0.1 * (400.0 + 2.0 * 833.0 * 0.9)):
        expected += added / 2500.0 * (2500.0 - expected)
    assert ambient.covariance_ut2[0, 0, 0] == pytest.approx(expected, rel=0.01)


def test_parts_that_move_apart_have_a_field_each():
    skin = topology.load("hand").exact()
    body = np.array([skin.patch_frames[patch] for patch in skin.patch])
    ambient = Ambient(skin)
    world = World(skin, body=np.array([ambient.bodies.index(name) for name in body]))
    world.run(ambient, 8.0)
    rng = np.random.default_rng(1)
    world.ambient_ut[:] = 30.0 * rng.standard_normal(world.ambient_ut.shape)
    world.run(ambient, 3.0)
    assert ambient.field_ut.shape == (3, 6)
    miss = ambient.field_ut - world.ambient_ut
    assert np.sqrt(np.mean(miss**2)) < 8.0
