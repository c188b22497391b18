"""Neighbours' stray fields as polynomials: against magnet theory, on skins of every shape."""

from __future__ import annotations

import dataclasses
import functools
import os

import numpy as np
import pytest

import topology
from skin.errors import SkinError
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from tests.fixtures.cases import long_after_first
from topology.files import read_arrays


@functools.cache
def palm(pitch_mm):
    skin = topology.load("palm")
    return dataclasses.replace(skin, position=skin.position * (pitch_mm / 12.0))


def displaced(n, cycles=20, seed=1):
    """Films moved at random: displacement and depth together, shape (cycles, 3, n)."""
    rng = np.random.default_rng(seed)
    reach, angle = 2.5 * np.sqrt(rng.random((cycles, n))), rng.uniform(-np.pi, np.pi, (cycles, n))
    depth = 2.0 * rng.random((cycles, n))
    return np.stack([reach * np.cos(angle), reach * np.sin(angle), depth], axis=1)


def neighbours_ut(skin, moved, reach_m=0.1):
    """Field of the neighbours alone, from magnet theory."""
    warm = np.broadcast_to(skin.parameters["film_reference_c"], moved[:, 2].shape)
    both, own = HalbachField(skin, reach_m=reach_m), HalbachField(skin, reach_m=0.0)
    given = moved[:, :2], moved[:, 2], warm
    return both(*given) - own(*given)


def change_ut(skin, moved, reach_m=0.1):
    return neighbours_ut(skin, moved, reach_m) - neighbours_ut(skin, 0.0 * moved[:1], reach_m)


def rms(field):
    return np.sqrt(np.mean(np.square(field[:, :2])))


@long_after_first(
    ("pitch_mm", "limits"),
    [
        (12.0, (0.33, 0.11, 0.04, 0.016)),
        (13.5, (0.30, 0.08, 0.03, 0.021)),
        (15.0, (0.28, 0.07, 0.035, 0.033)),
    ],
)
def test_every_degree_leaves_less_of_the_cross_talk(pitch_mm, limits):
    skin = palm(pitch_mm)
    moved = displaced(skin.n)
    true = change_ut(skin, moved)
    for degree, limit in enumerate(limits, start=1):
        left = Stencil.of(skin, degree=degree, reach_m=0.039)(moved) - true
        assert rms(left) < limit * rms(true)


def still(name):
    """A skin whose frames stand where its file puts them: a single one."""
    return dataclasses.replace(topology.load(name), patch_frames=())


@pytest.mark.parametrize("name", ["fingertip", "hand"])
def test_curved_skins_are_predicted_as_flat_ones_are(name):
    skin = still(name)
    moved = displaced(skin.n, cycles=8)
    true = change_ut(skin, moved, reach_m=0.03)
    left = Stencil.of(skin, degree=3, reach_m=0.03)(moved) - true
    assert rms(left) < 0.06 * rms(true)


def test_what_rests_adds_what_the_stencil_says():
    skin = still("hand")
    stencil = Stencil.of(skin)
    at_rest = neighbours_ut(skin, np.zeros((1, 3, skin.n)))[0]
    np.testing.assert_allclose(stencil.rest_ut, at_rest, atol=1e-3)  # a kernel of float32
    assert (stencil(np.zeros((3, skin.n))) == 0.0).all()


@pytest.mark.long
def test_units_of_frames_that_move_against_each_other_are_no_pairs():
    skin = topology.load("hand")
    stencil, rigid = (Stencil.of(one, reach_m=0.03) for one in (skin, still("hand")))
    frame = np.array([skin.patch_frames[p] for p in skin.patch])
    assert (frame[stencil.unit] == frame[stencil.neighbour]).all()
    assert (frame[rigid.unit] != frame[rigid.neighbour]).any()
    # the palm feels itself alone, wherever the fingers are
    palm_only = Stencil.of(topology.load("palm"), reach_m=0.03)
    np.testing.assert_allclose(stencil.rest_ut[:, :64], palm_only.rest_ut, atol=1e-6)


def test_what_is_left_out_is_as_large_as_it_says():
    skin = palm(12.0)
    moved = displaced(skin.n)
    spreads = []
    for reach_m in (0.013, 0.018, 0.03):
        beyond = change_ut(skin, moved) - change_ut(skin, moved, reach_m)
        stencil = Stencil.of(skin, degree=1, reach_m=reach_m)
        spread = np.sqrt(np.mean(beyond**2, axis=(0, 1)))
        np.testing.assert_allclose(stencil.left_out_rms_ut, spread, rtol=0.6, atol=0.1)
        assert np.mean(stencil.left_out_rms_ut / spread) == pytest.approx(1.0, abs=0.15)
        spreads.append(stencil.left_out_rms_ut.max())
    assert spreads == sorted(spreads, reverse=True)
    assert not Stencil.of(skin, degree=1, reach_m=0.1).left_out_rms_ut.any()


