"""Predicted stray fields: sums of the terms of any stencil, and against magnet theory."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from msgspec import structs

import topology
from skin.calibrate.film import angle_powers
from skin.decode.crosstalk import CrossTalk
from skin.decode.resting import stray_ut2
from skin.errors import SkinError
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from skin.physics.stray import powers
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import strokes, with_parameters
from tests.skin.physics.test_stencil import change_ut, displaced, neighbours_ut
from topology.pose import from_rpy


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


# -- stencils of random coefficients ---------------------------------------------------------------


def exact(skin, stencil):
    """In which every film counts that has moved at all."""
    return CrossTalk(skin, stencil, dtype="float64", idle_mm=0.0)


def made_up(skin, degree, reach_mm=13.0, *, own=False, seed=0):
    """A stencil of all pairs within reach, those of one offset alike, or each its `own`, or those
    its own whose film stands on one side (`own` "half")."""
    rng, place = np.random.default_rng(seed), 1e3 * skin.position
    apart = np.linalg.norm(place[:, :, None] - place[:, None], axis=0)
    unit, film = np.nonzero((apart < reach_mm) & (apart > 0.0))
    step = np.rint(place[:, film] - place[:, unit]).astype(int)
    _, kind = np.unique(step, axis=1, return_inverse=True)
    apart_kind = np.arange(kind.size) + (0 if own is True else kind.max(initial=-1) + 1)
    alone = step[0] > 0 if own == "half" else np.full(kind.size, own)
    _, kind = np.unique(np.where(alone, apart_kind, kind.ravel()), return_inverse=True)
    exponents = powers(degree)
    shape = (kind.max(initial=-1) + 1, 3, len(exponents))
    size = 2e-3 * 0.5 ** exponents.sum(axis=1) * rng.choice([0.03, 0.3, 1.0], shape)
    return Stencil(
        start=np.append(0, np.cumsum(np.bincount(unit, minlength=skin.n))).astype(np.int32),
        neighbour=film.astype(np.int32), kind=kind.astype(np.int32),
        apart_m=1e-3 * apart[unit, film], coefficients=size * rng.standard_normal(shape),
        sigma_ut=rng.uniform(1e-4, 5e-4, shape[:2]),
        strength=11073.0 * rng.uniform(0.9, 1.1, skin.n), rest_ut=rng.normal(0, 99.0, (3, skin.n)),
        degree=degree, reach_m=1e-3 * reach_mm, depth_max_mm=2.0, displacement_max_mm=2.5,
        left_out_rms_ut=rng.uniform(1.0, 3.0, skin.n), rest_sigma_ut=np.zeros((3, skin.n)),
    )  # fmt: skip


def anywhere(n, seed=0, rest=0.2):
    """Films displaced and pressed at random, and some at rest, of which the last is none."""
    rng = np.random.default_rng(seed)
    moved = rng.uniform([[-2.0], [-2.0], [0.0]], [[2.0], [2.0], [2.0]], (3, n))
    at_rest = rng.random(n) < rest
    at_rest[-1] = False
    return np.where(at_rest, 0.0, moved)


LATTICES = {
    "rows of a block and a half": (plane(17, 17), 2, 13.0),
    "diagonals": (plane(8, 5), 3, 18.0),
    "two rows away": (plane(7, 6), 1, 28.0),
    "slanted": (plane(9, 7, slant=0.5), 2, 13.0),
    "all degrees": (plane(4, 8), 4, 13.0),
}


@pytest.mark.parametrize("own", [False, True, "half"])
@pytest.mark.parametrize("name", LATTICES)
def test_sum_of_all_terms_is_that_of_the_stencil(name, own):
    skin, degree, reach_mm = LATTICES[name]
    stencil = made_up(skin, degree, reach_mm, own=own)
    crosstalk = exact(skin, stencil)
    moved, base = anywhere(skin.n), np.random.default_rng(1).normal(0.0, 9.0, (5, skin.n))
    expected = stencil(moved)
    assert np.abs(expected).max() > 20.0
    np.testing.assert_allclose(predict(crosstalk, moved), expected, atol=1e-10)
    found = predict(crosstalk, moved, base=base)
    np.testing.assert_allclose(found, base[1:4] + expected, atol=1e-10)


def test_neighbours_that_are_not_known_widen_the_residue():
    """By the mean square of what they may add, whatever is base."""
    skin = plane(6, 6)
    stencil = made_up(skin, 2)
    crosstalk, moved = exact(skin, stencil), anywhere(skin.n)
    moved[2] += 0.1
    usable, base = np.ones(skin.n, bool), np.random.default_rng(2).uniform(0, 9, (5, skin.n))
    out = np.empty((5, skin.n))
    for gone in ([7], [7, 8, 30], [8], []):
        usable[:] = True
        usable[gone] = False
        crosstalk.predict(moved, usable, out, base)
        c = stencil.coefficients[stencil.kind]
        square = np.einsum("map,pq,maq->m", c, stencil.gram, c) / 3.0
        square *= stencil.strength[stencil.neighbour] ** 2 * ~usable[stencil.neighbour]
        added = np.bincount(stencil.unit, square, minlength=skin.n)
        expected = crosstalk.residue_ut**2 + added
        np.testing.assert_allclose(crosstalk.residue_ut2, expected, rtol=1e-9)
        np.testing.assert_allclose(out[4], base[4] + expected, rtol=1e-9)
        np.testing.assert_array_equal(out[0], base[0])


BOUNDS = {
    # where it is; whether it counts as displaced, and where it is taken to be; whether it is known
    "pressed": ((0.0, 0.0, 0.06), (0.0, 0.0, 0.06), True),
    "hardly pressed": ((0.1, 0.1, 0.04), None, True),
    "pulled": ((0.0, 0.0, -0.16), (0.0, 0.0, -0.16), True),
    "hardly pulled": ((0.0, 0.0, -0.14), None, True),
    "displaced": ((0.36, -0.36, 0.0), (0.36, -0.36, 0.0), True),
    "hardly displaced": ((0.34, -0.36, 0.0), None, True),
    "at the end": ((2.99, -2.99, 2.49), (2.99, -2.99, 2.49), True),
    "beyond in x": ((-3.02, 1.0, 1.0), (-3.0, 1.0, 1.0), False),
    "beyond in y": ((1.0, 3.02, 1.0), (1.0, 3.0, 1.0), False),
    "too deep": ((1.0, 1.0, 2.52), (1.0, 1.0, 2.5), False),
    "far off its chip": ((1.0, 1.0, -0.32), (1.0, 1.0, -0.3), False),
    "just off its chip": ((1.0, 1.0, -0.29), (1.0, 1.0, -0.29), True),
    "not looked at": ((np.nan, 0.2, 1.0), (0.0, 0.0, 1.0), True),
    "not looked at either": ((0.2, np.nan, 1.0), (0.0, 0.0, 1.0), True),
    "nowhere": ((1.0, 1.0, np.nan), None, False),
    "not finite": ((np.inf, 1.0, 1.0), None, False),
}


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("name", BOUNDS)
def test_a_film_counts_from_its_bounds_on_and_stands_still_beyond_its_range(name):
    """Pressed by 0.05 mm, pulled by 0.15, displaced by 0.5; the stencil's range and 0.5 mm, 0.3 mm
    off the chip."""
    skin = plane(3, 3)
    stencil = made_up(skin, 2)
    crosstalk = CrossTalk(skin, stencil, dtype="float64", idle_mm=0.05)
    given, taken, known = BOUNDS[name]
    moved, stands = np.zeros((2, 3, 9))
    moved[:, 4], stands[:, 4] = given, taken or (0.0, 0.0, 0.0)
    np.testing.assert_allclose(predict(crosstalk, moved), stencil(stands), atol=1e-10)
    assert (crosstalk.residue_ut2 > crosstalk.residue_ut**2 * 1.001).any() == (not known)


@pytest.mark.parametrize("own", [False, True])
def test_warm_films_are_weaker_displaced_and_at_rest(own):
    """By their own temperatures; the rest of the neighbours by that of the unit."""
    skin = with_parameters(plane(6, 6), film_drift_per_k=np.linspace(-2e-3, -1e-3, 36))
    stencil, moved = made_up(skin, 2, own=own), anywhere(36)
    above = np.random.default_rng(2).uniform(-10.0, 55.0, 36)
    above[[4, 9]] = np.nan  # not heard of
    gain = skin.parameters["film_drift_per_k"] * np.where(np.isnan(above), 0.0, above)
    weaker = dataclasses.replace(stencil, strength=stencil.strength * (1.0 + gain))
    out, base = np.empty((5, 36)), np.random.default_rng(3).normal(0.0, 9.0, (5, 36))
    exact(skin, stencil).predict(moved, np.ones(36, bool), out, base, above)
    np.testing.assert_allclose(
        out[1:4], base[1:4] + stencil.rest_ut * gain + weaker(moved), atol=1e-9
    )


# -- units off their places ------------------------------------------------------------------------

PLACED = {"place": (0.3, 0.0), "tilt": (0.0, 0.02)}


def placed(place_mm, tilt_rad):
    return with_parameters(
        plane(4, 4), placement_sigma_mm=place_mm, placement_sigma_rad=tilt_rad
    )  # fmt: skip


def strayed(skin, moved, depth, reach_m):
    """What neighbours add at every chip."""
    warm = skin.parameters["film_reference_c"]
    both, own = (HalbachField(skin, reach_m=r)(moved, depth, warm) for r in (reach_m, 0.0))
    return both - own


@long_after_first("tared", [False, True])
@long_after_first("kind", PLACED)
def test_units_off_their_places_add_what_the_variance_says(kind, tared):
    """Root mean square over many skins; single units differ by their neighbours' directions."""
    place_mm, tilt_rad = PLACED[kind]
    drawn = placed(place_mm, tilt_rad)
    stencil, rng, square = Stencil.of(drawn), np.random.default_rng(4), []
    for _ in range(30):
        reach = stencil.displacement_max_mm * np.sqrt(rng.random(drawn.n))
        around = rng.uniform(-np.pi, np.pi, drawn.n)
        moved = reach * np.stack([np.cos(around), np.sin(around)])
        depth = stencil.depth_max_mm * rng.random(drawn.n)
        place = drawn.position + 1e-3 * place_mm * rng.standard_normal(drawn.position.shape)
        tilts = [from_rpy(x, y, 0.0) for x, y in tilt_rad * rng.standard_normal((drawn.n, 2))]
        turned = np.einsum("abn,nbc->acn", drawn.rotation, tilts)
        real = dataclasses.replace(drawn, position=place, rotation=turned)
        off = strayed(real, moved, depth, stencil.reach_m)
        off -= strayed(drawn, moved, depth, stencil.reach_m)
        if tared:
            off -= strayed(real, 0.0 * moved, 0.0 * depth, stencil.reach_m)
            off += strayed(drawn, 0.0 * moved, 0.0 * depth, stencil.reach_m)
        square.append(np.mean(off[:2] ** 2, axis=0))
    ratio = np.sqrt(np.mean(square, axis=0) / stray_ut2(drawn, stencil)[0][int(tared)])
    assert 0.5 < np.mean(ratio) < 1.2
    assert ((ratio > 0.35) & (ratio < 1.5)).all()
