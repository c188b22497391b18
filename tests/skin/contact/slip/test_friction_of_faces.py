"""Friction of faces, function by function: sums of units, the posterior, the cone, the grip."""

from dataclasses import asdict

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from skin.contact.model import contact_data
from skin.contact.record import CONTACT, NO_FRICTION, SlipState, UnitSlip
from skin.contact.slip import SlipSettings
from skin.contact.slip.friction import (
    _follow_friction,
    _hazard,
    friction_margin,
    show_bounds,
)


def of_units(n=6):
    """A record, its units 4, 0 and 2, and the memory of slip."""
    data = contact_data(n, 1, 0)
    data.slip[:] = UnitSlip.STICK
    data.units["force"] = data.units["force_sigma"] = 1.0
    return np.zeros(1, CONTACT)[0], np.array([4, 0, 2]), data


@pytest.mark.parametrize("z", [-6.0, -1.0, 0.0, 2.0, 7.9, 8.1, 30.0])
def test_hazard_is_the_density_over_the_tail(z):
    assert _hazard(z) == pytest.approx(np.exp(norm.logpdf(z) - norm.logsf(z)), rel=5e-4)
    if z <= 8.0:
        assert _hazard(z) == pytest.approx(np.exp(norm.logpdf(z) - norm.logsf(z)), rel=1e-9)


def test_friction_goes_a_step_towards_the_likeliest_of_a_censored_normal():
    record, members, data = of_units()
    history = data.slips
    mean, spread = 0.42, 0.03
    record["friction_mean"], record["friction_spread"] = mean, spread
    # unit 4 slid, 0 bears more than the mean, 2 bears so little that it tells nothing
    history["slid_shear"][4], history["slid_load"][4], history["slid_variance"][4] = 9.0, 20.0, 0.09
    history["borne"][[4, 0, 2, 5, 3]] = 0.5, 0.44, mean - 5.01 * spread, 0.9, 0.9
    _follow_friction(record, members, history)
    # each unit's friction, given what it told: moments by integration
    noise = np.sqrt(0.09) / 20.0

    def moments(likelihood, low):
        prior = lambda x: norm.pdf(x, mean, spread) * likelihood(x)  # noqa: E731
        sums = [quad(lambda x: prior(x) * (x - mean) ** k, low, 0.8, epsabs=1e-14)[0]  # noqa: B023
                for k in range(3)]  # fmt: skip
        first, second = sums[1] / sums[0], sums[2] / sums[0]
        return first, second - first**2

    seen, left_seen = moments(lambda x: norm.pdf(0.45, x, noise), 0.1)
    borne, left_borne = moments(lambda x: 1.0, 0.44)
    information = 2.0 - (left_seen + left_borne) / spread**2
    assert record["friction_mean"] == pytest.approx(mean + (seen + borne) / information, rel=1e-6)
    assert record["friction_information"] == pytest.approx(information / spread**2, rel=1e-6)
    share_seen, share_borne = 1.0 - left_seen / spread**2, 1.0 - left_borne / spread**2
    squares = share_seen * (seen**2 + left_seen) + share_borne * (borne**2 + left_borne)
    variance = (squares + 4.0 * (0.05 * mean) ** 2) / (information + 4.0)
    assert record["friction_spread"] == pytest.approx(np.sqrt(variance), rel=1e-6)


SHEAR, LOAD = 0.6 * 0.9 + 0.8 * 0.2, 2.0
VARIANCE = 0.5 * (0.03**2 + 0.05**2) + (SHEAR / LOAD * 0.07) ** 2


def cone(*, information=0.0, **settings):
    record = np.zeros(1, CONTACT)[0]
    record["load"], record["shear"], record["torsion"], record["arm"] = 8.0, 0.9, 0.012, 0.01
    record["friction_mean"], record["friction_spread"] = 0.5, 0.04
    record["friction_information"] = information
    axes = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    record["axes"] = axes
    half = np.random.default_rng(3).standard_normal((6, 6))
    record["wrench_covariance"] = 0.01 * half @ half.T
    return record, asdict(SlipSettings(**settings))


def test_margin_and_grip_are_those_of_the_ellipsoid_of_shear_and_torsion():
    record, model = cone(information=400.0, safety=1.5)
    used = friction_margin(record, model)
    assert used == pytest.approx(1.5 / 8.0)
    assert record["friction"] == 0.5
    sigma = np.sqrt(1.0 / 400.0 + 0.025**2)
    assert record["friction_sigma"] == pytest.approx(sigma)
    assert record["margin"] == pytest.approx(1.0 - 1.5 / 4.0)
    assert record["grip_force"] == pytest.approx(4.5)
    # by derivatives: of safety × demand ÷ friction
    around = record["axes"][:, :2]
    across = np.trace(around.T @ record["wrench_covariance"][:3, :3] @ around) / 2.0
    expected = np.hypot(4.5 * sigma / 0.5, 1.5 / 0.5 * np.sqrt(across))
    assert record["grip_force_sigma"] == pytest.approx(expected)
    assert not record["flags"] & NO_FRICTION


@pytest.mark.parametrize(
    ("lower", "slip", "expected"),
    [
        (0.3, SlipState.STICK, (0.3, 1.0 - 0.1875 / 0.3, 1.5 * 1.5 / 0.3)),
        (0.3, SlipState.UNKNOWN, (0.3, 1.0 - 0.1875 / 0.3, 1.5 * 1.5 / 0.3)),
        (0.1, SlipState.STICK, (0.1, 0.0, 1.5 * 8.0)),  # what holds now is grip enough
        (0.0, SlipState.STICK, (0.0, 0.0, 1.5 * 8.0)),
        (-0.2, SlipState.STICK, (0.0, 0.0, 1.5 * 8.0)),
        (0.3, SlipState.GROSS, (0.3, 0.0, np.nan)),
    ],
)
def test_where_friction_is_not_known_what_has_held_bounds_it(lower, slip, expected):
    record, model = cone(safety=1.5)
    record["friction_lower"], record["slip"] = lower, slip
    show_bounds(record, friction_margin(record, model), model)
    found = [record[name] for name in ("friction", "margin", "grip_force")]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert record["flags"] & NO_FRICTION
    assert np.isnan(record["friction_sigma"])
