"""The decoder's manners: flags, memory of temperatures, views, and what it refuses."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bus.status import Status
from skin.decode.decoder import Decoder
from skin.errors import CalibrationError, CountsError, OptionError
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import calibrated, row_of, sensible_counts, sine, with_parameters

REST = {"gel": 1430, "frequency": 18000, "bx": 0, "by": 0, "hall_temperature": 0}
ROWS = {"gel": 0, "frequency": 1, "bx": 2, "by": 3, "hall_temperature": 5}


def counts_of(n=1, **changed):
    """One cycle of n units at rest, but for `changed`."""
    raw = np.zeros((6, n), np.int16)
    for name, value in {**REST, **changed}.items():
        raw[ROWS[name]] = value
    return raw


def gel_of(temperature):
    return round(10.0 * 12.0 ** ((temperature - 20.0) / 60.0) / 0.007)


def frequency_of(depth_mm):
    return round(4 * (4500.0 - 900.0 * depth_mm))


@long_after_first(
    ("changed", "flags"),
    [
        ({}, Status.OK),
        ({"bx": 32767}, Status.SATURATED),
        ({"bx": -32768}, Status.SATURATED),
        ({"by": 32767}, Status.SATURATED),
        ({"hall_temperature": 127}, Status.SATURATED),
        ({"gel": 32767}, Status.SATURATED | Status.EXTRAPOLATED),
        ({"frequency": 32767}, Status.SATURATED | Status.OUT_OF_RANGE | Status.EXTRAPOLATED),
        # the field at the crest at rest, M0 = 2624 µT, sigma 105 µT
        ({"bx": 1200}, Status.OK),
        ({"bx": 1270}, Status.SATURATED),
        ({"bx": 1400}, Status.SATURATED),
        # a stopped timer, a timer with nothing left of its capacitor
        ({"frequency": 0}, Status.OUT_OF_RANGE | Status.EXTRAPOLATED),
        ({"frequency": -5}, Status.OUT_OF_RANGE | Status.EXTRAPOLATED),
        ({"frequency": 21601}, Status.OUT_OF_RANGE | Status.EXTRAPOLATED),
        # a broken gel
        ({"gel": 0}, Status.OUT_OF_RANGE | Status.EXTRAPOLATED),
        ({"gel": -100}, Status.OUT_OF_RANGE | Status.EXTRAPOLATED),
        ({"gel": gel_of(-25.5)}, Status.OUT_OF_RANGE | Status.EXTRAPOLATED),
        # a chip that reads -25.5 °C, and one at its rail
        ({"hall_temperature": -101}, Status.OUT_OF_RANGE),
        ({"hall_temperature": -100}, Status.OK),
        ({"hall_temperature": -128}, Status.SATURATED | Status.OUT_OF_RANGE),
        # beyond what was calibrated
        ({"gel": gel_of(14.9)}, Status.EXTRAPOLATED),
        ({"gel": gel_of(15.1)}, Status.OK),
        ({"gel": gel_of(94.9)}, Status.OK),
        ({"gel": gel_of(95.1)}, Status.EXTRAPOLATED),
        ({"frequency": frequency_of(2.0)}, Status.OK),
        ({"frequency": frequency_of(2.0) - 1}, Status.EXTRAPOLATED),
        ({"frequency": frequency_of(3.18)}, Status.EXTRAPOLATED),
        ({"frequency": 18000 + 4 * 35}, Status.OK),
        ({"frequency": 18000 + 4 * 37}, Status.EXTRAPOLATED),
    ],
)
@long_after_first("dtype", ["float32", "float64"])
def test_each_flag_has_its_count(changed, flags, dtype):
    reading = sine(row_of(1), dtype=dtype)(counts_of(**changed))
    assert Status(int(reading.status[0])) == flags
    assert bool(reading.valid[0]) == (flags & Status.OUT_OF_RANGE == 0)


def test_flags_of_the_bus_come_first():
    raw = counts_of(4)
    raw[0, 1] = 0
    status = np.array([Status.NEVER, Status.NEVER, Status.LATE, 0], np.uint16)
    reading = sine(row_of(4))(raw, status)
    assert reading.status.tolist() == [Status.NEVER, Status.NEVER, Status.LATE, 0]
    assert reading.valid.tolist() == [False, False, False, True]
    for values in (reading.temperature, reading.force, reading.tangential, reading.theta):
        assert np.isnan(values[..., :2]).all()
        assert np.isfinite(values[..., 2:]).all()
    assert np.isnan(reading.displacement_mm[:, :2]).all()


# -- memory --------------------------------------------------------------------------------------


def warm_step(cycles, before, after):
    """Cycles at one temperature after a single cycle at another, in a field along x."""
    cold = counts_of(gel=gel_of(before), bx=600)
    warm = counts_of(gel=gel_of(after), bx=600)
    return np.stack([cold, *[warm] * cycles])


@pytest.mark.long
@pytest.mark.usefixtures("machine_code")
def test_a_slow_chip_does_not_stand_still_in_float32():
    """At 1 kHz a chip takes 5e-6 of the way in a cycle: less than float32 can add to 60 °C."""
    skin = with_parameters(
        row_of(1, "f3t-classic", 1000.0), hall_gain_per_k=0.002, film_drift_per_k=0.0
    )
    raw = np.repeat(warm_step(1, 60.0, 60.3), [1, 100_000], axis=0)
    raw[:, 0] = np.round(raw[:, 0] * 0.007 / 0.055)
    raw[:, 1], raw[:, 2] = 9000, 15
    single = sine(skin, dtype="float32")(raw).displacement_mm[-1, 0, 0]
    double = sine(skin, dtype="float64")(raw).displacement_mm[-1, 0, 0]
    assert abs(single - double) < 2e-6


@pytest.mark.parametrize("flag", [Status.LATE, Status.FAULT, Status.STALE, Status.TORN])
def test_an_invalid_unit_leaves_no_trace_in_the_memory(flag):
    skin = row_of(1, rate_hz=10.0)
    raw = warm_step(30, 25.0, 75.0)
    status = np.zeros((31, 1), np.uint16)
    lies = np.insert(raw, 10, counts_of(gel=gel_of(90.0), bx=600), axis=0)
    known = np.insert(status, 10, flag, axis=0)
    honest = sine(skin)(raw, status)
    marked = sine(skin)(lies, known)
    kept = np.arange(32) != 10
    np.testing.assert_array_equal(marked.force[kept], honest.force)


def test_reset_forgets_and_warmup_does_not():
    skin = row_of(1, rate_hz=10.0)
    raw = warm_step(30, 25.0, 75.0)
    decoder = sine(skin)
    first = decoder(raw).force
    decoder.warmup()
    later = decoder(raw[-1]).force.copy()
    assert later[0, 0] != first[0, 0, 0]
    decoder.reset()
    np.testing.assert_array_equal(decoder(raw).force, first)


# -- views and arrays ----------------------------------------------------------------------------


def test_any_memory_layout_will_do():
    skin = calibrated(row_of(20))
    raw = sensible_counts(skin, 3, 1)
    expected = Decoder(skin, sweeps=0, ambient=False)(raw).force
    frozen = raw.copy()
    frozen.flags.writeable = False
    spread = np.zeros((3, 6, 40), np.int16)[..., ::2]
    spread[:] = raw
    for other in (frozen, spread, np.asfortranarray(raw)):
        np.testing.assert_array_equal(Decoder(skin, sweeps=0, ambient=False)(other).force, expected)
    status = np.zeros((20, 3), np.uint16).T
    np.testing.assert_array_equal(
        Decoder(skin, sweeps=0, ambient=False)(raw, status).force, expected
    )
    one = Decoder(skin, sweeps=0, ambient=False)
    for t in range(3):
        np.testing.assert_array_equal(one(frozen[t]).force, expected[t])


def test_arrays_that_are_filled_again_are_read_again():
    """A live bus writes each cycle into the same arrays; others may come in between."""
    skin = calibrated(row_of(20))
    raw = sensible_counts(skin, 6, 1)
    expected = Decoder(skin, sweeps=0, ambient=False)(raw).force
    decoder, counts, status = (
        Decoder(skin, sweeps=0, ambient=False),
        np.zeros((6, 20), np.int16),
        np.zeros(20, np.uint16),
    )
    for t in range(6):
        counts[:] = raw[t]
        given = (raw[t], None) if t == 2 else (counts, None if t > 3 else status)
        np.testing.assert_array_equal(decoder(*given).force, expected[t])
    status[3] = Status.NEVER
    assert np.isnan(decoder(counts, status).temperature[3])
    assert np.isfinite(decoder(counts).temperature[3])


# -- refusals ------------------------------------------------------------------------------------

EXPECTED = "row: raw: must be an array of int16, shape (6, 3) or shape (t, 6, 3); got "


@pytest.mark.parametrize(
    ("raw", "got"),
    [
        (np.zeros((6, 4), np.int16), "int16, shape (6, 4)"),
        (np.zeros((3, 6), np.int16), "int16, shape (3, 6)"),
        (np.zeros((6, 3)), "float64, shape (6, 3)"),
        (np.zeros((1, 1, 6, 3), np.int16), "int16, shape (1, 1, 6, 3)"),
        ([[0] * 3] * 6, "list"),
        (None, "NoneType"),
    ],
)
def test_counts_of_another_shape_are_refused(raw, got):
    with pytest.raises(CountsError) as error:
        Decoder(row_of(3), sweeps=0, ambient=False)(raw)
    assert str(error.value) == EXPECTED + got


@pytest.mark.parametrize(
    ("raw", "given", "message"),
    [
        ((6, 3), {"status": np.zeros(3, int)}, r"status: must be an array of uint16, shape \(3,\)"),
        ((6, 3), {"status": np.zeros(4, np.uint16)}, r"status: .* shape \(3,\); got "),
        ((6, 3), {"status": [0, 0, 0]}, r"status: .* shape \(3,\); got list"),
        ((2, 6, 3), {"status": np.zeros((3, 3), np.uint16)}, r"status: .* shape \(2, 3\)"),
        ((2, 6, 3), {"background": np.zeros((3, 4, 3), np.float32)}, "background: must be an arr"),
        ((2, 6, 3), {"background": np.zeros((2, 3, 3), np.float32)}, r"shape \(2, 4, 3\)"),
        ((2, 6, 3), {"background": np.zeros((2, 6, 3), np.float32)}, r"shape \(2, 4, 3\)"),
    ],
)
def test_arrays_next_to_counts_have_their_shape(raw, given, message):
    with pytest.raises(CountsError, match=f"row: .*{message}"):
        Decoder(row_of(3), sweeps=0, ambient=False)(np.zeros(raw, np.int16), **given)


def test_bound_arrays_must_lie_together():
    decoder = Decoder(row_of(4), sweeps=0, ambient=False)
    counts, status = np.zeros((6, 4), np.int16), np.zeros(4, np.uint16)
    frozen = counts.copy()
    frozen.flags.writeable = False
    for raw, flags in ((np.zeros((4, 6), np.int16).T, status), (frozen, status),
                       (counts, np.zeros(8, np.uint16)[::2])):  # fmt: skip
        with pytest.raises(CountsError, match="row: must be contiguous and writeable to be bound"):
            decoder.inputs(raw, flags)
    for raw, flags in ((counts[:5], status), (counts, status[:3])):
        with pytest.raises(CountsError, match="must be an array of"):
            decoder.inputs(raw, flags)
    decoder.step(decoder.inputs(counts, status))
    assert decoder.reading.valid.shape == (4,)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"want": {"forse"}}, "want: must be one of .*; got 'forse' .nearest: 'force'."),
        ({"want": "wrench"}, "want: must be of the units, .*; got 'wrench', which is of the array"),
        ({"estimator": "sinus"}, "estimator: must be one of .*; got 'sinus' .nearest: 'sine'."),
    ],
)
def test_an_unknown_option_is_refused(options, message):
    with pytest.raises(OptionError, match=message):
        Decoder(row_of(3), **options)


@pytest.mark.usefixtures("interpreted")
def test_a_wire_without_a_wanted_channel_is_refused():
    wired = row_of(3).wired.copy()
    wired[0, 1] = False
    skin = dataclasses.replace(row_of(3), wired=wired)
    with pytest.raises(OptionError) as error:
        sine(skin)
    assert str(error.value) == (
        "row/r0c1: must have 'gel' on the wire to decode 'temperature'; got a layout without it"
    )
    plain = sine(row_of(3), {"force"}, dtype="float64")(counts_of(3, gel=gel_of(25.0), bx=600))
    blind = sine(skin, {"force"}, dtype="float64")(counts_of(3, gel=[gel_of(25.0), 0, 5000]))
    assert blind.status.tolist() == [0, 0, 0]
    force = sine(skin, {"force"}, dtype="float64")(counts_of(3, gel=0, bx=600)).force
    np.testing.assert_allclose(force[:, 1], plain.force[:, 1], rtol=1e-4)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"frequency_rest_hz": np.nan}, "row/r0c0: frequency_rest_hz: must be finite; got nan"),
        (
            {"temperature_max_c": [95.0, 10.0]},
            "row/r0c1: temperature_max_c: must be above temperature_min_c; got 10",
        ),
        (
            {"film_drift_per_k": [-0.001, -0.05]},
            "row/r0c1: film_drift_per_k: must be a drift that leaves a gain of 0.1 or more; "
            "got -0.05",
        ),
    ],
)
def test_a_calibration_that_cannot_be_is_refused(parameters, message):
    with pytest.raises(CalibrationError) as error:
        Decoder(with_parameters(row_of(2), **parameters), sweeps=0, ambient=False)
    assert str(error.value) == message


def test_a_message_does_not_list_all_units_of_a_skin():
    names = [f"u{i}" for i in range(64)]
    expected = "unit: must be one of 64 names from 'u0' to 'u63'; got 'u7x' (nearest: 'u7')"
    assert str(OptionError.unknown("unit", "u7x", names)) == expected
    assert "'u0', 'u1', 'u2'; got" in str(OptionError.unknown("unit", "x", names[:3]))
