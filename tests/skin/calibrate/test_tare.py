"""Tare: zeros of untouched units, saved beside everything else that a calibration knows."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from msgspec import structs

import topology
from bus.status import Status
from skin.calibrate import tare as tares
from skin.calibrate.tare import chosen
from skin.errors import CountsError, OptionError, ScanError
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from skin.sim.unit import UnitSimulator
from tests.fixtures.decode import calibrated, row_of, with_parameters

CYCLES = 500
GEL, FREQUENCY, BX, BY, BZ, CHIP = range(6)


def tare(skin, counts, status=None, *, rest_ut=None, **options):
    """Of units that are simulated alone, where nothing is said of neighbours."""
    found = tares.tare(skin, counts, status, rest_ut=rest_ut, **options)
    return found.leaving_out(np.zeros((3, skin.n))) if rest_ut is None else found


def apart(skin):
    """The same units, too far from each other to feel each other."""
    place = np.zeros((3, skin.n))
    place[0] = np.arange(skin.n)
    return dataclasses.replace(skin, position=place)


def simulated(skin, cycles=CYCLES, *, field=None, temperature=24.0, seed=1, noise=True):
    """Counts of untouched units whose true parameters are those of `skin`."""
    units = UnitSimulator(skin, field=field, seed=seed, noise=noise)
    still = np.zeros((cycles, skin.n)), np.zeros((cycles, 2, skin.n))
    warm = np.full((cycles, skin.n), temperature)
    return units.quantise(units.disturb(units.quantities(*still, warm)))


def test_zeros_are_those_of_the_units():
    nominal = topology.load("palm")
    rng = np.random.default_rng(2)
    true = with_parameters(
        nominal, frequency_rest_hz=4500.0 + rng.uniform(-100.0, 100.0, 64),
        hall_offset_x_ut=rng.uniform(-200.0, 200.0, 64),
        hall_offset_y_ut=rng.uniform(-200.0, 200.0, 64), hall_drift_x_ut_per_k=2.0,
    )  # fmt: skip
    known = with_parameters(nominal, hall_drift_x_ut_per_k=2.0)
    found = tare(known, simulated(true, temperature=45.0))
    off = [
        (found.frequency_hz - true.parameters["frequency_rest_hz"]) / found.frequency_sigma_hz,
        (found.offset_ut[0] - true.parameters["hall_offset_x_ut"]) / found.offset_sigma_ut[0],
        (found.offset_ut[1] - true.parameters["hall_offset_y_ut"]) / found.offset_sigma_ut[1],
    ]
    assert found.frequency_sigma_hz == pytest.approx(6.0 / np.sqrt(CYCLES), rel=0.2)
    assert found.offset_sigma_ut == pytest.approx(105.0 / np.sqrt(CYCLES), rel=0.2)
    for sigmas in off:
        assert np.sqrt(np.mean(sigmas**2)) == pytest.approx(1.0, abs=0.3)
    assert found.taken.all()
    assert set(found.cycles) == {CYCLES}


def test_zeros_are_applied_without_a_file_and_the_larger_sigma_of_the_field_is_kept():
    skin = dataclasses.replace(calibrated(row_of(4)), tared=np.arange(4) == 1)
    known_ut = np.array([30.0, 0.0, 0.0, 0.0])
    skin = with_parameters(skin, field_sigma_ut=known_ut)
    found = tare(skin, simulated(skin), leave_out=[skin.unit_names[1]])
    sigma_ut = np.array([[1.0, 1.0, 2.0, 1.0], [4.0, 4.0, 1.0, 1.0]])
    beyond_ut = np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]])
    skin_then = dataclasses.replace(found, offset_sigma_ut=sigma_ut).applied(beyond_ut)
    p, before = skin_then.parameters, skin.parameters
    taken = np.array([True, False, True, True])
    assert skin_then.tared.all(), "one was before"
    assert p["field_sigma_ut"].tolist() == [30.0, 0.0, 2.0, 1.0]
    new = {
        "frequency_rest_hz": found.frequency_hz, "hall_offset_x_ut": found.offset_ut[0],
        "hall_offset_y_ut": found.offset_ut[1], "tare_rest_x_ut": beyond_ut[0],
        "tare_rest_y_ut": beyond_ut[1],
    }  # fmt: skip
    for name, value in new.items():
        np.testing.assert_array_equal(p[name], np.where(taken, value, before[name]), name)


def test_units_that_are_off_or_of_another_kind_keep_what_they_have():
    """Nor are they looked at: whatever they read is no fault."""
    skin = row_of(4)
    layout = np.where(np.arange(4) == 2, 1, 0).astype(np.int32)
    foreign = structs.replace(skin.layouts[0], counts_only=True)
    skin = dataclasses.replace(
        skin, enabled=np.array([True, False, True, True]), layouts=(skin.layouts[0], foreign),
        frames=dataclasses.replace(skin.frames, layout=layout),
    )  # fmt: skip
    counts, status = simulated(skin), np.zeros((CYCLES, 4), np.uint16)
    counts[:, FREQUENCY, 1:3] = 9
    for good in range(3):
        status[good:, 1] = Status.LATE
        found = tare(skin, counts, status)
        assert found.taken.tolist() == [True, False, False, True]
        assert np.isnan(found.frequency_hz[1:3]).all()
        status[:] = 0
    assert chosen(skin, ["row/r0c0"]).tolist() == [False, False, False, True]


ALTERNATELY = np.where(np.arange(CYCLES) % 2, 1, -1)
LATER = np.arange(CYCLES) >= CYCLES // 2


def calm(skin, temperature=24.0):
    """Counts of untouched units whose noise is what the model says, one way and the other."""
    counts = simulated(skin, temperature=temperature, noise=False)
    counts[:, FREQUENCY] += 24 * ALTERNATELY[:, np.newaxis]  # 6 Hz
    counts[:, BX:CHIP] += 52 * ALTERNATELY[:, np.newaxis, np.newaxis]  # 104 µT
    return counts


def shaken(channel, least):
    def change(skin, share):
        counts = calm(skin)
        counts[:, channel, 1] = counts[:, channel, 1].mean() + round(least * share) * ALTERNATELY
        return counts

    return change


def shifted(channel, least, when=True):
    def change(skin, share):
        counts = calm(skin)
        counts[:, channel, 1] += np.where(when, round(least * share), 0).astype(np.int16)
        return counts

    return change


def warmed(skin, share):
    return calm(skin, 24.0 + 0.5 * share * LATER[:, np.newaxis])


LIMITS = {
    "noise of the frequency": (shaken(FREQUENCY, 4 * 12.0), "frequency: must have noise"),
    "noise of the field": (shaken(BY, 210.0 / 2), "by: must have noise"),
    "five sigmas of a mean, Hz": (shifted(FREQUENCY, 4 * 2.68, LATER), "frequency: must hold"),
    "five sigmas of a mean, µT": (shifted(BX, 47.0 / 2, LATER), "bx: must hold"),
    "half a degree": (warmed, "temperature: must be steady"),
    "spread and drift": (shifted(FREQUENCY, 4 * 150.07), "frequency: must be within 150.1 Hz"),
    "2 mT": (shifted(BX, 2000.0 / 2), "bx: must be within 2000 µT"),
}
"""What a unit at rest may differ by, and how it is told of more."""


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("limit", LIMITS)
def test_what_is_below_its_limit_is_tared_and_what_is_above_is_refused(limit, way):
    skin = with_parameters(row_of(2), frequency_sigma_hz=52.0)
    change, message = LIMITS[limit]
    tare(skin, change(skin, 0.93 * way))
    with pytest.raises(ScanError) as raised:
        tare(skin, change(skin, 1.07 * way))
    assert str(raised.value).splitlines()[-1].startswith(f"row/r0c1: {message}")


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_limits_of_what_is_known_are_narrower(way):
    """60 Hz from the zero of an earlier tare, 1 mT from the field of known neighbours."""
    tared = with_parameters(row_of(2), frequency_sigma_hz=0.0)
    rest_ut = np.array([[300.0], [-500.0], [0.0]]) * np.ones(2)
    cases = (
        (tared, None, lambda share: shifted(FREQUENCY, 4 * 60.0)(tared, share), "within 60 Hz of"),
        (row_of(2), rest_ut, lambda share: near(share, 0), "bx: must be within 1000 µT of 300 µT"),
        (row_of(2), rest_ut, lambda share: near(share, 1), "by: must be within 1000 µT of -500 µT"),
    )

    def near(share, axis):
        counts = calm(row_of(2))
        counts[:, BX : BZ + 1] += (rest_ut / 2).astype(np.int16)
        counts[:, BX + axis, 1] += round(share * 1000 / 2)
        return counts

    for skin, rest, counts, message in cases:
        tare(skin, counts(0.93 * way), rest_ut=rest)
        with pytest.raises(ScanError, match=message):
            tare(skin, counts(1.07 * way), rest_ut=rest)


@pytest.mark.parametrize("part", [slice(CYCLES // 4, CYCLES * 3 // 4), slice(CYCLES // 4)])
def test_a_touch_in_a_part_of_the_time_is_seen(part):
    """Of the middle, which both halves have alike; 0.02 mm deep."""
    skin = row_of(2)
    counts = calm(skin)
    counts[part, FREQUENCY, 1] -= round(18.0 / abs(skin.scale[FREQUENCY, 1]))
    with pytest.raises(ScanError, match="frequency: must hold still; moved by"):
        tare(skin, counts)


def test_a_hundred_readings_are_enough():
    skin = row_of(2)
    assert tare(skin, calm(skin)[:100]).cycles.tolist() == [100, 100]
    with pytest.raises(ScanError, match="must have 100 good readings or more; got 99"):
        tare(skin, calm(skin)[:99])


def test_readings_all_alike_are_those_of_a_quiet_unit_on_a_coarse_wire():
    """Below a step, noise is not seen, and a mean tells no more than a step does. A step may be
    negative."""
    skin = dataclasses.replace(row_of(2), scale=row_of(2).scale * [1.0, -1.0])
    skin = with_parameters(skin, frequency_noise_hz=0.05, field_noise_ut=np.array([1.9, 0.1]))
    counts = simulated(skin, noise=False)
    found = tare(skin, counts)
    assert found.frequency_sigma_hz == pytest.approx(0.25 / np.sqrt(12.0))
    assert found.offset_sigma_ut == pytest.approx(2.0 / np.sqrt(12.0))
    with pytest.raises(ScanError, match=r"row/r0c0: bx: .* 2.18 µT; got readings all alike"):
        tare(with_parameters(skin, field_noise_ut=np.array([2.1, 0.1])), counts)
    noisy = counts.copy()
    noisy[:, BX, 0] += ALTERNATELY  # 2 µT: the mean of such readings tells more than a step
    noisy[:, BY, 1] += ALTERNATELY > 0  # 1 µT: as half a step does, that rounding makes
    found = tare(skin, noisy)
    assert found.offset_sigma_ut[0, 0] == pytest.approx(2.0 / np.sqrt(CYCLES), rel=2e-3)
    assert found.offset_sigma_ut[1, 1] == pytest.approx(1.0 / np.sqrt(CYCLES), rel=2e-3)


@pytest.mark.parametrize("layout", ["f3t-fd16", "f3t-classic"])
def test_a_warm_skin_has_the_zeros_of_a_cold_one(layout):
    """Offsets are at the chip's reference: its drift comes off, and the field of a film beside the
    chip as weak as film and chip make it. The classic wire tells the gel's temperature alone."""
    skin = with_parameters(
        row_of(2, layout), film_x_mm=0.5, film_y_mm=-0.7, hall_offset_x_ut=150.0,
        hall_offset_y_ut=-90.0, hall_offset_z_ut=400.0, hall_drift_x_ut_per_k=3.0,
        hall_drift_y_ut_per_k=-2.0, hall_drift_z_ut_per_k=5.0, hall_gain_per_k=-0.003,
        hall_reference_c=18.0, film_drift_per_k=-0.004, film_reference_c=33.0,
        gel_current_ratio=5.5, gel_current_20c_ua=27.0, field_noise_ut=20.0,
    )  # fmt: skip
    beside = np.broadcast_to([[0.5], [-0.7]], (CYCLES, 2, 2))
    still, upright = np.zeros((CYCLES, 2)), []
    for gel_c, chip_c in ((25.0, 25.0), (60.0, 60.0), (40.0, 70.0 if skin.wired[CHIP, 0] else 40)):
        units = UnitSimulator(skin, seed=4)
        values = units.quantities(still, beside, still + gel_c, still + gel_c, still + chip_c)
        found = tare(skin, units.quantise(units.disturb(values)))
        assert found.offset_ut == pytest.approx(np.array([[150.0], [-90.0]]) * np.ones(2), abs=9.0)
        gain = (1.0 - 0.004 * (gel_c - 33.0)) * (1.0 - 0.003 * (chip_c - 18.0))
        upright.append(found.axial_ut / gain)  # told as it is, its gains in it
    assert np.ptp(upright, axis=0).max() < 9.0


