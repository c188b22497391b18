"""Predicted stray fields: against the stencil and magnet theory."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from msgspec import structs

import topology
from skin.calibrate.film import angle_powers
from skin.decode.crosstalk import CrossTalk
from skin.errors import SkinError
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import strokes
from tests.skin.physics.test_stencil import change_ut, displaced, neighbours_ut, palm

pytestmark = pytest.mark.usefixtures("few_variants")

SKINS = ("palm", "hand", "fingertip", "strip")


@functools.cache
def stencil_of(name):
    return Stencil.of(topology.load(name).exact())


@functools.cache
def crosstalk_of(name, dtype="float64", idle_mm=0.0):
    skin = topology.load(name).exact()
    return CrossTalk(skin, stencil_of(name), dtype=dtype, idle_mm=idle_mm)


def predict(crosstalk, moved, usable=None, base=None):
    real = crosstalk.residue_ut2.dtype
    usable = np.ones(moved.shape[-1], bool) if usable is None else usable
    if moved.ndim == 3:
        return np.array([predict(crosstalk, one, usable, base) for one in moved])
    out = np.full((5, moved.shape[1]), np.nan, real)
    assert crosstalk.predict(np.ascontiguousarray(moved, real), usable, out, base) is out
    return out[1:4]


def part_of(skin, keep):
    """The same skin with some units, in any order, and not at all with the others."""
    return dataclasses.replace(
        skin, position=skin.position[:, keep], rotation=skin.rotation[:, :, keep],
        patch=skin.patch[keep], tared=skin.tared[keep],
        unit_names=tuple(skin.unit_names[k] for k in keep),
        parameters={name: value[..., keep] for name, value in skin.parameters.items()},
    )  # fmt: skip


@functools.cache
def plane(rows, columns, pitch_mm=12.0, slant=0.0):
    """A flat lattice; `slant` 0.5: hexagonal."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    across = np.sqrt(1.0 - slant**2)
    place = 1e-3 * pitch_mm * np.stack([column + slant * (row % 2), across * row, 0.0 * row])
    skin = part_of(topology.load("palm").exact(), np.zeros(rows * columns, int))
    return dataclasses.replace(skin, position=place)


# -- against the stencil ---------------------------------------------------------------------------
@long_after_first("name", SKINS)
def test_the_prediction_is_that_of_the_stencil(name):
    skin, stencil = topology.load(name).exact(), stencil_of(name)
    moved = displaced(skin.n, cycles=1)[0]
    expected = stencil(moved)
    for dtype, share in (("float64", 1e-12), ("float32", 2e-6)):
        found = predict(crosstalk_of(name, dtype), moved)
        np.testing.assert_allclose(found, expected, rtol=0, atol=share * np.abs(expected).max())


# -- against magnet theory -------------------------------------------------------------------------
@long_after_first("name", ["palm", "hand", "fingertip"])
def test_what_is_missed_is_what_the_residue_says(name):
    skin = topology.load(name).exact()
    moved = displaced(skin.n, cycles=40, seed=3)
    frame = np.array([skin.patch_frames[p] for p in skin.patch])
    true = np.zeros(moved.shape)
    for one in np.unique(frame):
        here = np.flatnonzero(frame == one)
        true[..., here] = change_ut(part_of(skin, here), moved[..., here])
    crosstalk = crosstalk_of(name)
    off = predict(crosstalk, moved) - true
    missed = np.sqrt(np.mean(off**2, axis=(0, 1)))
    assert np.median(missed / crosstalk.residue_ut) == pytest.approx(1.0, abs=0.25)
    assert (missed < 2.0 * crosstalk.residue_ut).all()


# -- laws ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("skin", [plane(1, 1), plane(3, 3, 60.0), plane(6, 1)])
def test_units_alone_far_apart_or_in_one_row_are_skins_too(skin):
    crosstalk = CrossTalk(skin, dtype="float64")
    moved = displaced(skin.n, cycles=1)[0]
    np.testing.assert_allclose(predict(crosstalk, moved), crosstalk.stencil(moved), atol=1e-9)
    assert (crosstalk.contraction > 0.0) == (crosstalk.stencil.kind.size > 0)


