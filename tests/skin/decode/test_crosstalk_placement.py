"""What errors of place and tilt add to the variance of the field, against fields of such units."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skin.decode.crosstalk import CrossTalk
from skin.decode.resting import stray_ut2
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import with_parameters
from tests.skin.decode.test_crosstalk import plane
from topology.pose import from_rpy

pytestmark = pytest.mark.usefixtures("few_variants")

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


def test_cross_talk_of_the_drawing_holds_it_and_that_of_a_stencil_that_is_given_does_not():
    """A stencil that was measured on the skin knows the places."""
    skin = placed(0.2, 0.01)
    skin = dataclasses.replace(skin, tared=np.zeros(skin.n, bool))
    drawn, given = (
        CrossTalk(skin, dtype="float64"),
        CrossTalk(skin, dataclasses.replace(Stencil.of(skin), drawn=False), dtype="float64"),
    )
    of_drawing = stray_ut2(skin, drawn.stencil)[0] - stray_ut2(skin, given.stencil)[0]
    added = drawn.residue_ut2 - given.residue_ut2
    np.testing.assert_allclose(added, of_drawing[0], rtol=1e-9)
    np.testing.assert_array_equal(drawn.residue_ut, given.residue_ut)
    tared = dataclasses.replace(skin, tared=np.ones(skin.n, bool))
    for each in (drawn, given):
        each.retare(tared)
        fresh = CrossTalk(tared, each.stencil, dtype="float64")
        np.testing.assert_allclose(each.residue_ut2, fresh.residue_ut2, rtol=1e-9)
    left = drawn.residue_ut2 - given.residue_ut2
    np.testing.assert_allclose(left, of_drawing[1], rtol=1e-9)