def test_invalid_units_are_all_named():
    skin = topology.load("fingertip")
    status = np.zeros((CYCLES, skin.n), np.uint16)
    status[:, 3] = Status.FAULT
    status[50:, 5] = Status.LATE
    status[:300, 7] = Status.LATE
    with pytest.raises(ScanError) as raised:
        tare(skin, simulated(skin), status)
    assert str(raised.value).splitlines() == [
        "tip/r1c0: must have 100 good readings or more; got 0 (FAULT)",
        "tip/r1c2: must have 100 good readings or more; got 50 (LATE)",
    ]


def test_neighbours_of_a_curved_skin_are_no_shear():
    """A fingertip's films add up to 1.2 mT to the side of each other's chips."""
    skin = with_parameters(topology.load("fingertip"), hall_offset_x_ut=150.0)
    counts = simulated(skin, field=HalbachField(skin, reach_m=0.1))
    rest_ut = Stencil.of(skin, degree=1).rest_ut
    assert np.abs(rest_ut[:2]).max() > 900.0
    found = tare(skin, counts, rest_ut=rest_ut)
    assert np.abs(found.offset_ut - [[150.0], [0.0]]).max() < 30.0
    counts[:, BX, 0] += 600
    with pytest.raises(ScanError, match=r"tip/r0c0: bx: must be within 1000 µT of -?\d+.* µT"):
        tare(skin, counts, rest_ut=rest_ut)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"counts": np.zeros((5, 6, 12))}, CountsError, "counts: must be an array of int16"),
        ({"counts": np.zeros((6, 12), np.int16)}, CountsError, "shape (100, 6, 12); got"),
        ({"status": np.zeros((4, 12), np.uint16)}, CountsError, "shape (500, 12); got"),
        ({"leave_out": ["tip/r0c9"]}, OptionError, "nearest: 'tip/r0c"),
        (
            {"leave_out": [f"tip/r{r}c{c}" for r in range(4) for c in range(3)]},
            OptionError,
            "must leave a unit",
        ),
    ],
)
def test_wrong_use_is_refused(given, error, message):
    skin = topology.load("fingertip")
    with pytest.raises(error) as raised:
        tare(skin, **{"counts": simulated(skin), **given})
    assert message in str(raised.value)
