"""Amount, flow and stages of what is poured; with silent units, a silent bus and a magnet."""

import math

import numpy as np
import pytest

from skin.behaviours.pouring import Pouring, PouringSettings, water_density
from skin.behaviours.warmth import Warmth
from skin.errors import OptionError

G = 9.80665


@pytest.mark.parametrize(
    ("celsius", "expected"), [(0.0, 0.99984), (20.0, 0.99821), (60.0, 0.98320), (90.0, 0.96531)]
)
def test_density_is_that_of_tables(celsius, expected):
    # CRC Handbook of Chemistry and Physics
    assert water_density(celsius) == pytest.approx(expected, abs=2e-5)


class Pour:
    """Weight that grows by a flow of water at 20 °C."""

    def __init__(self, held, with_warmth=False, **settings):
        self.held = held
        self.warmth = Warmth(held.topology) if with_warmth else None
        self.pouring = Pouring(
            held.topology, settings=PouringSettings(**settings), warmth=self.warmth
        )
        self.true_ml, self.gain = 0.0, 1.0

    def go(self, seconds, ml_per_s=0.0, rate=0.0):
        for _ in range(round(seconds / self.held.period_s)):
            gained = ml_per_s * self.held.period_s
            self.true_ml += gained
            self.held.weight_n += self.gain * 1e-3 * gained * water_density(24.0) * G
            state = self.held.step(rate)
            if self.warmth is not None:
                self.warmth.update(state)
            self.pouring.update(state)


def begun(held, **settings):
    pour = Pour(held, **settings)
    pour.go(1.0)
    pour.pouring.begin()
    pour.go(1.2)
    assert pour.pouring.began
    return pour


def test_the_amount_is_right_within_its_sigma(held):
    pour = begun(held)
    pour.go(6.0, 8.0)
    pour.go(6.0)
    found = pour.pouring
    assert pour.true_ml == pytest.approx(48.0)
    assert found.poured_ml == pytest.approx(48.0, abs=max(4.0 * found.sigma_ml, 1.0))
    assert found.sigma_ml < 3.0
    assert found.weight_n == pytest.approx(held.weight_n, abs=1.0)


def test_stages_follow_the_flow(held):
    pour = begun(held)
    assert pour.pouring.stage == "none"
    for flow, stages in ((15.0, {"high"}), (6.0, {"low"}), (0.0, {"none", "micro"})):
        pour.go(3.0, flow)
        assert pour.pouring.stage in stages
        sigma = pour.pouring.flow_sigma_ml_per_s
        assert pour.pouring.flow_ml_per_s == pytest.approx(flow, abs=max(3.0, 4.0 * sigma))


@pytest.mark.parametrize("hot_c", [88.0, math.nan], ids=["known", "not told"])
def test_warming_tells_a_flow_that_the_weight_hardly_does(held, hot_c):
    alone = begun(held)
    alone.go(6.0, 12.0)
    told = Pour(type(held)(1), with_warmth=True, hot_c=hot_c)
    told.go(4.0)
    told.pouring.begin()
    told.go(1.2)
    warming = 0.3  # °C a millilitre
    told.go(6.0, 12.0, 12.0 * warming)
    assert told.pouring.c_per_ml == pytest.approx(warming, rel=0.25)
    told.go(4.0, 1.5, 1.5 * warming)
    assert told.pouring.stage == "micro"
    assert told.pouring.flow_ml_per_s == pytest.approx(1.5, abs=0.4)
    alone.go(4.0, 1.5)
    assert told.pouring.flow_sigma_ml_per_s < 0.8 * alone.pouring.flow_sigma_ml_per_s


def test_units_that_fall_silent_change_the_amount_no_more_than_its_share(held):
    pour = begun(held)
    pour.go(4.0, 8.0)
    held.valid[[3, 20]] = False
    held.valid[[9]] = False
    pour.go(3.0)
    assert pour.pouring.poured_ml == pytest.approx(pour.true_ml, abs=5.0)
    assert pour.pouring.stage in ("none", "micro")


def test_a_bus_that_stops_for_200_ms_is_no_change_of_weight(held):
    pour = begun(held)
    pour.go(4.0, 8.0)
    held.heard = False
    pour.go(0.2, 8.0)
    assert not pour.pouring.known
    assert math.isnan(pour.pouring.weight_n)
    assert pour.pouring.poured_ml == pytest.approx(pour.true_ml, abs=3.0)
    held.heard = True
    pour.go(2.0, 8.0)
    assert pour.pouring.known
    assert pour.pouring.stage == "low"
    assert pour.pouring.poured_ml == pytest.approx(pour.true_ml, abs=3.0)


def test_a_magnet_near_a_pad_is_no_flow(held):
    pour = begun(held)
    held.spoilt_n[:2, 4:8] = 3.0
    held.valid[4:8] = False  # MAGNETIC_ANOMALY
    pour.go(3.0)
    assert abs(pour.pouring.poured_ml) < 6.0
    assert pour.pouring.stage == "none"


def off_sigmas(pour):
    return (pour.pouring.poured_ml - pour.true_ml) / pour.pouring.sigma_ml


