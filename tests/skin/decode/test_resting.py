"""What a tare says of resting neighbours along z, by a plant of its own: sums of dipoles.

Of each unit the constants are known, and a film's law that is fitted to its field from rest on;
nothing of decoder or simulator makes the counts.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skin.calibrate.files import with_fits
from skin.calibrate.film import fit_crest, fit_film, map_field, misfit_sigma
from skin.calibrate.fit import as_fit, rms
from skin.calibrate.tare import tare
from skin.decode.decoder import Decoder
from skin.decode.resting import axial_at_rest, share_shown
from skin.physics.stencil import Stencil
from tests.fixtures.bench import dealt
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import strokes, with_parameters
from tests.fixtures.film import FILMS
from tests.fixtures.plant import BX, BZ, Plant, Touch, Units
from tests.fixtures.plant_skin import Skin, shape_of, square
from topology import Topology

UNITS = 4
SIGMA_OF_LAWS = ("temperature_sigma_c", "frequency_sigma_hz", "depth_sigma_mm",
                 "normal_sigma_relative", "normal_sigma_n", "shear_sigma_relative",
                 "shear_sigma_n")  # fmt: skip
NOISE_UT = 105.0 / 4.0
"""Of a mean of 16 readings."""
EARTH_UT = np.array([[0.0, 30.0, 40.0]])


@pytest.fixture(scope="module", params=FILMS)
def skin(request) -> Skin:
    """A palm of films of one make."""
    nominal, which = shape_of("palm"), np.arange(64) % UNITS
    units = Units.drawn(square(UNITS), seed=0)
    found = known_films(Plant(square(UNITS), units, FILMS[request.param], alone=True))
    known = dataclasses.replace(dealt(nominal, found, which), calibrated=np.ones(64, bool))
    return Skin(Plant(nominal, units.dealt(which), FILMS[request.param]), known)


def known_films(plant: Plant) -> Topology:
    """Units with their constants, and with the laws of their films.

    A bench takes the offset of Bz for a part of the film's own field, and extrapolates a film's law
    to rest, where a face that nothing touches does not move; both are no matter of the tare.
    """
    poses = depth, reach, around = strokes(
        np.linspace(0.0, 2.0, 7), np.linspace(0.2, 3.0, 10), np.linspace(-np.pi, np.pi, 16, False)
    )
    place, wide = reach * np.stack([np.cos(around), np.sin(around)]), np.ones(plant.n)
    touch = Touch(depth[:, np.newaxis] * wide, place.T[:, :, np.newaxis] * wide)
    field = plant.values(touch)[:, BX : BZ + 1]
    offset = dict(zip((f"hall_offset_{a}_ut" for a in "xyz"), plant.offset_ut, strict=True))
    exact = plant.true | offset | dict.fromkeys(SIGMA_OF_LAWS, 0.0)
    known, found = with_parameters(plant.topology, **exact), {}
    for unit, name in enumerate(known.unit_names):
        film = fit_film(
            field[..., unit], *poses, offset_ut=tuple(plant.offset_ut[:, unit]), sigma_ut=NOISE_UT
        )
        centre = np.array([[film.fit["film_x_mm"]], [film.fit["film_y_mm"]]])
        lateral = np.hypot(*map_field(field[..., unit], film.fit))
        crest = fit_crest(lateral, depth, np.hypot(*(place + centre)), 2.0, NOISE_UT)
        amplitude_sigma = misfit_sigma(crest, NOISE_UT) / rms(lateral)
        sigma = {"field_angle_sigma_mm": film.sigma_mm, "field_sigma_ut": NOISE_UT,
                 "field_amplitude_sigma_relative": amplitude_sigma}  # fmt: skip
        found[name] = film.fit, crest, as_fit({k: (v, np.nan) for k, v in sigma.items()})
    return with_fits(known, found)


def alone(plant: Plant) -> Plant:
    """The same units, none of which feels another's film."""
    units = Units(plant.true, plant.strength, plant.offset_ut)
    return Plant(plant.topology, units, plant.film, alone=True)


def added(plant: Plant, touch: Touch) -> np.ndarray:
    """What neighbours add along z, µT, shape (t, n)."""
    return (plant.film_field(touch) - alone(plant).film_field(touch))[:, 2]


def untouched(skin: Skin, seed: int, warm_c: float = 25.0) -> np.ndarray:
    touch, rng = skin.resting(1.0), np.random.default_rng(seed)
    return skin.plant.counts(touch, rng, warm_c=warm_c, world_ut=EARTH_UT)


