"""Films beside their chips' axes: what is decoded is how far the face has moved, not the film."""

from __future__ import annotations

import numpy as np
import pytest

from skin.decode.decoder import Decoder
from tests.fixtures.decode import (
    calibrated,
    posed,
    row_of,
    sensible_counts,
    stiffening,
    with_parameters,
)
from tests.naive.decode import naive_decode

pytestmark = pytest.mark.usefixtures("few_variants")

UNITS = 21
ESTIMATORS = ("sine", "field-angle")


def off_centre(skin, seed=2, most_mm=0.15):
    rng = np.random.default_rng(seed)
    place = rng.uniform(-most_mm, most_mm, (2, skin.n))
    return with_parameters(skin, film_x_mm=place[0], film_y_mm=place[1])


def everything(skin, estimator):
    return Decoder(
        skin, estimator=estimator, dtype="float64", consistency=False, sweeps=0, ambient=False
    )


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_an_off_centre_film_is_decoded_as_the_model_says(estimator):
    skin = off_centre(calibrated(row_of(UNITS), seed=1, turn_rad=0.05))
    counts = sensible_counts(skin, 30, most=0.9)
    found = everything(skin, estimator)(counts)
    naive = naive_decode(skin, counts, estimator=estimator)
    for name in ("force", "displacement_mm", "tangential"):
        np.testing.assert_allclose(getattr(found, name), naive[name], rtol=1e-6, atol=1e-8)
    turned = np.angle(np.exp(1j * (found.theta - naive["theta"])))
    assert np.abs(turned).max() < 1e-6
    np.testing.assert_array_equal(found.status, naive["status"])


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_the_tangential_force_follows_the_field_as_by_differences(estimator):
    skin = off_centre(stiffening(calibrated(row_of(UNITS), seed=1)))
    counts, step = sensible_counts(skin, 1, most=0.9)[0], 1e-3
    expected = np.empty((2, 3, UNITS))
    for axis in range(3):
        by = np.zeros((4, UNITS))
        by[1 + axis] = step
        more, less = (everything(skin, estimator)(counts, background=way * by) for way in (-1, 1))
        expected[:, axis] = (more.force[:2] - less.force[:2]) / (2.0 * step)
    decoder = everything(skin, estimator)
    decoder(counts)
    found = decoder.force_per_ut.reshape(2, 3, UNITS)
    turn = np.array([[skin.parameters[f"field_{row}{column}"] for column in "xy"] for row in "xy"])
    np.testing.assert_allclose(
        np.einsum("abn,bcn->acn", found[:, :2], turn), expected[:, :2], rtol=1e-4, atol=1e-9
    )
    np.testing.assert_allclose(found[:, 2], expected[:, 2], rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_a_film_without_displacement_reads_none(estimator):
    """The field of a displaced film, on a unit that knows that its film sits there: no shear."""
    plain = row_of(4)
    place = np.array([[0.1, -0.08, 0.0, 0.12], [0.0, 0.05, -0.1, 0.09]])
    poses = np.full(4, 1.0), np.hypot(*place), np.arctan2(place[1], place[0])
    _, counts = posed(plain, *poses, noise=False)
    skin = with_parameters(plain, film_x_mm=place[0], film_y_mm=place[1])
    read = everything(skin, estimator)(counts)
    own = read.displacement_mm[np.arange(4), :2, np.arange(4)]
    assert np.abs(own).max() < 0.004
    assert np.abs(read.force[np.arange(4), :2, np.arange(4)]).max() < 0.002
