"""The load at rest, as a sum of an object's own and of a person's: what is learned as which."""

import math

import numpy as np
import pytest

from skin.behaviours.disturbance_parameters import DisturbanceParameters
from skin.behaviours.rest import Rest

PERIOD_S = 0.004
OWN = np.array([0.0, 0.1, -1.5, 0.0, 0.05, 0.0, 10.0])
LEAN = np.array([0.2, 0.0, -3.0, 0.4, 0.0, 0.0, 0.0])
NONE = [0.0] * 7
SHARE = 0.12


def watched(rest, loads, change=NONE):
    """Follow these loads, shape (t, 7)."""
    last = loads[0].tolist()
    for load in loads:
        rest.follow(load.tolist(), last, change)
        last = load.tolist()
    return rest


def loads(cycles, mean=OWN, seed=0, noise_n=0.1):
    return mean + np.random.default_rng(seed).normal(0.0, noise_n, (cycles, 7))


def learned(cycles=50):
    rest = Rest(DisturbanceParameters(), PERIOD_S)
    return watched(rest, loads(cycles))


def leaned_on():
    rest = learned(500)
    rest.move(LEAN.tolist(), SHARE, leans=True)
    return watched(rest, loads(250, OWN + LEAN, seed=1))


def test_what_is_learned_is_the_mean_and_its_doubt_one_over_the_number_of_cycles():
    rest = learned()
    assert rest.settled
    np.testing.assert_allclose(rest.own, loads(50).mean(axis=0), atol=2e-3)
    assert rest.doubt == pytest.approx(1.0 / 50.0, rel=0.02)
    assert np.sqrt(rest.noise).mean() == pytest.approx(0.1, rel=0.1)
    assert watched(rest, loads(2000)).doubt == pytest.approx(PERIOD_S / (1.0 + PERIOD_S), rel=1e-3)


def test_the_error_of_the_rest_has_the_variance_of_its_doubt():
    errors = []
    for seed in range(60):
        rest = watched(Rest(DisturbanceParameters(), PERIOD_S), loads(60, seed=seed))
        errors.append(np.array(rest.own) - OWN)
    expected = 0.01 * rest.doubt
    assert np.square(errors).mean() == pytest.approx(expected, rel=4.0 * math.sqrt(2.0 / (60 * 7)))


def test_what_changes_slowly_is_a_drift_or_of_the_person_who_leans():
    drift = np.linspace(0.0, 0.3, 1500)[:, np.newaxis] * np.array([0, 0, 1.0, 0, 0, 0, 0])
    rest = watched(learned(500), loads(1500, noise_n=0.0) + drift)
    assert rest.lean == NONE
    assert rest.own[2] == pytest.approx(-1.5, abs=0.05)
    assert rest.own[2] + rest.drift[2] == pytest.approx(-1.25, abs=0.01)  # a second behind
    rest = leaned_on()
    own, before = list(rest.own), list(rest.drift)
    watched(rest, loads(1500, OWN + LEAN, noise_n=0.0) + drift)
    assert (rest.own, rest.drift) == (own, before)
    assert rest.lean[2] == pytest.approx(-2.75, abs=0.02)
    np.testing.assert_allclose(
        rest.load, np.sum([rest.own, rest.drift, rest.lean], axis=0), atol=1e-9
    )


def test_a_load_that_goes_straight_back_is_on_the_way_all_along_and_no_other_is():
    rest = leaned_on()
    p = DisturbanceParameters()
    for part in (0.1, 0.5, 0.8):
        change = (-part * np.array(rest.lean)).tolist()
        way, end = rest.way_back(change, SHARE)
        assert way < 1e-6
        assert end > p.end
    assert max(rest.way_back((-np.array(rest.lean)).tolist(), SHARE)) < 1e-6
    aside = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert rest.way_back((aside - 0.5 * LEAN).tolist(), SHARE)[0] > p.onset
    assert rest.way_back(LEAN.tolist(), SHARE)[0] > p.onset  # leans harder
    assert learned().way_back(NONE, SHARE) == (math.inf, math.inf)


def test_who_has_let_go_leaves_the_object_alone():
    rest = leaned_on()
    rest.move((-np.array(rest.lean)).tolist(), SHARE, leans=False)
    assert rest.lean == NONE
    np.testing.assert_allclose(np.add(rest.own, rest.drift), OWN, atol=0.05)
    assert rest.own == leaned_on().own


def test_other_units_change_the_own_load_and_not_who_leans():
    rest = leaned_on()
    lean, kept = list(rest.lean), [0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0]
    rest.forget_own()
    assert not rest.known
    watched(rest, loads(15, OWN + LEAN + [0.0, 0.5, 0.3, 0.0, 0.0, 0.0, 1.0], seed=2), kept)
    assert rest.known
    assert rest.lean == lean
    own = np.add(OWN, [0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(np.add(rest.own, rest.drift), own, atol=0.12)
