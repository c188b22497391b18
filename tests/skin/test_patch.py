"""A part of the skin by its name: units, contacts, and their wrench in both frames."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import numpy as np
import pytest

import skin
from skin.errors import OptionError
from topology.errors import UnknownNameError


@pytest.fixture(scope="module")
def states():
    """Some cycles of the gripper, pressed on one pad."""
    with skin.open("gripper", simulate=True, pace=False) as gripper:
        return [*itertools.islice(gripper, 0, 1500, 50)]


def test_parts_add_up_to_the_whole_skin(states):
    touched = 0
    for state in states:
        parts = [state.patch(name) for name in state.topology.patch_names]
        np.testing.assert_allclose(sum(one.wrench for one in parts), state.wrench, 1e-5, 1e-6)
        assert sum(one.index.size for one in parts) == state.topology.n
        touched += any(one.contacts for one in parts)
        for one in parts:
            assert (one.wrench_sigma > 0.0).all()
            if len(one.contacts) == 1:
                np.testing.assert_allclose(one.wrench_sigma, one.contacts[0].wrench_sigma)
    assert touched


def test_the_frame_of_a_patch_moves_with_it(states):
    state = max(states, key=lambda one: len(one.contacts))
    for name in state.topology.patch_names:
        part = state.patch(name)
        turn, origin = part.pose
        np.testing.assert_allclose(turn @ part.local_wrench[:3], part.wrench[:3], atol=1e-9)
        torque = turn @ part.local_wrench[3:] + np.cross(origin, part.wrench[:3])
        np.testing.assert_allclose(torque, part.wrench[3:], atol=1e-9)
        assert (part.local_wrench_sigma > 0.0).all()
    with skin.open("gripper", simulate=True, pace=False) as gripper:
        home = next(iter(gripper)).patch("left")
        shift, quarter = np.array([0.0, 0.03, 0.0]), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        gripper.move_patch("left", quarter, shift)
        moved = next(iter(gripper)).patch("left")
    np.testing.assert_allclose(moved.pose[0], quarter @ home.pose[0], atol=1e-12)
    np.testing.assert_allclose(moved.pose[1], quarter @ home.pose[1] + shift, atol=1e-12)


def test_units_are_found_by_name(states):
    state = states[-1]
    name = state.topology.unit_names[5]
    unit = state.units[name]
    assert state.topology.index(name) == 5
    np.testing.assert_array_equal(unit.force, state.units.force[:, 5])
    assert unit.temperature == state.units.temperature[5]
    assert repr(unit).startswith("<Reading: 1 units, 100% valid")
    assert state.patch("left").units.force.shape == (3, 16)
    some = state.units[["right/r0c1", name]]
    np.testing.assert_array_equal(some.force[:, 1], unit.force)
    assert some.names == ("right/r0c1", name)
    with pytest.raises(UnknownNameError, match=r"left/r0c9.*nearest: 'left/r0c"):
        _ = state.units["left/r0c9"]


def test_parts_of_a_reading_know_the_names_of_their_own_units(states):
    state = states[-1]
    pad = state.patch("right").units
    for part in (pad, pad.copy(), pad[2:], pad[pad.valid]):
        np.testing.assert_array_equal(part["right/r0c2"].force, state.units["right/r0c2"].force)
        assert part.names is not None
        assert repr(part).startswith("<Reading: ")
    assert pad.names == tuple(state.patch("right").unit_names)
    with pytest.raises(UnknownNameError, match="left/r0c0"):
        _ = pad["left/r0c0"]


def test_a_copy_moves_on_its_own(states):
    other = states[-1].copy()
    other.poses[0][:] = 7.0
    assert not (states[-1].poses[0] == 7.0).any()


def test_patches_of_one_link_are_one_part():
    with skin.open("gripper", simulate=True, pace=False) as gripper:
        state = next(iter(gripper))
    links = state.topology.patch_links
    assert state.patch(links[0]).index.tolist() == state.patch("left").index.tolist()


def test_a_name_of_a_patch_and_its_frame_means_all_patches_on_the_frame(states):
    state = states[0].copy()
    skin_of = functools.partial(dataclasses.replace, state.topology, patch_names=("index", "side"))
    state.topology = skin_of(patch_frames=("index", "index"))
    assert state.patch("index").index.size == 32
    assert state.patch("side").index.size == 16
    state.topology = skin_of(patch_frames=("thumb", "index"))
    with pytest.raises(OptionError, match=r"got 'index', a patch on 'thumb' and a frame that"):
        state.patch("index")


def test_a_part_without_a_valid_unit_has_no_wrench(states):
    state = states[0].copy()
    left = state.patch("left")
    state.units.valid[left.index], state.whole = False, False
    assert np.isnan([left.wrench, left.wrench_sigma, left.local_wrench]).all()
    assert not left.whole


def test_an_unknown_part_names_the_nearest(states):
    with pytest.raises(OptionError, match=r"patch: must be .*got 'lefft' \(nearest: 'left'\)"):
        states[0].patch("lefft")


def test_a_patch_with_silent_units_is_not_whole(states):
    state = states[0].copy()
    left, right = state.patch("left"), state.patch("right")
    assert left.whole
    assert right.whole
    state.units.valid[left.index[3]], state.whole = False, False
    assert not state.patch("left").whole
    assert state.patch("left").coverage == pytest.approx(15 / 16)
    assert state.patch("right").whole


def test_what_untouched_units_read_together_beyond_their_noise_is_in_sigma(states):
    """0.03 N of each of 16 units, of 0.01 N of noise: 0.48 N may be there, and no more aside."""
    state = states[0].copy()
    state.units.force[:2], state.units.force[2], state.units.force_sigma[:] = 0.0, 0.03, 0.01
    pad = state.patch("left")
    assert not pad.contacts
    pressed = np.abs(state.poses[1][:, 2, pad.index[0]])
    np.testing.assert_allclose(pad.wrench_sigma[:3], 0.04 + 0.44 * pressed, rtol=1e-5)


def test_a_unit_that_is_never_heard_is_not_missed_and_counts_by_its_area(states):
    state = states[0].copy()
    unit = state.patch("left").index[3]
    others = np.arange(state.topology.n) != unit
    state.units.valid[unit], state.whole = False, False
    area = np.where(others, 1e-4, 3e-4)
    state.topology = dataclasses.replace(state.topology, enabled=others, area=area)
    assert state.patch("left").whole
    assert state.patch("left").coverage == pytest.approx(15 / 18)
    assert state.coverage == pytest.approx(31 / 34)


def test_what_is_not_there_names_the_nearest(states):
    state = max(states, key=lambda one: len(one.contacts))
    (contact, *_) = state.contacts
    for one, wrong, near in (
        (contact, "centre", "centroid"),
        (contact, "patern", "pattern"),
        (state, "wrenches", "wrench"),
        (state.units, "forces", "force"),
    ):
        with pytest.raises(AttributeError, match=f"nearest: '{near}'"):
            getattr(one, wrong)
    for far in ("force", "name", "temp"):
        with pytest.raises(AttributeError, match=f"no attribute '{far}'$"):
            getattr(contact, far)
    assert {"load", "wrench", "units"} <= {*dir(contact)}
    assert {"born_ns", "track", "pattern", "record", "copy"}.isdisjoint(dir(contact))
    assert len([name for name in dir(contact) if not name.startswith("_")]) <= 36
    assert len([name for name in dir(contact) if not name.startswith("_")]) < 48
