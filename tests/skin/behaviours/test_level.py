"""Imbalance and the arm of a weight, from forces that are added up by hand."""

import math

import numpy as np
import pytest

from skin.behaviours.level import Level, LevelSettings
from skin.errors import OptionError
from topology import load


def hang(held, arm_m, left_share=0.5):
    """Let the weight hang beside the line between the pads: torsion on both, a vertical couple on
    their units; and nearer to one of them."""
    topology = held.topology
    held.spoilt_n[:] = 0.0
    for pad, share in ((0, left_share), (1, 1.0 - left_share)):
        own = topology.patch == pad
        place = topology.position[1, own] - topology.position[1, own].mean()
        couple = -held.weight_n * arm_m * 0.5 * place / np.sum(place**2)
        extra = -(share - 0.5) * held.weight_n / own.sum()
        world = np.zeros((3, own.sum()))
        world[2] = couple + extra
        held.spoilt_n[:, own] = np.einsum("abn,an->bn", topology.rotation[:, :, own], world)


def go(held, level, seconds):
    for _ in range(round(seconds / held.period_s)):
        level.update(held.step())


@pytest.mark.parametrize("arm_m", [-0.006, 0.0, 0.004])
def test_the_arm_is_where_the_weight_hangs(held, arm_m):
    level = Level(held.topology)
    hang(held, arm_m)
    go(held, level, 2.0)
    assert level.known
    along = level.arm_m * level.across
    np.testing.assert_allclose(along, [0.0, arm_m, 0.0], atol=5.0 * level.arm_sigma_m + 1e-4)
    assert level.level == (arm_m == 0.0)


def test_the_imbalance_is_that_of_the_pads(held):
    level = Level(held.topology)
    hang(held, 0.0, left_share=0.7)
    go(held, level, 2.0)
    assert level.imbalance == pytest.approx(0.4, abs=5.0 * level.imbalance_sigma)
    assert not level.level


def test_what_weighs_nothing_is_not_known(held):
    level = Level(held.topology)
    held.weight_n = 0.1
    go(held, level, 2.0)
    assert not level.known
    assert math.isnan(level.arm_m)


def test_a_silent_bus_makes_it_unknown_and_it_comes_back(held):
    level = Level(held.topology)
    go(held, level, 2.0)
    assert level.level
    held.heard = False
    go(held, level, 0.2)
    assert not level.known
    numbers = level.imbalance, level.imbalance_sigma, level.arm_m, level.arm_sigma_m
    assert all(map(math.isnan, numbers))
    held.heard = True
    go(held, level, 0.5)
    assert level.level


@pytest.mark.parametrize("units", [[5, 22], [0, 1, 2, 3]], ids=["two", "four in a row"])
def test_silent_units_and_a_magnet_do_not_tip_it(held, units):
    level = Level(held.topology)
    go(held, level, 2.0)
    held.spoilt_n[:2, units] = 2.0
    held.valid[units] = False
    go(held, level, 1.0)
    assert abs(level.arm_m) < 0.006
    assert abs(level.imbalance) < 0.15


@pytest.mark.parametrize("names", [("left",), "left", ("left", "left"), ("left", "rigth")])
def test_other_than_two_pads_are_refused(held, names):
    with pytest.raises(OptionError, match=r"^pads: must "):
        Level(held.topology, names)


def test_a_skin_of_one_pad_and_three_fingers_are_refused():
    with pytest.raises(OptionError, match="pads: must be two that face each other"):
        Level(load("fingertip"))
    with pytest.raises(OptionError, match="pads: must be two that face each other"):
        Level(load("hand"), ("thumb", "index", "middle"))


@pytest.mark.parametrize("down", [(0, 0, 0), (0, 0, math.nan), (0, 1), "down", (0, 0, math.inf)])
def test_a_direction_that_is_none_is_refused(down):
    with pytest.raises(OptionError, match="down: must be three numbers"):
        LevelSettings(down=down)


def test_a_weight_along_the_normals_is_refused(held):
    normal = tuple(held.topology.rotation[:, 2, 0].tolist())
    with pytest.raises(OptionError, match="down: must not be along the normal of pad 'left'"):
        Level(held.topology, settings=LevelSettings(down=normal))
