"""Laws of the total wrench and of the centre of pressure."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from tests.fixtures.contact_features import contact_features

sizes = st.integers(1, 70)
seeds = st.integers(0, 2**32 - 1)


def total_of(used, force, position, rotation):
    """The total of some units, contact or not."""
    return contact_features(np.where(used, 0, -1), force, 0.0, position, rotation, 1.0)[1]


def wrench(force, position, rotation, *, valid=None, origin=(0.0, 0.0, 0.0)):
    used = np.ones(force.shape[1], bool) if valid is None else valid
    return total_of(used, force, position - np.transpose([origin]), rotation)["wrench"]


def centroid(load, position):
    """Mean position, weighted by positive loads."""
    force = np.array([np.zeros(load.size), np.zeros(load.size), load])
    upright = np.repeat(np.eye(3)[:, :, np.newaxis], load.size, axis=2)
    return total_of(load > 0.0, force, position, upright)["centroid"]


def array_of(n, seed):
    """n random units: forces, positions, rotations."""
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(n, random_state=rng).as_matrix().transpose(1, 2, 0)
    return rng.normal(size=(3, n)), rng.normal(size=(3, n)) * 0.05, rotation


def reference(force, position, rotation):
    """The same sum, unit by unit."""
    total = np.zeros(6)
    for i in range(force.shape[1]):
        f = rotation[:, :, i] @ force[:, i]
        total += np.concatenate([f, np.cross(position[:, i], f)])
    return total


@given(sizes, seeds)
def test_wrench_is_the_sum_over_units(n, seed):
    arrays = array_of(n, seed)
    assert wrench(*arrays) == pytest.approx(reference(*arrays), abs=1e-12)


@given(sizes, seeds)
def test_wrench_adds_up_over_disjoint_sets(n, seed):
    arrays = array_of(n, seed)
    part = np.random.default_rng(seed + 1).random(n) < 0.5
    both = wrench(*arrays, valid=part) + wrench(*arrays, valid=~part)
    assert both == pytest.approx(wrench(*arrays), abs=1e-12)


@given(sizes, seeds)
def test_wrench_moves_with_the_array(n, seed):
    force, position, rotation = array_of(n, seed)
    rng = np.random.default_rng(seed + 2)
    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
    moved = wrench(
        force, turn @ position + shift[:, None], np.einsum("ij,jkn->ikn", turn, rotation)
    )
    before = wrench(force, position, rotation)
    push = turn @ before[:3]
    assert moved[:3] == pytest.approx(push, abs=1e-11)
    assert moved[3:] == pytest.approx(turn @ before[3:] + np.cross(shift, push), abs=1e-11)


@given(sizes, seeds)
def test_wrench_about_another_point_is_shifted(n, seed):
    arrays = array_of(n, seed)
    point = np.random.default_rng(seed).normal(size=3)
    here, there = wrench(*arrays), wrench(*arrays, origin=point)
    assert there[:3] == pytest.approx(here[:3], abs=1e-12)
    assert there[3:] == pytest.approx(here[3:] - np.cross(point, here[:3]), abs=1e-11)


@given(sizes, seeds)
def test_order_of_units_does_not_matter(n, seed):
    force, position, rotation = array_of(n, seed)
    order = np.random.default_rng(seed).permutation(n)
    shuffled = wrench(force[:, order], position[:, order], rotation[:, :, order])
    assert shuffled == pytest.approx(wrench(force, position, rotation), abs=1e-12)


def test_far_origin_costs_no_digits():
    force, position, rotation = array_of(64, 3)
    far = np.array([100.0, -50.0, 20.0])
    moved = wrench(force, position + far[:, None], rotation, origin=far)
    assert np.abs(moved - wrench(force, position, rotation)).max() < 1e-11


@given(st.integers(4, 70), seeds)
def test_centroid_lies_within_the_loaded_units(n, seed):
    rng = np.random.default_rng(seed)
    position = rng.normal(size=(3, n))
    load = np.where(rng.random(n) < 0.7, rng.random(n), 0.0)
    load[:4] = 0.5
    centre = centroid(load, position)
    hull = ConvexHull(position[:, load > 0].T)
    assert (hull.equations[:, :3] @ centre + hull.equations[:, 3] < 1e-9).all()


@given(sizes, seeds, st.floats(1e-3, 1e3))
def test_centroid_does_not_know_the_force_scale(n, seed, scale):
    rng = np.random.default_rng(seed)
    load, position = rng.random(n) + 0.01, rng.normal(size=(3, n))
    assert centroid(scale * load, position) == pytest.approx(centroid(load, position), abs=1e-12)


def test_no_load_has_no_centre():
    assert np.isnan(centroid(np.zeros(5), np.ones((3, 5)))).all()
    assert np.isnan(centroid(-np.ones(5), np.ones((3, 5)))).all()
