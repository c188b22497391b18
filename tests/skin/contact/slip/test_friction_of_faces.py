"""Friction of faces, function by function: sums of units, the posterior, the cone, the grip."""

from dataclasses import asdict

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from skin.contact.model import contact_data
from skin.contact.record import CONTACT, NO_FRICTION, Event, SlipState, UnitSlip
from skin.contact.slip import SlipSettings
from skin.contact.slip.friction import (
    _follow_friction,
    _has_slid,
    _hazard,
    _tangential_variance,
    friction_margin,
    learn_friction,
    show_bounds,
    stick_ratio_by_cone,
)
from skin.contact.slip.state import slip_data
from tests.skin.contact.slip.bench import Bench, flat_skin


def of_units(n=6):
    """A record, its units 4, 0 and 2, and the memory of slip."""
    data = slip_data(contact_data(n, 1, 0))
    data.slip[:] = UnitSlip.STICK
    data.units["force"] = data.units["force_sigma"] = 1.0
    return np.zeros(1, CONTACT)[0], np.array([4, 0, 2]), data


@pytest.mark.parametrize("z", [-6.0, -1.0, 0.0, 2.0, 7.9, 8.1, 30.0])
def test_hazard_is_the_density_over_the_tail(z):
    assert _hazard(z) == pytest.approx(np.exp(norm.logpdf(z) - norm.logsf(z)), rel=5e-4)
    if z <= 8.0:
        assert _hazard(z) == pytest.approx(np.exp(norm.logpdf(z) - norm.logsf(z)), rel=1e-9)


def test_the_asymptote_of_the_hazard_begins_where_the_tail_is_still_told():
    # from 8 on, erfc loses its digits one by one
    assert _hazard(np.nextafter(8.0, 9.0)) == pytest.approx(8.125, abs=1e-9)
    assert _hazard(7.99) != pytest.approx(7.99 + 1.0 / 7.99, rel=1e-6)


@pytest.mark.parametrize(
    ("shear", "variance", "slid"),
    [(1.0, 0.11, True), (1.0, 0.112, False), (-1.0, 0.01, False), (0.0, 0.0, False),
     (0.3, 0.0099, True), (0.3, 0.0101, False)],
)  # fmt: skip
def test_a_unit_has_slid_whose_shear_is_beyond_three_sigmas(shear, variance, slid):
    _, _, data = of_units()
    data.slips["slid_shear"][4], data.slips["slid_variance"][4] = shear, variance
    assert bool(_has_slid(data.slips[4])) == slid


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


def test_a_bound_tells_from_five_sigmas_below_the_mean_on():
    for far, told in ((-4.99, True), (-5.01, False)):
        record, members, data = of_units()
        record["friction_mean"], record["friction_spread"] = 0.5, 0.02
        data.slips["borne"][0] = 0.5 + far * 0.02
        _follow_friction(record, members, data.slips)
        assert (record["friction_information"] > 0.0) == told


def test_friction_is_never_nothing():
    record, members, data = of_units()
    record["friction_mean"], record["friction_spread"] = 0.5, 0.5
    data.slips["slid_shear"][0], data.slips["slid_load"][0] = 1e-6, 1.0
    data.slips["slid_variance"][0] = 1e-16
    _follow_friction(record, members, data.slips)
    assert record["friction_mean"] == 1e-3


def test_the_first_friction_is_the_mean_of_those_that_slid():
    record, members, data = of_units()
    history = data.slips
    history["slid_shear"][[4, 0]], history["slid_load"][[4, 0]] = (3.0, 8.0), (10.0, 20.0)
    history["slid_variance"][[4, 0]] = 1e-12
    data.slip[[4, 0, 2]] = UnitSlip.SLIPPING
    learn_friction(record, members, 11.0, data)
    # both tell as much, so the first step leads nowhere else
    assert record["friction_mean"] == pytest.approx(0.35, rel=1e-6)
    # the spread that they show, a tenth of it being noise of nothing, against a prior of four
    squares = 2.0 * 0.05**2 + 4.0 * (0.05 * 0.35) ** 2
    assert record["friction_spread"] == pytest.approx(np.sqrt(squares / 6.0), rel=1e-5)


def learn(state, *, sliding_s=0.1, slip=SlipState.STICK, since_s=0.1, ratio=1.7, dt_s=0.5):
    """One cycle of one unit, 0, that is dragged along (0.6, 0.8); what is known of it."""
    record, members, data = of_units()
    history = data.slips
    data.units["force"] = 0.0, 0.0, 1.0
    data.units["force"][0] = 0.9, 0.2, 2.0
    data.units["force_sigma"] = 0.03, 0.05, 0.07
    history["direction"][members] = [[1.0, 0.0], [0.6, 0.8], [1.0, 0.0]]
    history["noise_ratio"] = 1.0
    history["noise_ratio"][0] = ratio
    history["slid_shear"][0], history["slid_load"][0], history["slid_variance"][0] = 1.0, 4.0, 0.2
    history["sliding_s"][0], data.slip[0] = sliding_s, state
    record["slip"], record["gross_ns"] = slip, 7_000_000_000
    data.cycle["now_ns"], data.cycle["elapsed_s"] = 7_000_000_000 + round(since_s * 1e9), dt_s
    learn_friction(record, members, 8.0, data)
    return record, history


