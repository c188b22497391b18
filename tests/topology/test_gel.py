"""The law of the gel and its inverse."""

import numpy as np
import pytest
from scipy import optimize

from topology import UnitModel
from topology.gel import gel_ends, gel_octaves, gel_share, gel_slope, gel_temperature

LAWS = [(0.0, 0.0), (28.0, 0.0), (28.0, 6.5), (-15.0, 4.0), (5.0, -3.0)]


def law(bend, twist, ratio=12.0):
    values = {"gel_current_ratio": ratio, "gel_bend_c": bend, "gel_twist_c": twist}
    return {name: np.full(1, value) for name, value in values.items()}


@pytest.mark.parametrize(("bend", "twist"), LAWS)
def test_the_share_of_a_temperature_has_that_temperature(bend, twist):
    p, warm = law(bend, twist), np.linspace(15.0, 95.0, 81)[:, np.newaxis]
    np.testing.assert_allclose(gel_temperature(p, gel_share(p, warm)), warm, atol=1e-11)


@pytest.mark.parametrize(("bend", "twist"), LAWS)
def test_the_share_is_the_root_that_a_search_finds(bend, twist):
    p = law(bend, twist)

    def miss(x, warm):
        return 20.0 + 60.0 * x + (bend + twist * (2.0 * x - 1.0)) * x * (x - 1.0) - warm

    for warm in (21.0, 47.0, 88.0):
        x = optimize.brentq(miss, -0.1, 1.4, args=(warm,), xtol=1e-14)
        np.testing.assert_allclose(gel_share(p, np.array([warm])), 12.0**x, rtol=1e-11)


@pytest.mark.parametrize(("bend", "twist"), LAWS)
def test_octaves_and_slope_are_those_of_the_law(bend, twist):
    p, share = law(bend, twist), np.linspace(0.9, 15.0, 30)[:, np.newaxis]
    octaves = np.log2(share)
    told = 20.0 + sum(factor * octaves ** (k + 1) for k, factor in enumerate(gel_octaves(p)))
    np.testing.assert_allclose(told, gel_temperature(p, share), atol=1e-11)
    step = 1e-5
    rise = gel_temperature(p, share * np.exp(step)) - gel_temperature(p, share * np.exp(-step))
    np.testing.assert_allclose(gel_slope(p, share), rise / (2.0 * step), rtol=1e-6)


def test_where_a_law_turns_back_the_share_stays():
    p = law(28.0, 0.0)
    low, high = (float(end[0]) for end in gel_ends(p))
    assert low == pytest.approx(-32.0 / 56.0)
    assert high > 10.0
    lowest = gel_temperature(p, np.array([12.0**low]))
    np.testing.assert_allclose(gel_share(p, lowest - 30.0), 12.0**low, rtol=1e-3)


def test_units_of_both_kinds_stand_side_by_side():
    p = {name: np.concatenate([law(0.0, 0.0)[name], law(20.0, 3.0)[name]]) for name in law(0, 0)}
    warm = np.array([[18.0, 18.0], [61.0, 61.0]])
    np.testing.assert_allclose(gel_temperature(p, gel_share(p, warm)), warm, atol=1e-11)
    np.testing.assert_allclose(gel_share(p, warm)[:, 0], 12.0 ** ((warm[:, 0] - 20.0) / 60.0))


def test_a_unit_as_built_in_has_an_exponential_law():
    assert (UnitModel().gel_bend_c, UnitModel().gel_twist_c) == (0.0, 0.0)
