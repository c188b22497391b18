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
    assert seen[0] == pytest.approx(86.0, abs=1.0)  # two seconds ahead, at 2 °C/s
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
    go(held, warmth, 1.0)
    assert not warmth.known
    go(held, warmth, 2.0)
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


def heated(held, warmth, rate=1.0, spoil=None, until_c=100.0):
    """Truth when the alarm is told first; what is within is heated until then."""
    while held.inside_c < until_c:
        state = held.step(rate)
        if spoil is not None:
            spoil(state.units)
        warmth.update(state)
        if warmth.over_limit:
            return held.inside_c
    return math.inf


@pytest.mark.parametrize(
    ("touched", "patches", "sigma_c"),
    [([0, 16], ["left"], 1.0), ([0, 16], None, 1.5), ([0, 1, 16, 17], None, 2.0)],
    ids=["one unit", "two", "four"],
)
def test_few_units_tell_the_limit_in_time(held, touched, patches, sigma_c):
    held = type(held)(touched=touched)
    held.inside_c = held.wall_c = 70.0
    warmth = Warmth(held.topology, patches, WarmthSettings(ahead_s=0.0))

    def spoil(units):
        units.temperature_sigma[:] = sigma_c

    assert 86.0 < heated(held, warmth, spoil=spoil) <= 90.0
    assert not warmth.known
    assert warmth.phase == "heating"


@pytest.mark.parametrize("rate", [0.5, 1.0, 2.0])
def test_who_hears_nothing_warns_before_what_may_have_begun_passes_the_limit(held, rate):
    held.inside_c = held.wall_c = 80.0
    warmth = Warmth(held.topology)
    go(held, warmth, 10.0)
    held.heard = False
    go(held, warmth, 1.0, rate)
    assert not warmth.known
    assert heated(held, warmth, rate) < 90.0
    go(held, warmth, 20.0)
    assert warmth.over_limit


def test_what_began_in_a_silence_is_found_after_it(held):
    held.inside_c = held.wall_c = 60.0
    warmth = Warmth(held.topology)
    go(held, warmth, 10.0)
    held.heard = False
    go(held, warmth, 12.0, rate=1.0)
    held.heard = True
    go(held, warmth, 1.5, rate=1.0)
    assert warmth.known
    assert warmth.inside_c == pytest.approx(held.inside_c, abs=3.0 * warmth.sigma_c)
    assert warmth.phase == "heating"
    assert not warmth.over_limit


def test_cycles_that_lack_one_by_one_cost_no_precision(held):
    warmth = Warmth(held.topology)
    go(held, warmth, 6.0)
    before = warmth.rate_sigma_c_per_s
    for k in range(1500):
        held.heard = k % 10 != 0
        warmth.update(held.step())
    assert warmth.rate_sigma_c_per_s < 1.3 * before
    assert warmth.phase == "steady"


@pytest.mark.parametrize("bad", [math.inf, -math.inf, math.nan, 1e30])
@pytest.mark.parametrize("name", ["temperature", "temperature_sigma", "force", "force_sigma"])
def test_a_bad_number_spoils_nothing(held, name, bad):
    held.inside_c = held.wall_c = 60.0
    warmth = Warmth(held.topology)
    for k in range(1500):
        state = held.step()
        if 500 < k < 600:
            getattr(state.units, name)[..., 5] = bad
        warmth.update(state)
    assert warmth.inside_c == pytest.approx(60.0, abs=0.5)
    held.inside_c = held.wall_c = 80.0
    assert heated(held, warmth) <= 90.0


@pytest.mark.long_but_first
@pytest.mark.parametrize("liars", [1, 4, 12])
def test_units_that_stay_cold_do_not_hide_the_limit(held, liars):
    held.inside_c = held.wall_c = 60.0
    warmth = Warmth(held.topology, settings=WarmthSettings(ahead_s=0.0))

    def spoil(units):
        units.temperature[:liars] = 24.0

    for _ in range(2500):
        state = held.step()
        spoil(state.units)
        warmth.update(state)
    assert not warmth.over_limit
    assert 87.0 < heated(held, warmth, spoil=spoil) <= 90.2


def test_of_two_units_one_that_stays_cold_makes_the_limit_early(held):
    held = type(held)(touched=[0, 16])
    held.inside_c = held.wall_c = 60.0
    warmth = Warmth(held.topology, settings=WarmthSettings(ahead_s=0.0))

    def spoil(units):
        units.temperature[0] = 24.0

    # the mean lacks half of what it is higher, and half of the 5 °C that the gel is behind
    assert heated(held, warmth, spoil=spoil) <= 93.0
    assert not warmth.known


