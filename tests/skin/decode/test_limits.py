"""Ranges of counts by which units are flagged, where the wire ends before they do."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bus.status import Status
from skin.decode.limits import clipped
from tests.fixtures.decode import row_of, sine

GEL, FREQUENCY, BX, BY, BZ, CHIP = range(6)


def shifted(channel, at):
    """A unit at rest, whose counts of one channel are `at` by another offset of the wire."""
    skin = row_of(1)
    raw = np.array([1430, 18000, 0, 0, 0, 0], np.int16)[:, np.newaxis]
    offset = skin.offset.copy()
    offset[channel] += skin.scale[channel] * (raw[channel] - float(at))
    raw[channel] = at
    return dataclasses.replace(skin, offset=offset), raw


@pytest.mark.parametrize("channel", [GEL, FREQUENCY, CHIP])
@pytest.mark.parametrize("end", [-32768, 32767])
def test_a_range_may_go_on_beyond_what_the_wire_carries(channel, end):
    inside = end + (60 if end < 0 else -60)
    if channel == CHIP:
        inside = 60 if end > 0 else -60  # eight bits
    skin, raw = shifted(channel, inside)
    assert sine(skin)(raw).status[0] == Status.OK


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_scale_may_be_negative(way):
    """The ends of a range are then the other way round."""
    skin = row_of(3)
    scale = skin.scale.copy()
    scale[[GEL, FREQUENCY, CHIP]] *= way
    skin = dataclasses.replace(skin, scale=scale)
    raw = np.array([1430, 18000, 0, 0, 0, 0], np.int16)[:, np.newaxis] * np.ones(3, np.int16)
    raw[FREQUENCY] += np.array([0, 4 * 37, -4 * 1801], np.int16)  # pulled, too deep
    raw[[GEL, FREQUENCY, CHIP]] *= int(way)
    found = sine(skin)(raw).status.astype(int) & ~int(Status.SATURATED)
    assert found.tolist() == [0, Status.EXTRAPOLATED, Status.EXTRAPOLATED]


@pytest.mark.parametrize(("channel", "value"), [(GEL, 13.0), (FREQUENCY, 4500.0), (CHIP, 55.0)])
@pytest.mark.parametrize("count", [-60, 0, 60])
def test_steps_may_be_so_fine_that_all_counts_are_possible(channel, value, count):
    """A thousandth of the usual ones: no count is out of a range that is wider than 16 bits."""
    skin = row_of(1)
    scale, offset = skin.scale.copy(), skin.offset.copy()
    scale[channel] *= 1e-3
    offset[channel] = value - scale[channel] * count
    skin = dataclasses.replace(skin, scale=scale, offset=offset)
    raw = np.array([1430, 18000, 0, 0, 0, 0], np.int16)[:, np.newaxis]
    raw[channel] = count
    assert sine(skin)(raw).status[0] == Status.OK


@pytest.mark.parametrize("offset_hz", [20_000.0, -20_000.0])
@pytest.mark.parametrize("count", [-32000, 0, 32000])
def test_a_range_that_the_wire_does_not_reach_holds_no_count(offset_hz, count):
    """Frequencies of more than 12 kHz, or below zero."""
    skin = row_of(1)
    offset = skin.offset.copy()
    offset[FREQUENCY] = offset_hz
    raw = np.array([1430, count, 0, 0, 0, 0], np.int16)[:, np.newaxis]
    status = sine(dataclasses.replace(skin, offset=offset))(raw).status[0]
    assert status & Status.OUT_OF_RANGE
    assert status & Status.EXTRAPOLATED


@pytest.mark.parametrize(
    ("finer", "channel"), [(1.0, None), (0.1, GEL), (-0.1, FREQUENCY), (0.02, BZ), (0.02, BX)]
)
def test_signals_that_end_before_a_working_unit_does_are_named(finer, channel):
    """Those of lateral fields never are: how far a face is sheared is up to its load."""
    skin = row_of(3)
    scale = skin.scale.copy()
    if channel is not None:
        scale[channel, 1] *= finer
    found = clipped(dataclasses.replace(skin, scale=scale))
    expected = {GEL: "gel", FREQUENCY: "frequency", BZ: "bz"}.get(channel)
    assert {name: units.tolist() for name, units in found.items()} == (
        {} if expected is None else {expected: [False, True, False]}
    )
