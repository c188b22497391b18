"""Impacts and vibration: as many false alarms as were asked for, and shocks seen in time."""

import numpy as np
import pytest
from scipy.stats import chi2, gamma

from skin.contact import shock
from skin.contact.shock import Shocks, shock_python
from skin.errors import SkinError

BEGIN = 1


def shocks_of(shocks, forces, sigma, events=()):
    """Impact and vibration of one contact over time; forces (t, 3)."""
    seen = []
    for t, force in enumerate(forces):
        event = np.array([BEGIN if t == 0 or t in events else 0], np.int32)
        shocks.update(1, np.zeros(1, np.int32), event, force[None], np.full((1, 3), sigma))
        seen.append((shocks.impact[0], shocks.vibration[0]))
    return np.transpose(seen)


@pytest.mark.parametrize("begins", [0, 7])
def test_shocks_are_second_differences_in_their_variances(begins):
    """From the third sample of a contact on, whatever went before; smoothed over 0.1 s."""
    rng = np.random.default_rng(1)
    force, sigma = rng.normal(size=(30, 3)), rng.uniform(0.5, 2.0, (30, 3))
    shocks, smoothed = Shocks(3, 100.0), 3.0
    for t in range(30):
        events = np.array([0, 0, BEGIN if t in (0, begins) else 0], np.int32)
        told = [np.zeros((3, 3)), np.ones((3, 3))]
        told[0][2], told[1][2] = force[t], sigma[t]
        shocks.update(1, np.array([2, 0, 1], np.int32), events, *told)
        if t < begins:
            continue
        square = 0.0
        if t >= begins + 2:
            jump = force[t] - 2.0 * force[t - 1] + force[t - 2]
            square = (jump**2 / (6.0 * sigma[t] ** 2)).sum()
            smoothed += (1.0 - np.exp(-0.1)) * (square - smoothed)
        assert shocks.impact[2] == pytest.approx(square)
        assert shocks.vibration[2] == pytest.approx(smoothed)
    assert not shocks.impact[:2].any()


def test_before_there_are_three_samples_there_is_no_shock():
    shocks, told = Shocks(1, 250.0), []
    for force in ([0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 0.0, 0.0]):
        none = np.zeros(1, np.int32)
        shocks.update(1, none, none, np.array([force]), np.ones((1, 3)))
        told.append(shocks.impact[0])
    assert told == pytest.approx([0.0, 0.0, 100.0 / 6.0])


@pytest.mark.parametrize(("rate_hz", "per_hour", "time_s"), [(250.0, 1.0, 0.1), (50.0, 9.0, 0.4)])
def test_limits_are_those_of_chi_square_and_of_its_average(rate_hz, per_hour, time_s):
    shocks = Shocks(1, rate_hz, false_alarms_per_hour=per_hour, time_s=time_s)
    samples = 3600.0 * rate_hz
    assert chi2.sf(shocks.impact_limit, 3) * samples == pytest.approx(per_hour)
    # The average over squares of differences that are correlated -2/3 and 1/6 with the next two.
    weight = (1.0 - np.exp(-1.0 / (time_s * rate_hz))) * np.exp(
        -np.arange(5000) / (time_s * rate_hz)
    )
    variance = 6.0 * sum(
        share * (weight[lag:] @ weight[: weight.size - lag])
        for lag, share in ((0, 1.0), (1, 2.0 * 4 / 9), (2, 2.0 / 36))
    )
    average = gamma(9.0 / variance, scale=variance / 3.0)
    assert (average.mean(), average.var()) == pytest.approx((3.0, variance))
    assert average.sf(shocks.vibration_limit) * samples == pytest.approx(per_hour, rel=1e-4)


@pytest.mark.parametrize("kind", ["impact", "vibration"])
def test_shocks_alarm_no_more_often_on_noise_than_asked_for(kind):
    rate, samples = 250.0, 40_000
    shocks = Shocks(1, rate, false_alarms_per_hour=3600.0 * rate / 1000.0)
    noise = 0.02 * np.random.default_rng(3).standard_normal((samples, 3))
    impact, vibration = shocks_of(shocks, noise, 0.02)
    if kind == "impact":
        begun = np.count_nonzero(impact > shocks.impact_limit)
        assert begun == pytest.approx(40, abs=20)
    else:
        above = vibration > shocks.vibration_limit
        begun = np.count_nonzero(above[1:] & ~above[:-1])
        assert begun <= 60


def test_mean_and_spread_of_vibration_on_noise_are_those_the_limit_stands_on():
    shocks = Shocks(1, 250.0)
    noise = np.random.default_rng(4).standard_normal((40_000, 3))
    _, vibration = shocks_of(shocks, noise, 1.0)
    keep = np.exp(-1.0 / 25.0)
    spread = 6.0 * (1 - keep) / (1 + keep) * (1 + 2 * (keep * 4 / 9 + keep**2 / 36))
    assert vibration[500:].mean() == pytest.approx(3.0, rel=0.02)
    assert vibration[500:].var() == pytest.approx(spread, rel=0.15)