def test_sigma_covers_units_that_fall_silent_while_it_flows(held):
    ratios, errors = [], []
    for seed in range(101, 105):
        held = type(held)(seed)
        held.carries = held.random.uniform(0.6, 1.4, 32)
        pour = begun(held)
        pour.go(5.0, 15.0)
        held.valid[held.random.permutation(32)[:8]] = False
        for _ in range(8):
            pour.go(0.5, 8.0)
            ratios.append(off_sigmas(pour))
        errors.append(pour.pouring.poured_ml - pour.true_ml)
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 1.6
    assert np.abs(errors).max() < 6.0  # of 107 ml


def test_units_that_bore_all_of_it_are_missed_no_more_than_sigma_says(held):
    # half of the units bear all of the weight, and three quarters of them fall silent
    held.carries = np.where(np.arange(32) % 16 < 8, 1.0, 1e-3)
    loaded = np.flatnonzero(held.carries == 1.0)
    pour = begun(held)
    pour.go(7.0, 8.0)
    held.valid[loaded[:12]] = False
    pour.go(2.0, 8.0)
    assert abs(off_sigmas(pour)) < 2.0
    assert pour.pouring.poured_ml == pytest.approx(pour.true_ml, rel=0.2)
    pour.go(4.0, 0.0)
    assert abs(off_sigmas(pour)) < 2.0
    held.valid[:] = True  # all of them are heard again: the first zero holds
    pour.go(1.0)
    assert pour.pouring.poured_ml == pytest.approx(pour.true_ml, abs=3.0)


@pytest.mark.parametrize("silent", ["all", "one pad"])
def test_a_flow_that_stops_while_nobody_hears_it_is_within_sigma(held, silent):
    pour = begun(held)
    pour.go(3.0, 15.0)
    held.valid[: 32 if silent == "all" else 16] = False
    pour.go(0.2, 15.0)
    assert pour.pouring.stage == "high"
    pour.go(1.8, 15.0)
    pour.go(4.0)
    assert abs(off_sigmas(pour)) < 1.5
    assert pour.pouring.stage == "unknown"
    held.valid[:] = True
    pour.go(3.0)
    assert pour.pouring.stage in ("none", "micro")
    assert pour.pouring.poured_ml == pytest.approx(pour.true_ml, abs=4.0)


def test_errors_are_those_that_sigma_tells_through_all_flows(held):
    ratios = []
    for seed in range(201, 204):
        pour = begun(type(held)(seed))
        for flow in (15.0, 8.0, 1.0, 0.0):
            for _ in range(10):
                pour.go(0.3, flow)
                ratios.append(off_sigmas(pour))
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 1.3
    assert np.abs(ratios).max() < 4.0


def test_a_gain_that_is_wrong_is_within_sigma(held):
    pour = begun(held, gain_sigma=0.02)
    pour.gain = 1.03
    pour.go(10.0, 12.0)
    pour.go(2.0)
    assert pour.pouring.poured_ml > pour.true_ml + 2.0
    assert off_sigmas(pour) < 2.0


def test_stages_change_within_a_second_where_the_weight_can_tell(held):
    delays = {"high": [], "low": [], "micro": []}
    for seed in range(301, 304):
        pour = begun(type(held)(seed))
        for flow, stage in ((15.0, "high"), (6.5, "low"), (1.0, "micro")):
            wait_s = 0.0
            while pour.pouring.stage != stage and wait_s < 5.0:
                pour.go(0.02, flow)
                wait_s += 0.02
            delays[stage].append(wait_s)
            pour.go(4.0 - wait_s if wait_s < 4.0 else 0.0, flow)
    assert np.median(delays["high"]) < 1.0
    assert np.median(delays["low"]) < 1.5
    assert np.median(delays["micro"]) < 2.5


def test_what_was_poured_stays_at_the_end(held):
    pour = begun(held)
    pour.go(4.0, 8.0)
    pour.pouring.end()
    amount = pour.pouring.poured_ml
    held.weight_n = 0.0
    pour.go(1.0)
    assert pour.pouring.poured_ml == amount
    assert pour.pouring.decisions.last.what == "end"


def test_flows_out_of_order_are_refused():
    with pytest.raises(OptionError, match=r"high_ml_per_s: must be a number from 3\.5"):
        PouringSettings(high_ml_per_s=1.0)


@pytest.mark.parametrize(
    ("bad", "message"),
    [({"down": (0, 0, 0)}, r"down: must be three numbers \(x, y, z\)"),
     ({"down": (math.nan, 0, -1)}, "down: must be three numbers"),
     ({"down": (0, -1)}, "down: must be three numbers"),
     ({"hot_c": "88"}, "hot_c: must be a number"),
     ({"hot_c": math.inf}, "hot_c: must be a number")],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(bad, message):
    with pytest.raises(OptionError, match=message):
        PouringSettings(**bad)


def test_settings_and_warmth_of_another_kind_are_refused(held):
    with pytest.raises(OptionError, match="settings: must be a PouringSettings"):
        Pouring(held.topology, settings={})
    with pytest.raises(OptionError, match="warmth: must be a Warmth; got 1"):
        Pouring(held.topology, warmth=1)