@long_after_first("warm_c", [25.0, 45.0])
def test_a_tare_reads_what_resting_neighbours_add_along_z(skin, warm_c):
    """Cold and warm, in a body that stands in the Earth's field."""
    found = tare(skin.known, untouched(skin, 3, warm_c))
    true = added(skin.plant, Touch.none(1, skin.n))[0] + EARTH_UT[0] @ skin.known.rotation[:, 2]
    off = found.axial_rest_ut - true
    sigma = found.axial_rest_sigma_ut
    # what the table of angles is off is common to all units: one error, within two sigma
    assert np.sqrt(np.mean((off / sigma) ** 2)) < 2.0
    assert sigma.max() < 45.0
    known = found.applied().parameters
    np.testing.assert_array_equal(known["axial_rest_ut"], found.axial_rest_ut)
    np.testing.assert_array_equal(known["axial_rest_sigma_ut"], sigma)


def test_what_films_add_as_they_move_is_within_its_variance(skin):
    rng, scenes = np.random.default_rng(6), 12
    pressed = rng.random((scenes, skin.n)) < 0.6
    touch = Touch.none(scenes, skin.n)
    touch.depth_mm[:] = 1.8 * rng.random((scenes, skin.n)) * pressed
    angle = rng.uniform(-np.pi, np.pi, (scenes, skin.n))
    length = 1.5 * np.sqrt(rng.random((scenes, skin.n))) * pressed
    touch.moved_mm[:] = np.stack([length * np.cos(angle), length * np.sin(angle)], axis=1)
    true = added(skin.plant, touch) - added(skin.plant, Touch.none(1, skin.n))
    decoder = Decoder(tare(skin.known, untouched(skin, 7)).applied())
    moved = np.concatenate([touch.moved_mm, touch.depth_mm[:, np.newaxis]], axis=1)
    seen, out = np.ones(skin.n, bool), np.empty((5, skin.n), np.float32)
    off = np.array([
        decoder.crosstalk.predict(each, seen, out)[3] - row
        for each, row in zip(moved.astype(np.float32), true, strict=True)
    ])  # fmt: skip
    # errors of places and fits are not in it
    sigma = np.hypot(np.sqrt(decoder.crosstalk.axial_ut2), 20.0)
    assert np.sqrt(np.mean((off / sigma) ** 2)) < 1.2


def test_a_tare_without_bz_measures_nothing_along_z(skin):
    wired = skin.known.wired.copy()
    wired[BZ] = False
    blind = dataclasses.replace(skin.known, wired=wired)
    found = tare(blind, untouched(skin, 10))
    assert np.isnan(found.axial_rest_ut).all()
    assert not found.applied().parameters["axial_rest_sigma_ut"].any()
    assert np.isfinite(found.offset_ut).all()


TARED = {
    # what a tare reads, and its sigma; what is taken, and its variance: theory says 100 and 30 µT
    "not measured": (130.0, 0.0, 100.0, 900.0),
    "nearly too far off": (345.0, 40.0, 188.2, 576.0),
    "not believed": (355.0, 40.0, 100.0, 900.0),
}


@pytest.mark.parametrize("case", TARED)
def test_theory_and_tare_weigh_by_their_variances_within_five_sigma_of_both(case):
    read_ut, sigma_ut, taken_ut, left_ut2 = TARED[case]
    known = with_parameters(square(1), axial_rest_ut=read_ut, axial_rest_sigma_ut=sigma_ut)
    found = axial_at_rest(known, np.array([100.0]), np.array([900.0]))
    assert np.ravel(found) == pytest.approx([taken_ut, left_ut2])


def test_a_tare_shows_by_which_share_all_films_add_otherwise_than_as_drawn():
    """Its square, over that before; the shape leaves a tenth; one without news leaves it all."""
    palm = shape_of("palm")
    stencil = Stencil.of(palm)
    rest_ut = stencil.rest_ut[2]
    prior = np.mean(stencil.rest_sigma_ut[2] ** 2) / np.mean(rest_ut**2)
    for share, sigma_ut, left in ((-0.2, 1.0, 0.04 / prior), (0.0, 1.0, 0.1), (0.0, 1e6, 1.0)):
        tared = {"axial_rest_ut": (1.0 + share) * rest_ut, "axial_rest_sigma_ut": sigma_ut}
        assert share_shown(with_parameters(palm, **tared), stencil) == pytest.approx(left, rel=0.01)