def test_steady_and_evenly_growing_forces_are_no_shock():
    shocks = Shocks(1, 250.0)
    ramp = np.linspace(0.0, 20.0, 200)[:, None] * [0.3, -0.1, 1.0]
    impact, vibration = shocks_of(shocks, ramp, 0.01)
    assert impact.max() < 1e-12
    assert vibration[-1] < 3.0


def test_a_blow_is_an_impact_in_its_cycle_and_a_hum_a_vibration():
    shocks = Shocks(1, 250.0)
    force = np.full((400, 3), 2.0)
    force[100:, 2] += 0.5
    time_s = np.arange(200) / 250.0
    force[200:, 0] += 0.1 * np.sin(2 * np.pi * 60.0 * time_s)
    impact, vibration = shocks_of(shocks, force, 0.01)
    assert np.flatnonzero(impact > shocks.impact_limit)[0] == 100
    assert (impact[110:200] < 1e-9).all()
    assert (vibration[230:] > shocks.vibration_limit).all()


def test_a_contact_that_begins_anew_is_no_shock():
    shocks = Shocks(1, 250.0)
    force = np.ones((20, 3))
    force[10:] = 9.0
    impact, vibration = shocks_of(shocks, force, 0.01, events=(10,))
    assert impact.max() == 0.0
    assert vibration.max() == 3.0


def stamped(shocks, times_s, forces, sigma):
    """Vibration of one contact at these times, and whether it is told; forces (t, 3)."""
    seen = []
    for t, (time_s, force) in enumerate(zip(times_s, forces, strict=True)):
        event = np.array([BEGIN if t == 0 else 0], np.int32)
        shocks.update(1, np.zeros(1, np.int32), event, force[None], np.full((1, 3), sigma),
                      round(1e9 * time_s))  # fmt: skip
        _, (vibration,), (weight,) = shocks.values
        seen.append((vibration, shocks.vibrates(vibration, weight)))
    return np.transpose(seen)


@pytest.mark.parametrize("every", [1, 4])
def test_vibration_is_averaged_over_time_and_not_over_cycles(every):
    """A hum ends: a twentieth is left after three time constants, whoever skips cycles."""
    times_s = np.arange(0.0, 1.0, every / 250.0)
    force = np.zeros((times_s.size, 3))
    force[times_s < 0.5, 0] = np.resize([1.0, -1.0], (times_s < 0.5).sum())
    vibration, _ = stamped(Shocks(1, 250.0), times_s, force, 0.1)
    hum = vibration[np.searchsorted(times_s, 0.5) - 1]
    assert hum == pytest.approx(16.0 / 6.0 / 0.1**2, rel=0.02)
    later = vibration[np.searchsorted(times_s, 0.8)]
    assert later == pytest.approx(hum * np.exp(-3.0), rel=0.2)


@pytest.mark.parametrize("every", [1, 5])
def test_vibration_is_told_no_more_often_on_noise_where_cycles_are_missing(every):
    rate, samples = 250.0, 20_000
    shocks = Shocks(1, rate, false_alarms_per_hour=3600.0 * rate / 1000.0)
    noise = 0.02 * np.random.default_rng(3).standard_normal((samples, 3))
    _, told = stamped(shocks, np.arange(samples) * every / rate, noise, 0.02)
    begun = np.count_nonzero((told[1:] > 0) & (told[:-1] == 0))
    assert begun <= 30


def test_a_force_that_grows_evenly_is_no_shock_where_a_cycle_is_missing():
    times_s = np.delete(np.arange(100), [20, 50, 51, 52]) / 250.0
    ramp = times_s[:, None] * [3.0, -1.0, 10.0]
    vibration, _ = stamped(Shocks(1, 250.0), times_s, ramp, 0.01)
    assert vibration[-1] < 3.0
    assert np.diff(vibration).max() <= 0.0


def test_machine_code_and_python_shock_alike(monkeypatch):
    force = np.random.default_rng(5).standard_normal((50, 3))
    machine = shocks_of(Shocks(1, 250.0), force, 0.3, events=(20,))
    monkeypatch.setattr(shock, "shock", shock_python)
    assert shocks_of(Shocks(1, 250.0), force, 0.3, events=(20,)) == pytest.approx(machine)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Shocks(4, 250.0, false_alarms_per_hour=0.0), "chance between 0 and 0.1; got 0"),
        (lambda: Shocks(4, 250.0, false_alarms_per_hour=1e9), "chance between 0 and 0.1; got 1111"),
    ],
)
def test_impossible_false_alarm_rates_are_refused(call, message):
    with pytest.raises(SkinError, match=message):
        call()