def test_what_was_over_the_limit_stays_so_after_it_is_let_go(held):
    held.inside_c = held.wall_c = 92.0
    warmth = Warmth(held.topology)
    go(held, warmth, 6.0)
    assert warmth.over_limit
    grip_n, held.grip_n = held.grip_n, 0.0
    go(held, warmth, 6.0)
    assert math.isnan(warmth.inside_c)
    assert warmth.over_limit
    assert warmth.hot
    held.grip_n = grip_n
    held.inside_c = held.wall_c = 30.0
    held.gel_c[:] = 30.0
    go(held, warmth, 3.0)
    assert not warmth.over_limit
    assert not warmth.hot
    held.inside_c = held.wall_c = 92.0
    go(held, warmth, 6.0)
    warmth.reset()
    assert not warmth.over_limit


@pytest.mark.parametrize("lags", [{"gel_lag_s": 4.6}, {"wall_lag_s": 0.4}, {"gel_lag_s": 3.4}])
def test_a_lag_that_is_a_little_wrong_is_within_sigma(held, lags):
    # the truth has 4 s and 1 s
    warmth = Warmth(held.topology, settings=WarmthSettings(**lags))
    go(held, warmth, 6.0)
    ratios = []
    for _ in range(10):
        go(held, warmth, 2.0, rate=1.0)
        ratios.append((warmth.inside_c - held.inside_c) / warmth.sigma_c)
    assert np.abs(ratios[2:]).max() < 2.0


@pytest.mark.parametrize(
    "bad",
    [{"gel_lag_s": 0.0}, {"band_c": (75.0, 60.0)}, {"turn_sigmas": math.nan}, {"hot_c": "88"},
     {"hot_c": math.inf}, {"limit_c": 70.0}, {"lag_sigma_s": -1.0}],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(bad):
    with pytest.raises(OptionError, match="must be a number from"):
        WarmthSettings(**bad)


def test_patches_that_are_not_there_are_refused(held):
    with pytest.raises(OptionError, match="'left'"):
        Warmth(held.topology, ["lefd"])


def test_a_band_that_is_none_and_settings_of_another_kind_are_refused(held):
    with pytest.raises(OptionError, match=r"band_c: must be \(low, high\); got 75"):
        WarmthSettings(band_c=75)
    with pytest.raises(OptionError, match=r"settings: must be a WarmthSettings; got \{\}"):
        Warmth(held.topology, settings={})
    with pytest.raises(OptionError, match="pads: must be a tuple of patches; got 'left'"):
        Warmth(held.topology, "left")


def test_states_without_temperature_are_refused(held):
    state = held.step()
    state.units.temperature = None
    with pytest.raises(OptionError, match="want: must have 'temperature'"):
        Warmth(held.topology).update(state)


@pytest.mark.parametrize("railed", [slice(None), slice(0, None, 2)])
def test_a_gel_at_its_rail_ends_no_alarm_and_is_no_fall_of_the_temperature(held, railed):
    """A wall of 115 °C: gels warm to the end of the wire, 32767 counts of 7 nA, and stay there."""
    rail_c = 20.0 + 60.0 * math.log(32767 * 0.007 / 10.0) / math.log(12.0)
    held.inside_c = held.wall_c = 115.0
    warmth = Warmth(held.topology, settings=WarmthSettings(limit_c=90.0))
    seen = []
    for _ in range(round(20.0 / held.period_s)):
        state = held.step()
        told = state.units.temperature
        told[railed] = np.minimum(told[railed], np.float32(rail_c))
        warmth.update(state)
        seen.append((warmth.over_limit, warmth.hot, warmth.inside_c, warmth.phase))
    first = next(i for i, (over, *_) in enumerate(seen) if over)
    assert first < 5.0 / held.period_s
    assert all(over and hot for over, hot, *_ in seen[first:])
    assert min(inside for *_, inside, _ in seen[first:]) > 90.0
    assert all(phase != "cooling" for *_, phase in seen)


def test_a_gel_that_is_at_its_rail_from_the_first_cycle_on_is_an_alarm(held):
    held.gel_c[:] = 115.0
    warmth = Warmth(held.topology)
    state = held.step()
    state.units.temperature[:] = 95.7
    warmth.update(state)
    assert warmth.over_limit
    assert warmth.hot
    assert all("at its rail" in decision.why for decision in warmth.decisions)
