"""What is judged of a body that is dragged, cycle by cycle."""

import numpy as np
import pytest

from skin.contact.record import SlipState, UnitSlip
from tests.fixtures.cases import long_after_first
from tests.skin.contact.slip.bench import curved_skin, flat_skin

NONE, STICK, INCIPIENT, GROSS = SlipState


def drag_along(bench, load, *, speed=0.03, friction=0.4, halts=60, cycles=90, angle=0.004,
               dt_s=0.005, start=12, **told):  # fmt: skip
    """Drag one body over all units from cycle 12 on until it halts; its states and the units'."""
    states, seen, everything = [], set(), np.arange(bench.n)[::-1]
    for t in range(cycles):
        way = speed * np.clip(t - start, 0, halts)
        drag = bench.drag((0.8 * way, 0.6 * way), angle * way)
        bench.read(load, drag, friction, **told)
        (record,) = bench.judge([{"id": 5, "members": everything}], 0.02 if t < 10 else dt_s)
        states.append(SlipState(record["slip"]))
        seen |= {UnitSlip(state) for state in bench.data.slip}
    return states, seen


SETTINGS = {
    "defaults": {},
    "friction": {"friction": 0.3},
    "noise": {"gain_error": 0.05, "floor_mm": 0.02, "false_alarms_per_hour": 50.0},
    "ratios": {"incipient_ratio": 0.9, "gross_ratio": 0.5, "safety": 2.0, "slips_per_hour": 3.0},
}


@long_after_first("name", SETTINGS)
@long_after_first("skin", [flat_skin, curved_skin])
def test_a_body_that_is_dragged_until_it_slides(name, skin, bench_of):
    rng = np.random.default_rng(len(name))
    bench = bench_of(skin(6, rng), rng, **SETTINGS[name])
    states, _ = drag_along(bench, rng.uniform(0.6, 2.0, 6))
    assert STICK in states
    assert max(states) >= INCIPIENT


@long_after_first("skin", [flat_skin, curved_skin])
def test_units_that_slip_stick_again_when_the_body_rests(skin, bench_of):
    rng = np.random.default_rng(3)
    bench = bench_of(skin(7, rng), rng)
    load = np.array([2.0, 1.8, 0.5, 2.2, 1.9, 0.7, 2.4])
    states, seen = drag_along(bench, load, speed=0.04, halts=30, cycles=120, dt_s=0.01)
    assert set(states) == {NONE, STICK, INCIPIENT}
    assert seen == {UnitSlip.STICK, UnitSlip.SLIPPING, UnitSlip.RE_STICK}


@pytest.mark.parametrize("factor", [0.5, 2.5])
def test_noise_that_is_not_as_told(factor, bench_of):
    rng = np.random.default_rng(5)
    bench = bench_of(flat_skin(5, rng), rng)
    drag_along(bench, rng.uniform(0.8, 1.6, 5), noise=factor, cycles=80)
    assert (bench.data.slips["noise_ratio"] > 1.1).all() == (factor > 1.0)


def test_one_unit_whose_noise_is_greater_than_told(bench_of):
    rng = np.random.default_rng(6)
    bench = bench_of(curved_skin(6, rng), rng)
    noise = np.array([1.0, 1.0, 1.0, 6.0, 1.0, 1.0])
    drag_along(bench, rng.uniform(0.8, 1.6, 6), noise=noise, cycles=80, friction=np.inf, dt_s=0.02)
    assert bench.data.slips["noisy"][3]
    assert not bench.data.slips["noisy"].all()


@pytest.mark.parametrize("friction", [0.2, 0.45])
def test_two_units_are_judged_by_the_cone_of_the_friction_that_is_told(friction, bench_of):
    rng = np.random.default_rng(9)
    bench = bench_of(flat_skin(2, rng), rng, friction=friction)
    states, _ = drag_along(bench, np.array([1.5, 0.8]), cycles=80, speed=0.04)
    assert set(states) >= {STICK, INCIPIENT}
    assert (GROSS in states) == (friction < 0.4)
