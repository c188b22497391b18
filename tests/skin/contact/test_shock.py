"""Impacts and vibration: as many false alarms as were asked for, and shocks seen in time."""

import numpy as np
import pytest
from numba import njit
from scipy.stats import chi2, gamma

from skin.contact.model import contact_data
from skin.contact.record import BORN
from skin.contact.shock import Shocks, follow_shocks
from skin.errors import SkinError


@njit
def follow_compiled(count, data):
    follow_shocks(count, data)


class Shaken:
    """Shocks of some records, whose forces and events are set by hand."""

    def __init__(self, count, rate_hz, *, follow=follow_compiled, **options):
        self._period_s = 1.0 / rate_hz
        self._data, self._follow = contact_data(1, count, 0, rate_hz), follow
        self.shocks = Shocks(rate_hz, **options)
        self.slots = self._data.slots

    def update(self, force, sigma, *, born=False, slots=(0,), dt_s=None):
        """The next cycle of the first of `slots`, one period later if no time is given."""
        record, kept = self._data.contacts[slots[0]], self.slots[slots[0]]
        record["wrench"][:3], record["wrench_sigma"][:3] = force, sigma
        record["event"] = BORN if born else 0
        cycle = self._data.cycle
        cycle["elapsed_before_s"] = cycle["elapsed_s"]
        cycle["elapsed_s"] = self._period_s if dt_s is None else dt_s
        self.slots["present"][: len(slots)] = slots
        self._follow(1, self._data)
        told = self.shocks.vibrates(kept["vibration"], kept["weight"])
        return kept["impact"], kept["vibration"], told

    def series(self, forces, sigma, events=(0,)):
        """Impact and vibration over time; forces (t, 3)."""
        seen = [self.update(force, sigma, born=t in events) for t, force in enumerate(forces)]
        return np.transpose(seen)[:2]

    def stamped(self, times_s, forces, sigma):
        """Vibration at these times, and whether it is reported; forces (t, 3)."""
        passed = np.diff(times_s, prepend=times_s[0] - self._period_s)
        seen = [
            self.update(force, sigma, born=t == 0, dt_s=passed[t]) for t, force in enumerate(forces)
        ]
        return np.transpose(seen)[1:]


@pytest.mark.parametrize("begins", [0, 7])
def test_shocks_are_second_differences_in_their_variances(begins):
    """From the third sample of a contact on, whatever went before; smoothed over 0.1 s."""
    rng = np.random.default_rng(1)
    force, sigma = rng.normal(size=(30, 3)), rng.uniform(0.5, 2.0, (30, 3))
    shaken, smoothed = Shaken(3, 100.0), 3.0
    for t in range(30):
        impact, vibration, _ = shaken.update(
            force[t], sigma[t], born=t in (0, begins), slots=(2, 0, 1)
        )
        if t < begins:
            continue
        square = 0.0
        if t >= begins + 2:
            jump = force[t] - 2.0 * force[t - 1] + force[t - 2]
            square = (jump**2 / (6.0 * sigma[t] ** 2)).sum()
            gain = 1.0 - np.exp(-0.1)
            smoothed += gain * (square - smoothed)
            assert shaken.slots[2]["weight"] == pytest.approx(gain / (2.0 - gain))
        assert impact == pytest.approx(square)
        assert vibration == pytest.approx(smoothed)
    assert not shaken.slots["impact"][:2].any()


@pytest.mark.parametrize(("rate_hz", "per_hour"), [(250.0, 1.0), (1000.0, 9.0)])
def test_limits_are_those_of_chi_square_and_of_its_average(rate_hz, per_hour):
    shocks = Shaken(1, rate_hz, false_alarms_per_hour=per_hour).shocks
    time_s = 0.1
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


@pytest.mark.parametrize("every", [1, 4])
def test_vibration_is_averaged_over_time_and_not_over_cycles(every):
    """A hum ends: a twentieth is left after three time constants, whoever skips cycles."""
    times_s = np.arange(0.0, 1.0, every / 250.0)
    force = np.zeros((times_s.size, 3))
    force[times_s < 0.5, 0] = np.resize([1.0, -1.0], (times_s < 0.5).sum())
    vibration, _ = Shaken(1, 250.0).stamped(times_s, force, 0.1)
    hum = vibration[np.searchsorted(times_s, 0.5) - 1]
    assert hum == pytest.approx(16.0 / 6.0 / 0.1**2, rel=0.02)
    later = vibration[np.searchsorted(times_s, 0.8)]
    assert later == pytest.approx(hum * np.exp(-3.0), rel=0.2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Shaken(4, 250.0, false_alarms_per_hour=0.0), "chance between 0 and 0.1; got 0"),
        (lambda: Shaken(4, 250.0, false_alarms_per_hour=1e9), "chance between 0 and 0.1; got 1111"),
    ],
)
def test_impossible_false_alarm_rates_are_refused(call, message):
    with pytest.raises(SkinError, match=message):
        call()
