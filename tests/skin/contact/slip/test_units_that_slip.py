"""When a unit slips and when it holds again, and how fast its lag follows; by formulas."""

from types import SimpleNamespace

import numpy as np
import pytest

from skin.contact.record import CONTACT, UnitSlip
from skin.contact.slip import SlipSettings
from skin.contact.slip.data import SlipData, slip_arrays
from skin.contact.slip.state_machine import _comes_to_rest, decide_units
from skin.contact.slip.unit_filter import lowpass_share
from tests.skin.contact.slip.bench import Bench, flat_skin


@pytest.mark.parametrize("floor_mm", [0.002, 0.2])
@pytest.mark.parametrize("share", [0.98, 1.02])
def test_a_unit_rests_whose_mean_lag_went_no_further_than_three_sigmas(floor_mm, share):
    slip, model = slip_arrays(SlipData.zeros(4)), SlipSettings(floor_mm=floor_mm).model()
    history, unit, noise = slip.history, slip.scratch.unit, 0.01
    limit = 3.0 * np.sqrt(2.0 * (noise / 10.0 + floor_mm**2))
    history.mean_lag[:, 2] = 0.4, -0.7
    lag = history.mean_lag[:, 2] + share * limit * np.array([0.6, -0.8])
    unit.lag[:, 1] = lag
    for cycle in range(10):
        assert history.lag_cycles[2] == cycle
        rests = _comes_to_rest(history, 2, unit, noise, 1, 0.025, model)
        assert rests == (cycle == 9 and share < 1.0)
    if share < 1.0:
        np.testing.assert_allclose(unit.anchor[:, 1], lag)
        np.testing.assert_allclose(unit.lag[:, 1], 0.0, atol=1e-12)
        assert unit.anchor_variance[1] == pytest.approx(noise / 10.0)
    else:
        np.testing.assert_allclose(history.mean_lag[:, 2], lag)
        assert history.sliding_s[2] == pytest.approx(0.25)
        assert not history.lag_sum.any()
        assert history.lag_cycles[2] == 0.0


def test_a_unit_that_begins_to_slip_remembers_nothing_of_its_last_slip():
    slip, model = slip_arrays(SlipData.zeros(4)), SlipSettings().model()
    history, row = slip.history, slip.scratch.row
    for array in (history.mean_lag, history.lag_sum, history.lag_cycles, history.sliding_s):
        array[:] = 7.0
    record = np.zeros(1, CONTACT)[0]
    record["begin"], record["end"] = 1, 4
    least = np.sqrt(2.0 * (11.0 + np.log(3.0)))
    row.slip_score[:3] = 1.01 * least, 0.99 * least, -2.0 * least
    units = SimpleNamespace(members=np.array([0, 3, 1, 2]), slip=np.full(4, UnitSlip.STICK))
    units.slip[0] = UnitSlip.NO_CONTACT
    decide_units(record, units, 0.004, 11.0, model, slip)
    assert units.slip.tolist() == [UnitSlip.NO_CONTACT, UnitSlip.STICK, UnitSlip.STICK,
                                   UnitSlip.SLIPPING]  # fmt: skip
    assert not history.mean_lag[:, 3].any()
    assert not history.lag_sum[:, 3].any()
    assert history.lag_cycles[3] == 0.0
    assert history.sliding_s[3] == 0.25
    assert (history.lag_sum[:, :3] == 7.0).all()
    assert row.held[:3].tolist() == [0.0, 1.0, 1.0]


@pytest.mark.parametrize("load", [1e-3, 0.3, 5.0])
def test_lags_of_a_fast_body_follow_fast_be_it_light_or_heavy(load):
    scratch = slip_arrays(SlipData.zeros(8)).scratch
    unit, row = scratch.unit, scratch.row
    row.held[:3], row.load[:3], row.noise[:] = 1.0, load * np.array([1.0, 2.0, 3.0]), 0.01
    row.now[:] = [[1.0], [-0.5]]
    unit.moved_slow[:, :3] = [[0.1, 0.2, 0.3], [0.0, -0.1, 0.1]]
    ahead = np.array([[1.0], [-0.5]]) - unit.moved_slow[:, :3]
    far = np.sqrt(np.average((ahead**2).sum(axis=0), weights=[1, 2, 3]) - 0.01 * 2.0 / 3.0)
    share = lowpass_share(8, 2, 3, 0.004, unit, row)
    assert share == pytest.approx(1.0 - 3.0 * np.sqrt(0.01) / far)
    row.held[:] = 0.0
    assert lowpass_share(8, 2, 0, 0.004, unit, row) == pytest.approx(1 - np.exp(-0.125))


@pytest.mark.parametrize("count", [7, 8, 9, 15])
def test_light_units_as_many_as_a_vector_has_and_one_more_or_less(count):
    rng = np.random.default_rng(61)
    bench = Bench(flat_skin(16, rng), rng, friction=0.5)
    members, load = rng.permutation(16)[:count], rng.uniform(0.02, 0.06, 16)
    # what another contact has left in the rows must not tell
    everything = rng.permutation(16)
    for t in range(24):
        bench.read(load, bench.drag((0.01 * max(0, t - 10), 0.0)), 0.6, sigma_mm=0.002)
        if t < 4:
            bench.judge([{"id": 2, "members": everything}], 0.02)
        else:
            bench.judge([{"id": 4, "members": members}], 0.02)
    length = (count + 7) // 8 * 8
    rows = bench.data.slip.row
    assert not rows[:3, count:length].any()
    assert (rows[7, length:16] != 0.0).all()
