"""Cycles that are not a period apart: what lags behind the gel has aged by the time that passed."""

from __future__ import annotations

import numpy as np
import pytest

from skin.decode.decoder import Decoder
from tests.fixtures.decode import row_of, with_parameters
from tests.skin.decode.test_field_angle import counts_at

pytestmark = pytest.mark.usefixtures("few_variants")

UNITS = 16


def skin_of(**parameters):
    return with_parameters(row_of(UNITS, rate_hz=250.0), film_drift_per_k=-0.004, **parameters)


def warmed(decoder, skin, periods, temperatures):
    """Forces of units that are pressed and dragged, at gel temperatures and times in periods."""
    found, before = [], 0.0
    each, which = np.unique(temperatures, return_inverse=True)
    counts = [counts_at(skin, 1.5, 1.5, np.linspace(-3, 3, UNITS), one) for one in each]
    for at, raw in zip(periods, (counts[k] for k in which), strict=True):
        if found:
            decoder.set_elapsed((at - before) / 250.0)
        found.append(decoder(raw).displacement_mm[:2].copy())
        before = at
    return np.array(found)


@pytest.mark.long_but_first
@pytest.mark.parametrize("every", [2, 40])
@pytest.mark.parametrize("chip", [False, True])
def test_films_are_as_warm_after_a_gap_as_after_a_steady_stream(every, chip):
    """The same second with all cycles and with every k-th one, after a step of the gel."""
    skin = skin_of(film_lag_s=0.5, hall_lag_s=0.4, hall_gain_per_k=0.003)
    if not chip:
        wired = skin.wired.copy()
        wired[5] = False
        skin = skin.__class__(**{**vars(skin), "wired": wired})
    times = np.arange(401)
    steady, seldom = (
        Decoder(skin, estimator="sine", dtype="float64", sweeps=0, ambient=False) for _ in range(2)
    )
    temperature = np.where(times < every, 25.0, 60.0)
    expected = warmed(steady, skin, times, temperature)
    got = warmed(seldom, skin, times[::every], temperature[::every])
    drift = np.abs(expected[-1] - expected[every]).max()
    assert drift > 0.05
    # a step within a gap counts as at its end: off by half a gap of the time constant at most
    late = 1.0 - np.exp(-every / 250.0 / 0.4)
    assert np.abs(got[-1] - expected[::every][-1]).max() < 0.02 * drift
    assert np.abs(got - expected[::every]).max() < 1.1 * late * drift


def test_jitter_ages_nothing_until_it_is_half_a_period():
    skin = skin_of(film_lag_s=0.5)
    rng = np.random.default_rng(2)
    times = np.arange(400)
    jitter = times + rng.normal(0.0, 0.1, 400)
    temperature = 25.0 + 0.05 * times
    expected = warmed(
        Decoder(skin, estimator="sine", dtype="float64", sweeps=0, ambient=False),
        skin,
        times,
        temperature,
    )
    got = warmed(
        Decoder(skin, estimator="sine", dtype="float64", sweeps=0, ambient=False),
        skin,
        jitter,
        temperature,
    )
    assert np.abs(got - expected).max() < 1e-3 * np.abs(expected - expected[0]).max()


@pytest.mark.long
def test_units_without_a_lag_do_not_age():
    skin = skin_of(film_lag_s=0.0)
    decoder = Decoder(skin, estimator="sine", sweeps=0, ambient=False)
    got = warmed(decoder, skin, [0.0, 0.2, 0.4, 100.0, 100.1], [25.0, 60.0, 60.0, 25.0, 25.0])
    assert np.isfinite(got).all()
    assert got[1] == pytest.approx(got[2], abs=1e-6)
    assert got[0] == pytest.approx(got[4], abs=1e-6)