# -- units that are not known, idle, or beyond the range -------------------------------------------
@pytest.mark.parametrize("gone", ["status", "NaN", "infinity"])
def test_a_unit_that_is_not_known_adds_nothing_and_widens_what_its_neighbours_know(gone):
    crosstalk = crosstalk_of("palm")
    moved = displaced(64, cycles=1)[0]
    silent = moved.copy()
    silent[:, 27] = 0.0
    usable = np.ones(64, bool)
    broken = moved.copy()
    if gone == "status":
        usable[27] = False
    else:
        broken[2, 27] = np.nan if gone == "NaN" else np.inf
    expected = predict(crosstalk, silent)
    before = crosstalk.residue_ut2.copy()
    np.testing.assert_allclose(before, crosstalk.residue_ut**2)
    np.testing.assert_array_equal(predict(crosstalk, broken, usable), expected)
    added = crosstalk.residue_ut2 - before
    felt = np.zeros(64, bool)
    felt[crosstalk.stencil.unit[crosstalk.stencil.neighbour == 27]] = True
    assert (added[felt] > 0.0).all()
    assert (added[~felt] == 0.0).all()
    # as much as the unit would have added, had it moved at random
    alone = np.zeros((400, 3, 64))
    alone[:, :, 27] = displaced(1, cycles=400)[..., 0]
    added_true = np.mean(np.square(change_ut(palm(12.0), alone)), axis=(0, 1))
    np.testing.assert_allclose(added[felt], added_true[felt], rtol=0.2)
    predict(crosstalk, moved)
    np.testing.assert_array_equal(crosstalk.residue_ut2, before)


def test_sensors_of_another_kind_have_no_film():
    palm = topology.load("palm").exact()
    layout = np.zeros(len(palm.frames), np.int32)
    layout[palm.frames.units[:, 0] >= 32] = 1
    skin = dataclasses.replace(
        palm, frames=dataclasses.replace(palm.frames, layout=layout),
        layouts=(palm.layouts[0], structs.replace(palm.layouts[0], counts_only=True)),
    )  # fmt: skip
    foreign = skin.counts_only
    assert 0 < foreign.sum() < 64
    crosstalk = CrossTalk(skin, dtype="float64")
    moved = displaced(64, cycles=1)[0]
    own = np.where(foreign, 0.0, moved)
    np.testing.assert_allclose(predict(crosstalk, moved), stencil_of("palm")(own), atol=1e-9)
    alone = Stencil.of(part_of(palm, np.flatnonzero(~foreign)))
    np.testing.assert_allclose(crosstalk.stencil.rest_ut[:, ~foreign], alone.rest_ut, atol=1e-9)
    known = crosstalk.residue_ut2.copy()
    predict(crosstalk, moved, ~foreign)
    np.testing.assert_array_equal(crosstalk.residue_ut2, known)


def test_a_unit_that_was_not_looked_at_counts_as_not_displaced():
    crosstalk = crosstalk_of("palm")
    moved = displaced(64, cycles=1)[0]
    straight = moved.copy()
    straight[:2, 27] = 0.0
    moved[:2, 27] = np.nan
    np.testing.assert_array_equal(predict(crosstalk, moved), predict(crosstalk, straight))
    np.testing.assert_allclose(crosstalk.residue_ut2, crosstalk.residue_ut**2)


def test_a_film_beyond_the_range_stands_where_the_polynomials_end_and_is_not_known():
    crosstalk = crosstalk_of("palm")
    felt = crosstalk.stencil.unit[crosstalk.stencil.neighbour == 27]
    inside, deeper, aside = np.zeros((3, 3, 64))
    inside[:, 27], deeper[:, 27], aside[:, 27] = (3.0, -3.0, 2.5), (3.0, -3.0, 40.0), (8, -9.0, 2.5)
    expected = predict(crosstalk, inside)
    np.testing.assert_allclose(crosstalk.residue_ut2, crosstalk.residue_ut**2)
    for beyond in (deeper, aside):
        np.testing.assert_array_equal(predict(crosstalk, beyond), expected)
        assert (crosstalk.residue_ut2[felt] > crosstalk.residue_ut[felt] ** 2).all()


