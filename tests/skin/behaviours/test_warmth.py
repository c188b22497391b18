"""Temperature behind two lags, phases, band and limit; with silent units, bus and a magnet."""

import math

import numpy as np
import pytest

from skin.behaviours.warmth import Warmth, WarmthSettings
from skin.errors import OptionError


def go(held, warmth, seconds, rate=0.0):
    for _ in range(round(seconds / held.period_s)):
        warmth.update(held.step(rate))


def test_what_is_within_is_told_while_the_gel_is_far_behind(held):
    held.inside_c = held.wall_c = 60.0
    warmth = Warmth(held.topology)
    go(held, warmth, 4.0)
    assert warmth.gel_c < 50.0
    assert warmth.inside_c == pytest.approx(60.0, abs=max(4.0 * warmth.sigma_c, 0.1))
    assert warmth.sigma_c < 0.5
    assert warmth.surface_c == pytest.approx(60.0, abs=1.0)


def test_a_rise_is_followed_without_lag(held):
    warmth = Warmth(held.topology)
    go(held, warmth, 4.0)
    go(held, warmth, 8.0, rate=2.5)
    assert held.inside_c == pytest.approx(44.0)
    assert warmth.inside_c == pytest.approx(held.inside_c, abs=0.3)
    assert warmth.rate_c_per_s == pytest.approx(2.5, abs=0.2)
    assert held.inside_c - warmth.gel_c > 10.0


def test_errors_are_those_that_sigma_tells(held):
    kind, ratios = type(held), []
    for seed in range(8):
        held = kind(seed)
        held.inside_c = held.wall_c = 40.0 + seed
        warmth = Warmth(held.topology)
        go(held, warmth, 3.0)
        ratios.append((warmth.inside_c - held.inside_c) / warmth.sigma_c)
    assert np.sqrt(np.mean(np.square(ratios))) < 2.0


def test_phases_turn_within_a_second(held):
    warmth = Warmth(held.topology)
    go(held, warmth, 5.0)
    assert warmth.phase == "steady"
    for rate, phase in ((2.5, "heating"), (-0.8, "cooling"), (2.0, "heating")):
        go(held, warmth, 1.2, rate)
        assert warmth.phase == phase
        assert warmth.phase_began_s == pytest.approx(held.time_s - 1.2, abs=1.0)
        go(held, warmth, 6.0, rate)
        assert warmth.phase == phase
    assert [d.what for d in warmth.decisions if d.what in ("heating", "cooling")] == [
        "heating", "cooling", "heating",
    ]  # fmt: skip


def test_what_rests_for_20_s_is_steady_all_along(held):
    warmth = Warmth(held.topology)
    go(held, warmth, 5.0)
    for _ in range(5_000):
        warmth.update(held.step())
        assert warmth.phase == "steady"


def test_band_limit_and_hot_surface_are_told_with_their_reasons(held):
    held.inside_c = held.wall_c = 55.0
    warmth = Warmth(held.topology, settings=WarmthSettings(ahead_s=2.0))
    go(held, warmth, 4.0)
    assert warmth.hot
    assert not warmth.in_band
    go(held, warmth, 5.0, rate=2.0)
    assert warmth.in_band
    assert not warmth.over_limit
    seen = []
    while held.inside_c < 92.0:
        warmth.update(held.step(2.0))
        if warmth.over_limit:
            seen.append(held.inside_c)
    assert 85.0 < seen[0] < 90.0  # two seconds ahead
    told = [decision.what for decision in warmth.decisions]
    assert "in band" in told
    assert "out of band" in told
    assert "limit" in told
    assert "90 °C" in str(warmth.decisions.last) or any("90 °C" in str(d) for d in warmth.decisions)


def test_units_that_fall_silent_leave_the_temperature_where_it_is(held):
    held.inside_c = held.wall_c = 50.0
    held.gel_c += np.linspace(-6.0, 6.0, held.topology.n)  # gels that began elsewhere
    warmth = Warmth(held.topology)
    go(held, warmth, 4.0)
    held.valid[:20] = False
    for _ in range(500):
        warmth.update(held.step())
        assert warmth.inside_c == pytest.approx(50.0, abs=0.5)
        assert warmth.known


def test_a_bus_that_stops_for_200_ms_is_bridged(held):
    warmth = Warmth(held.topology)
    go(held, warmth, 4.0)
    go(held, warmth, 6.0, rate=2.0)
    before = warmth.sigma_c
    held.heard = False
    for _ in range(50):
        warmth.update(held.step(2.0))
        assert math.isnan(warmth.gel_c)
        assert warmth.inside_c == pytest.approx(held.inside_c, abs=0.4)
    assert warmth.sigma_c > before
    held.heard = True
    go(held, warmth, 1.0, 2.0)
    assert warmth.inside_c == pytest.approx(held.inside_c, abs=0.4)
    assert warmth.phase == "heating"


def test_a_bus_that_stays_silent_makes_the_temperature_unknown(held):
    warmth = Warmth(held.topology)
    go(held, warmth, 4.0)
    go(held, warmth, 4.0, rate=2.0)
    held.heard = False
    go(held, warmth, 30.0)
    assert not warmth.known
    assert warmth.sigma_c > 3.0


def test_a_magnet_near_half_of_the_units_changes_nothing(held):
    held.inside_c = held.wall_c = 50.0
    warmth = Warmth(held.topology)
    go(held, warmth, 4.0)
    held.spoilt_n[:2, ::2] = 2.0  # what it does to forces; the decoder says MAGNETIC_ANOMALY
    held.valid[::2] = False
    for _ in range(500):
        warmth.update(held.step())
        assert warmth.inside_c == pytest.approx(50.0, abs=0.4)


def test_what_is_let_go_is_forgotten(held):
    warmth = Warmth(held.topology)
    go(held, warmth, 3.0)
    held.grip_n = held.weight_n = 0.0
    go(held, warmth, 5.0)
    assert warmth.phase == "unknown"
    assert math.isnan(warmth.inside_c)
    assert warmth.decisions.last.what == "nothing is held"


@pytest.mark.parametrize(
    "bad", [{"gel_lag_s": 0.0}, {"band_c": (75.0, 60.0)}, {"turn_sigmas": math.nan}]
)
def test_settings_that_cannot_be_are_refused(bad):
    with pytest.raises(OptionError, match="must be a number from"):
        WarmthSettings(**bad)


def test_patches_that_are_not_there_are_refused(held):
    with pytest.raises(OptionError, match="'left'"):
        Warmth(held.topology, ["lefd"])