def test_an_irregular_skin_pairs_each_unit_with_its_own_neighbours():
    skin = palm(12.0)
    keep = np.array([0, 1, 9, 27, 28, 63])
    rng = np.random.default_rng(0)
    some = dataclasses.replace(
        skin,
        position=skin.position[:, keep] + 3e-4 * rng.uniform(-1.0, 1.0, (3, keep.size)),
        rotation=skin.rotation[:, :, keep],
        unit_names=tuple(skin.unit_names[k] for k in keep),
        patch=skin.patch[keep],
        parameters={name: value[..., keep] for name, value in skin.parameters.items()},
    )
    stencil = Stencil.of(some, degree=3, reach_m=0.03)
    rows = [
        stencil.neighbour[stencil.start[i] : stencil.start[i + 1]].tolist()
        for i in range(keep.size)
    ]
    assert rows == [[1, 2], [0, 2], [0, 1], [4], [3], []]
    moved = displaced(keep.size)
    left = stencil(moved) - change_ut(some, moved, reach_m=0.03)
    assert rms(left) < 0.06 * rms(change_ut(some, moved, reach_m=0.03))
    assert (stencil(moved)[..., 5] == 0.0).all()


def test_a_neighbour_counts_by_its_own_strength():
    skin = palm(12.0)
    stronger = skin.parameters["field_amplitude_ut"].copy()
    stronger[27] *= 1.5
    other = dataclasses.replace(
        skin, parameters={**skin.parameters, "field_amplitude_ut": stronger}
    )
    one, two = Stencil.of(skin, degree=2), Stencil.of(other, degree=2)
    assert (one.coefficients == two.coefficients).all()
    moved = displaced(skin.n, cycles=1)[0]
    alone = np.zeros_like(moved)
    alone[:, 27] = moved[:, 27]
    np.testing.assert_allclose(two(moved) - one(moved), 0.5 * one(alone), atol=1e-9)


def test_a_stencil_that_was_saved_is_the_same_when_it_is_loaded(tmp_path):
    skin = topology.load("fingertip")
    stencil = Stencil.of(skin, degree=2)
    stencil.save(tmp_path / "tip.npz")
    again = Stencil.load(tmp_path / "tip.npz", skin)
    for field in dataclasses.fields(stencil):
        one, two = getattr(stencil, field.name), getattr(again, field.name)
        np.testing.assert_array_equal(one, two)
        assert np.asarray(one).dtype == np.asarray(two).dtype
    assert [p.name for p in tmp_path.iterdir()] == ["tip.npz"]


def test_a_file_that_is_no_stencil_of_the_skin_is_refused(tmp_path):
    skin, other = topology.load("fingertip"), palm(12.0)
    path = tmp_path / "tip.npz"
    Stencil.of(skin, degree=1).save(path)
    with pytest.raises(SkinError, match="must be the stencil of 64 units, as palm; got 12"):
        Stencil.load(path, other)
    moved = dataclasses.replace(skin, position=1.1 * skin.position)
    with pytest.raises(SkinError, match=r"mm apart in it; got a skin that differs by 2\.\d mm"):
        Stencil.load(path, moved)
    with pytest.raises(SkinError, match=r"none\.npz: must be a stencil that was saved; got"):
        Stencil.load(tmp_path / "none.npz", skin)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(SkinError, match=r"tip\.npz: must be a stencil that was saved; got"):
        Stencil.load(path, skin)
    np.savez(path, format=1)
    with pytest.raises(SkinError, match=r"tip\.npz: must be a stencil that was saved; got"):
        Stencil.load(path, skin)
    np.savez(path, format=4)
    with pytest.raises(SkinError, match=r"tip\.npz: format: must be 1; got 4"):
        Stencil.load(path, skin)


@long_after_first(
    ("name", "change"),
    [
        ("neighbour", lambda a: a + 1000),
        ("neighbour", lambda a: a.astype(float)),
        ("kind", lambda a: a - 1),
        ("start", lambda a: a[::-1]),
        ("coefficients", lambda a: a[:, :, :2]),
        ("coefficients", lambda a: a * np.nan),
        ("strength", lambda a: a[:-1]),
        ("start", lambda a: a[0]),
        ("degree", lambda a: a + 7),
        ("degree", lambda a: "four"),
    ],
)
def test_a_saved_stencil_that_was_changed_is_refused(name, change, tmp_path):
    skin = topology.load("strip")
    path = tmp_path / "strip.npz"
    Stencil.of(skin, degree=1).save(path)
    saved = read_arrays(path)
    np.savez(path, **{**saved, name: change(saved[name])})
    with pytest.raises(SkinError, match=r"strip.npz: must be a stencil that was saved; got"):
        Stencil.load(path, skin)


def test_a_stencil_is_a_regular_file(tmp_path):
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(SkinError, match="a FIFO, and no regular file"):
        Stencil.load(tmp_path / "pipe.npz", topology.load("strip"))