# -- sweeps ----------------------------------------------------------------------------------------
@functools.cache
def inverse():
    """The field-angle inversion of a perfect unit, fitted to exact strokes."""
    depth, reach, _ = strokes(np.linspace(0.0, 2.2, 12), np.linspace(0.0, 3.0, 16))
    alone = plane(1, 1)
    moved = np.stack([reach, 0.0 * reach, depth], axis=1)[:, :, np.newaxis]
    field = own_ut(alone, moved)[..., 0]
    table = np.linalg.lstsq(
        angle_powers(np.arctan2(np.hypot(field[:, 0], field[:, 1]), field[:, 2]), depth), reach
    )[0]
    return lambda angle, depth: (angle_powers(angle.ravel(), depth.ravel()) @ table).reshape(
        angle.shape
    )


def own_ut(skin, moved):
    warm = np.broadcast_to(skin.parameters["film_reference_c"], moved[:, 2].shape)
    return HalbachField(skin, reach_m=0.0)(moved[:, :2], moved[:, 2], warm)


def decoded(field, depth):
    """Displacement (t, 3, n) from fields, by the field's angle."""
    lateral = np.hypot(field[:, 0], field[:, 1])
    reach = inverse()(np.arctan2(lateral, field[:, 2]), depth)
    share = reach / np.maximum(lateral, 1e-9)
    return np.stack([field[:, 0] * share, field[:, 1] * share, depth], axis=1)


def swept(skin, crosstalk, moved, sweeps):
    """Error of the tangential displacement, µm rms, after each sweep; cold start first."""
    true = own_ut(skin, moved) + neighbours_ut(skin, moved)
    found = decoded(true - crosstalk.stencil.rest_ut, moved[:, 2])
    errors = []
    for sweep in range(sweeps + 1):
        off = (found - moved)[:, :2]
        errors.append(1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1))))
        if sweep < sweeps:
            stray = predict(crosstalk, found)
            found = decoded(true - crosstalk.stencil.rest_ut - stray, moved[:, 2])
    return errors


@long_after_first(
    ("pitch_mm", "raw", "one", "two"),
    [(12.0, 100.0, 15.0, 7.0), (13.5, 60.0, 9.0, 6.0), (15.0, 35.0, 8.0, 4.0)],
)
def test_one_sweep_leaves_15_um_and_two_leave_7_where_all_neighbours_press(pitch_mm, raw, one, two):
    skin = plane(6, 6, pitch_mm)
    moved = displaced(skin.n, cycles=20, seed=7)
    stencil = Stencil.of(skin)
    errors = swept(skin, CrossTalk(skin, stencil, dtype="float64"), moved, 2)
    assert errors[0] > raw
    assert errors[1] < one
    assert errors[2] < two


def test_a_sweep_takes_away_what_the_contraction_says():
    skin = plane(6, 6)
    crosstalk = CrossTalk(skin, dtype="float64", idle_mm=0.0)
    for depth in (0.0, 2.0):
        moved = displaced(skin.n, cycles=10) * [[0.02], [0.02], [0.0]]
        moved[:, 2] = depth
        raw, *left = swept(skin, crosstalk, moved, 2)
        errors = np.array([raw, *left]) - left[-1]
        assert errors[1] < 1.2 * crosstalk.contraction * errors[0]


def test_units_too_near_for_their_films_are_refused():
    skin = plane(4, 4, 12.0)
    weak = dict(skin.parameters)
    weak["field_wavenumber_rad_per_mm"] = 0.1 * weak["field_wavenumber_rad_per_mm"]
    with pytest.raises(
        SkinError, match=r"palm: cross-talk: must grow less with every sweep; got 1"
    ):
        CrossTalk(dataclasses.replace(skin, parameters=weak))
    with pytest.raises(SkinError, match="stencil: must be of 16 units, as palm; got 64"):
        CrossTalk(skin, stencil_of("palm"))


def test_arrays_that_the_kernel_would_leave_are_refused():
    crosstalk, moved = crosstalk_of("palm"), np.zeros((3, 64))
    for name, out, base in (
        ("out", np.zeros((3, 64)), None), ("out", np.zeros((5, 64), np.float32), None),
        ("out", np.zeros((64, 5)).T, None), ("base", np.zeros((5, 64)), np.zeros((4, 64))),
    ):  # fmt: skip
        with pytest.raises(
            SkinError, match=rf"^{name}: must be contiguous float64 of shape \(5, 64"
        ):
            crosstalk.predict(moved, np.ones(64, bool), out, base)
