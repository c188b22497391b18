"""Cross-talk by stencils of random coefficients: sums of terms, whatever their physics."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skin.decode.crosstalk import CrossTalk
from skin.physics.stencil import Stencil
from skin.physics.stray import powers
from tests.fixtures.decode import with_parameters
from tests.skin.decode.test_crosstalk import plane, predict

pytestmark = pytest.mark.usefixtures("few_variants")


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


def crosstalk_of(skin, stencil, **options):
    return CrossTalk(skin, stencil, dtype="float64", **({"idle_mm": 0.0} | options))


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
    crosstalk = crosstalk_of(skin, stencil)
    moved, base = anywhere(skin.n), np.random.default_rng(1).normal(0.0, 9.0, (5, skin.n))
    expected = stencil(moved)
    assert np.abs(expected).max() > 20.0
    np.testing.assert_allclose(predict(crosstalk, moved), expected, atol=1e-10)
    found = predict(crosstalk, moved, base=base)
    np.testing.assert_allclose(found, base[1:4] + expected, atol=1e-10)


def test_films_that_do_not_move_any_more_leave_nothing():
    """A press that wanders over the skin, and comes back."""
    skin = plane(40, 17)
    stencil = made_up(skin, 1)
    crosstalk, row = crosstalk_of(skin, stencil), np.arange(skin.n) // 17
    for first, last in ((0, 3), (38, 40), (9, 12), (0, 0), (20, 22), (0, 40), (30, 31), (10, 11)):
        pressed = (row >= first) & (row < last)
        moved = np.where(pressed, anywhere(skin.n, first), 0.0)
        np.testing.assert_allclose(predict(crosstalk, moved), stencil(moved), atol=1e-10)


def test_neighbours_that_are_not_known_widen_the_residue():
    """By the mean square of what they may add, whatever is base."""
    skin = plane(6, 6)
    stencil = made_up(skin, 2)
    crosstalk, moved = crosstalk_of(skin, stencil), anywhere(skin.n)
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
    crosstalk = crosstalk_of(skin, stencil, idle_mm=0.05)
    given, taken, known = BOUNDS[name]
    moved, stands = np.zeros((2, 3, 9))
    moved[:, 4], stands[:, 4] = given, taken or (0.0, 0.0, 0.0)
    np.testing.assert_allclose(predict(crosstalk, moved), stencil(stands), atol=1e-10)
    assert (crosstalk.residue_ut2 > crosstalk.residue_ut**2 * 1.001).any() == (not known)


def test_contraction_is_the_largest_eigenvalue_over_the_depths():
    """Of how the field changes with a displacement, over how a displacement follows a field."""
    skin = plane(3, 4)
    stencil = made_up(skin, 3, seed=3)
    p, exponents = skin.parameters, powers(3)
    radius = []
    for depth in (0.0, 0.5, 1.0, 1.5, 2.0):
        slope = np.zeros((stencil.kind.max() + 1, 2, 2))
        for axis in range(2):
            for term, (i, j, k) in enumerate(exponents):
                if (i, j) == ((1, 0), (0, 1))[axis]:
                    slope[:, :, axis] += stencil.coefficients[:, :2, term] * depth**k
        steep = p["field_wavenumber_rad_per_mm"] * p["field_amplitude_ut"]
        steep *= np.exp(p["field_growth_per_mm"] * (depth - p["field_reference_mm"]))
        whole = np.zeros((skin.n, 2, skin.n, 2))
        for pair, (unit, film) in enumerate(zip(stencil.unit, stencil.neighbour, strict=True)):
            block = slope[stencil.kind[pair]] * stencil.strength[film] / steep[unit]
            whole[unit, :, film, :] = block
        radius.append(np.abs(np.linalg.eigvals(whole.reshape(2 * skin.n, -1))).max())
    assert crosstalk_of(skin, stencil).contraction == pytest.approx(max(radius), rel=0.03)
    assert min(radius) < 0.9 * max(radius)


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
    crosstalk_of(skin, stencil).predict(moved, np.ones(36, bool), out, base, above)
    np.testing.assert_allclose(
        out[1:4], base[1:4] + stencil.rest_ut * gain + weaker(moved), atol=1e-9
    )