SHEAR, LOAD = 0.6 * 0.9 + 0.8 * 0.2, 2.0
VARIANCE = 0.5 * (0.03**2 + 0.05**2) + (SHEAR / LOAD * 0.07) ** 2


@pytest.mark.parametrize("ratio", [1.7, 0.5])
def test_a_unit_that_slides_adds_its_force_along_its_way(ratio):
    record, history = learn(UnitSlip.SLIPPING, ratio=ratio)
    assert history["slid_shear"][0] == pytest.approx(0.95 * 1.0 + SHEAR)
    assert history["slid_load"][0] == pytest.approx(0.95 * 4.0 + LOAD)
    assert history["slid_variance"][0] == pytest.approx(0.95 * 0.2 + VARIANCE * max(ratio, 1.0))
    assert history["borne"][0] == 0.0
    assert record["friction_lower"] == 0.0


def test_a_unit_that_sticks_bears_what_it_bears_less_the_sigmas_of_an_alarm():
    record, history = learn(UnitSlip.STICK)
    bound = (SHEAR - np.sqrt(2.0 * 8.0 * 1.7 * VARIANCE)) / LOAD
    assert bound > 0.0
    assert history["borne"][0] == pytest.approx(bound)
    assert record["friction_lower"] == pytest.approx(bound)
    assert history["slid_load"][0] == pytest.approx(0.95 * 4.0)


def test_a_unit_that_slips_and_was_not_seen_sliding_tells_nothing():
    for since in (0.0, -0.1):
        record, history = learn(UnitSlip.SLIPPING, sliding_s=since)
        assert history["slid_load"][0] == pytest.approx(0.95 * 4.0)
        assert history["borne"][0] == 0.0
        assert record["friction_lower"] == 0.0


@pytest.mark.parametrize(("since_s", "all_slide"), [(0.1, True), (0.249, True), (0.251, False)])
def test_units_of_a_contact_that_slides_as_a_whole_slide_for_a_while(since_s, all_slide):
    for state in (UnitSlip.STICK, UnitSlip.SLIPPING):
        _, history = learn(state, slip=SlipState.GROSS, since_s=since_s, sliding_s=0.0)
        told = 0.95 * 4.0 + (LOAD if all_slide else 0.0)
        assert history["slid_load"][0] == pytest.approx(told)
    _, history = learn(UnitSlip.STICK, slip=SlipState.INCIPIENT, since_s=since_s)
    assert history["slid_load"][0] == pytest.approx(0.95 * 4.0)


def test_what_slid_is_forgotten_in_ten_seconds_and_never_counts_against_itself():
    _, history = learn(UnitSlip.STICK, dt_s=11.0)
    assert history["slid_shear"][0] == history["slid_load"][0] == history["slid_variance"][0] == 0.0


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
    assert _tangential_variance(record) == pytest.approx(across)
    assert not record["flags"] & NO_FRICTION


def test_friction_from_the_settings_has_no_sigma_and_none_at_all_no_margin():
    record, model = cone(friction=0.25)
    assert friction_margin(record, model) == pytest.approx(1.5 / 8.0)
    assert record["margin"] == pytest.approx(1.0 - 1.5 / 2.0)
    assert np.isnan([record[k] for k in ("friction_sigma", "friction_spread")]).all()
    assert np.isnan(record["grip_force_sigma"])
    record, model = cone()
    record["margin"] = record["grip_force"] = record["grip_force_sigma"] = 1.0
    friction_margin(record, model)
    assert np.isnan([record[k] for k in ("margin", "grip_force", "grip_force_sigma")]).all()
    assert record["flags"] & NO_FRICTION


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


@pytest.mark.parametrize("given", [{"information": 400.0}, {"friction": 0.25}])
def test_where_friction_is_known_it_stays(given):
    record, model = cone(**given)
    record["friction_lower"] = 0.9
    used = friction_margin(record, model)
    before = record.copy()
    show_bounds(record, used, model)
    for name in CONTACT.names:
        np.testing.assert_array_equal(record[name], before[name], err_msg=name)


def test_rounding_makes_no_variance_negative():
    record, _ = cone()
    normal = record["axes"][:, 2].copy()
    record["wrench_covariance"] = 0.0
    record["wrench_covariance"][:3, :3] = np.outer(normal, normal) - 1e-3 * np.eye(3)
    assert _tangential_variance(record) == 0.0


def test_the_share_that_sticks_is_of_faces_whose_friction_is_more_than_in_use():
    record = np.zeros(1, CONTACT)[0]
    for margin in (-0.07, 0.0, 0.03, 0.1):
        record["margin"] = margin
        assert stick_ratio_by_cone(record) == pytest.approx(norm.cdf(margin, scale=0.05))


def test_a_gap_as_soon_as_a_unit_slips_leaves_it_unseen_for_a_while():
    rng = np.random.default_rng(41)
    bench = Bench(flat_skin(5, rng), rng)
    load, gaps = np.array([2.0, 1.5, 0.5, 1.8, 0.6]), 0
    event = Event.BORN
    for t in range(60):
        slips = (bench.data.slip == UnitSlip.SLIPPING).any()
        gaps += slips
        bench.read(load, bench.drag((0.04 * np.clip(t - 15, 0, 30), 0.0)), 0.4)
        told = {"id": 7, "members": [4, 2, 0, 1, 3], "event": event}
        bench.judge([told], 0.24 if gaps == 1 else 0.014)
        event = Event.NONE
    assert gaps > 3
