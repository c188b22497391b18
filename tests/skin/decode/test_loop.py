"""The loop over cycles beside the same steps done one by one by hand, to the bit."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from bus.status import Status
from skin.decode.ambient import Ambient
from skin.decode.crosstalk import CrossTalk
from skin.decode.decoder import Decoder
from tests.fixtures.ambient import apart, look
from tests.fixtures.decode import calibrated, row_of, sensible_counts
from tests.skin.decode.test_crosstalk import made_up, plane
from tests.skin.decode.test_field_angle import counts_at

pytestmark = pytest.mark.usefixtures("interpreted")

WANT = {"displacement", "field", "temperature", "force", "sigma"}
SHOWN = ("displacement_mm", "displacement_sigma_mm", "field_ut", "temperature", "force",
         "force_sigma", "status", "valid")  # fmt: skip


def square():
    """Nine units, each with a calibration of its own."""
    skin = calibrated(row_of(9), seed=2)
    return dataclasses.replace(skin, position=plane(3, 3).position)


def scene(skin, cycles=5, late=Status.LATE):
    """Presses, a unit that is late once, one that is not heard of from the beginning."""
    raw = sensible_counts(skin, cycles, 3, most=0.7)
    status = np.zeros((cycles, skin.n), np.uint16)
    status[2, 1] = late
    status[:3, 3] = Status.NEVER
    return raw, status


def same(found, expected):
    for name in SHOWN:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)


def told(skin, rng):
    return rng.normal(0.0, [[5.0], [60.0], [60.0], [60.0]], (4, skin.n))


@pytest.mark.parametrize("estimator", ["sine", "field-angle"])
@pytest.mark.parametrize("sweeps", [1, 2])
def test_sweeps_are_decodings_with_the_prediction_as_background(sweeps, estimator):
    """The first of a cycle with the displacements of the cycle before, the second with its own;
    temperatures move on once."""
    skin, rng = square(), np.random.default_rng(4)
    stencil = made_up(skin, 2, seed=1)
    looped = Decoder(
        skin, WANT, estimator, dtype="float64", sweeps=sweeps, stencil=stencil, ambient=False
    )
    alone = dataclasses.replace(skin, position=row_of(9).position)  # what moves is told
    plain = Decoder(
        alone, WANT, estimator, dtype="float64", stencil=stencil, sweeps=0, ambient=False
    )
    crosstalk = CrossTalk(skin, stencil, dtype="float64")
    place, valid, above = np.zeros((3, 9)), np.zeros(9, bool), np.zeros(9)
    taken, most = np.zeros((5, 9)), 0.0
    for t, (counts, status) in enumerate(zip(*scene(skin, late=0), strict=True)):
        given, base = told(skin, rng) if t % 2 else None, np.zeros((5, 9))
        base[:4] += 0.0 if given is None else given
        for sweep in range(sweeps):
            crosstalk.predict(place, valid, taken, base, above)
            reading = plain(counts, status, taken, elapsed_s=0.0 if sweep else None)
            place, valid = reading.displacement_mm.copy(), reading.valid.copy()
            above[:] = film_above(plain)
        same(looped(counts, status, given), reading)
        assert np.isfinite(reading.force[:, status == 0]).all()
        most = max(most, np.abs(taken[1:4] - base[1:4]).max())
    assert most > 20.0
    looped.reset()
    same(looped(*(each[0] for each in scene(skin))), first(skin, stencil, sweeps, estimator))


def film_above(decoder):
    """Temperature of the films above that of their calibration, as the decoder remembers it."""
    p, state = decoder.topology.parameters, decoder._state
    above = decoder.reading.temperature - p["film_reference_c"]
    lag = state["film_lag"].ravel()[: above.size]
    return np.where(np.isnan(above), 0.0, above + lag)


def first(skin, stencil, sweeps, estimator):
    fresh = Decoder(
        skin, WANT, estimator, dtype="float64", sweeps=sweeps, stencil=stencil, ambient=False
    )
    return fresh(*(each[0] for each in scene(skin)))


@pytest.mark.parametrize("sweeps", [0, 1])
def test_resting_neighbours_are_taken_off_with_sweeps_and_without(sweeps):
    """The chip's gain is on their field as on its own."""
    skin = square()
    one, (raw, _) = made_up(skin, 1), scene(skin)
    none = dataclasses.replace(one, rest_ut=np.zeros((3, 9)))
    bare, known = (
        Decoder(skin, WANT, dtype="float64", sweeps=sweeps, ambient=False, stencil=stencil)
        for stencil in (none, one)
    )
    p, rest = skin.parameters, one.rest_ut
    off = bare(raw[0]).field_ut - known(raw[0]).field_ut
    lateral = p["field_xx"] * rest[0] + p["field_xy"] * rest[1]
    np.testing.assert_allclose(off[0], lateral, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(off[2], rest[2], rtol=1e-6, atol=1e-6)


def test_ambient_field_comes_off_the_next_cycle():
    skin, rng = apart(6), np.random.default_rng(1)
    looped = Decoder(skin, WANT, dtype="float64", ambient=True, sweeps=0)
    plain, ambient = (
        Decoder(skin, WANT, dtype="float64", sweeps=0, ambient=False),
        Ambient(skin, "float64"),
    )
    raw, status = np.tile(counts_at(skin, np.zeros(6), 0.0, 0.0), (6, 1, 1)), scene(skin, 6)[1]
    raw[:, 2:4] += rng.integers(10, 80, (6, 2, 6)).astype(np.int16)
    for t in range(6):
        given = told(skin, rng) if t % 3 == 1 else None
        base = ambient.taken.copy()
        base[:4] += 0.0 if given is None else given
        expected = plain(raw[t], status[t], base)
        look(ambient, expected)
        same(looped(raw[t], status[t], given), expected)
        np.testing.assert_array_equal(looped.ambient.taken, ambient.taken)
    assert np.abs(ambient.background[1:]).max() > 1.0
    looped.reset()
    assert not looped.ambient.background.any()


def test_a_batch_and_bound_arrays_go_through_the_loop_as_cycles_do():
    skin = square()
    stencil, (raw, status) = made_up(skin, 1), scene(skin)
    options = {"sweeps": 1, "ambient": True, "stencil": stencil, "dtype": "float64"}
    background = np.random.default_rng(2).normal(0.0, 9.0, (5, 4, 9))
    for given in (None, background):
        one, batch = Decoder(skin, WANT, **options), Decoder(skin, WANT, **options)
        found = batch(raw, status, given)
        for t in range(5):
            reading = one(raw[t], status[t], None if given is None else given[t])
            for name in SHOWN:
                np.testing.assert_array_equal(getattr(found, name)[t], getattr(reading, name), name)
    counts, flags = np.zeros((6, 9), np.int16), np.zeros(9, np.uint16)
    one, bound = Decoder(skin, WANT, **options), Decoder(skin, WANT, **options)
    inputs = bound.inputs(counts, flags)
    for t in range(5):
        counts[:], flags[:] = raw[t], status[t]
        bound.step(inputs)
        same(bound.reading, one(raw[t], status[t]))


def test_all_units_without_load_are_looked_at_where_the_ambient_field_is_estimated():
    """Every fifth cycle at 100 Hz; all blocks at once, as the field is estimated in these cycles
    alone."""
    for rate_hz, every in ((100.0, 5), (60.0, 3)):
        skin = row_of(140, rate_hz=rate_hz)
        still = counts_at(skin, np.zeros(140), 0.0, 0.0)
        decoder = Decoder(skin, {"displacement"}, skip=True, ambient=True, sweeps=0)
        background = []
        for t in range(9):
            idle = decoder(still).status & Status.IDLE != 0
            assert idle.all() == idle.any() == (t % every != 0)
            background.append(decoder.ambient.covariance_ut2.copy())
        new = [not np.array_equal(*two) for two in itertools.pairwise(background)]
        assert new == [t % every == 0 for t in range(1, 9)]
