"""Counter, divider and converter of a unit: one non-ideality at a time, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.status import Status
from skin import Decoder
from skin.sim.board import Counter, Divider, Gate, HallConverter
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from topology import CHANNELS, load

PALM = load("palm")
GEL, FREQUENCY, BX, BY, BZ, HALL_TEMPERATURE = range(len(CHANNELS))
RATE = np.log(12.0) / 60.0
"""Of the gel's exponential law, per kelvin."""


def at_rest(time_s: float = 0.0) -> Truth:
    return replace(Truth.at_rest(PALM.n, 25.0), time_s=time_s)


# -- counter ---------------------------------------------------------------------------------------


@given(frequency=st.floats(500.0, 5000.0))
def test_ticks_are_right_on_average_and_spread_as_their_remainder(frequency: float) -> None:
    """Mean of the counted time is the true one, its variance r (1 - r) ticks for a remainder r."""
    counter, phases = Counter(), (np.arange(20_000) + 0.5) / 20_000
    found = counter.read(np.full(phases.size, frequency), phases)
    periods = np.floor(frequency * 0.01 * (1.0 + 1e-12))
    ticks, true_ticks = periods * 1e6 / found, periods * 1e6 / frequency
    remainder = true_ticks % 1.0
    assert ticks.mean() == pytest.approx(true_ticks, abs=1e-4)
    assert ticks.var() == pytest.approx(remainder * (1.0 - remainder), abs=1e-4)


def test_a_timer_that_stands_still_is_counted_as_nothing() -> None:
    found = Counter(gate_s=0.01).read(np.array([-1.0, 0.0, 99.0, 100.0, 101.0]), 0.5)
    np.testing.assert_allclose(found[:3], 0.0)
    np.testing.assert_allclose(found[3:], [100.0, 101.0], rtol=1e-4)


# -- gate ------------------------------------------------------------------------------------------


@given(seed=st.integers(0, 1000), gate_s=st.floats(0.002, 0.08))
def test_a_gate_is_the_mean_of_the_line_through_the_samples(seed: int, gate_s: float) -> None:
    random = np.random.default_rng(seed)
    times = np.cumsum(random.uniform(0.001, 0.02, 30))
    hz = random.uniform(2000.0, 4500.0, (30, 3))
    gate = Gate(gate_s)
    found = [gate(float(t), f) for t, f in zip(times, hz, strict=True)][-1]
    inside = times[times > times[-1] - gate_s]
    knots = np.concatenate([[times[-1] - gate_s], inside])
    for unit in range(3):
        line = np.interp(knots, times, hz[:, unit])
        assert found[unit] == pytest.approx(np.trapezoid(line, knots) / gate_s, rel=1e-8)


def test_a_scene_that_starts_anew_remembers_nothing() -> None:
    gate = Gate(0.01)
    for t in (0.0, 0.004, 0.008):
        gate(t, np.array([3000.0]))
    assert gate(0.0, np.array([4000.0]))[0] == pytest.approx(4000.0)


# -- divider ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("series_ohm", "at_20", "at_80"), [(95_263.0, 0.034, 0.034), (29_180.0, 0.079, 0.0236)]
)
def test_a_step_of_the_converter_is_as_large_as_by_hand(
    series_ohm: float, at_20: float, at_80: float
) -> None:
    """(I + Is)^2 / (4096 Is I ln 12 / 60) kelvin, Is the current of the resistor alone."""
    divider = Divider(series_ohm=series_ohm)
    for celsius, expected in [(20.0, at_20), (80.0, at_80)]:
        around = 10.0 * np.exp(RATE * (celsius - 20.0 + np.linspace(-2.0, 2.0, 40_001)))
        read = np.unique(divider.read(around))
        kelvin = np.diff(np.log(read)) / RATE
        assert np.median(kelvin) == pytest.approx(expected, rel=0.02)


def test_a_broken_gel_is_at_the_ends_of_the_converter() -> None:
    np.testing.assert_array_equal(Divider().read(np.array([-1.0, 0.0, 1e9])), [0.0, 0.0, np.inf])


# -- Hall converter --------------------------------------------------------------------------------


@given(field=st.floats(-130_000.0, 130_000.0), lsb=st.floats(0.5, 500.0))
def test_the_field_comes_in_whole_steps(field: float, lsb: float) -> None:
    read = HallConverter(lsb_ut=lsb).read(np.array([field]))[0]
    assert abs(read - field) <= lsb / 2.0 * (1.0 + 1e-9)
    assert read / lsb == pytest.approx(round(read / lsb), abs=1e-6)


def test_a_field_beyond_the_chip_is_flagged_by_the_host() -> None:
    unit = UnitSimulator(PALM, noise=False, converter=HallConverter(range_ut=9_000.0))
    pressed = at_rest()
    pressed.depth_mm[7], pressed.displacement_mm[0, 7] = 2.0, 2.0
    counts = unit.counts(pressed)
    assert counts[BX, 7] == unit.highest[BX, 7]
    status = Decoder(PALM, sweeps=0, ambient=False)(counts).status
    assert Status(int(status[7])) & Status.SATURATED
    assert not np.any(np.delete(status, 7) & Status.SATURATED)


# -- the whole unit --------------------------------------------------------------------------------


def test_each_part_changes_its_own_channels_only() -> None:
    values = UnitSimulator(PALM, noise=False).quantities(
        np.full(PALM.n, 1.234), np.full((2, PALM.n), 0.321), np.full(PALM.n, 33.3)
    )
    for parts, channels in [
        ({"counter": Counter()}, [FREQUENCY]),
        ({"divider": Divider()}, [GEL]),
        ({"converter": HallConverter()}, [BX, BY, BZ]),
    ]:
        found = UnitSimulator(PALM, noise=False, **parts).measure(values.copy())
        changed = np.flatnonzero(np.any(found != values, axis=1))
        assert changed.tolist() == channels


def test_a_press_is_felt_half_a_gate_late() -> None:
    unit = UnitSimulator(PALM, noise=False, counter=Counter(gate_s=0.02, clock_hz=1e9))
    ideal = UnitSimulator(PALM, noise=False)
    for k in range(50):
        truth, earlier = at_rest(k * 0.004), at_rest()
        truth.depth_mm[:] = 5.0 * truth.time_s
        earlier.depth_mm[:] = 5.0 * (truth.time_s - 0.01)
        found = unit.counts(truth)
        if k >= 5:
            expected = ideal.counts(earlier)
            assert np.abs(found[FREQUENCY] - expected[FREQUENCY].astype(int)).max() <= 1


def test_a_working_board_decodes_within_its_resolution() -> None:
    """All parts at once: 0.45 Hz and 0.017 K at most beyond what the wire rounds."""
    unit = UnitSimulator(
        PALM, noise=False, counter=Counter(), divider=Divider(), converter=HallConverter()
    )
    truth = at_rest()
    truth.depth_mm[:] = np.linspace(0.0, 2.0, PALM.n)
    truth.temperature[:] = np.linspace(20.0, 80.0, PALM.n)
    found, exact = unit.counts(truth), UnitSimulator(PALM, noise=False).counts(truth)
    step = PALM.scale[:, 0]
    off = np.abs(found.astype(int) - exact) * PALM.scale
    assert off[FREQUENCY].max() <= 0.45 + step[FREQUENCY]
    assert (off[GEL] / (RATE * 10.0 * np.exp(RATE * (truth.temperature - 20.0)))).max() < 0.03
    assert off[BX : BZ + 1].max() <= 49.0 + step[BX]
