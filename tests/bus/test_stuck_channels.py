"""Channels that stand still for longer than their noise allows are stuck."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import topology
from bus.assemble import Assembler
from bus.assemble.stuck_channels import noise_counts, stuck_limits
from bus.codec import Packer
from bus.frame import FrameBatch
from bus.status import Status


def noisy(small, cycles, seed=0, share=1.0):
    """Counts of working units at rest, shape (t, c, n): noise of each channel about the middle."""
    noise = share * noise_counts(small)
    rng = np.random.default_rng(seed)
    counts = 2000.0 + noise * rng.standard_normal((cycles, *noise.shape))
    return np.rint(counts).astype(np.int16)


def stuck_by(small, counts):
    """`stuck` of every cycle, shape (t, n)."""
    packer, batch, assembler = (
        Packer(small),
        FrameBatch(2 * len(small.frames) + 1),
        Assembler(small),
    )
    found = []
    for number, each in enumerate(counts):
        batch.clear()
        batch.append(small.sync_id, bytes([number & 0xFF]))
        packer(each, batch, sequence=number & 0xFF)
        for cycle in assembler.feed(batch.frames):
            found.append(cycle.stuck.copy())
            frozen = cycle.status & int(Status.FROZEN) != 0
            assert (frozen == (cycle.stuck != 0)).all()
            assert not cycle.valid[frozen].any()
    return np.array(found)


@pytest.mark.parametrize("band", [0, 1])
@pytest.mark.parametrize("channel", range(5))
def test_a_channel_that_stands_still_is_stuck_though_the_others_move(channel, band):
    """Within the band too, and only until it moves; the watch is of readings, so 50 of them."""
    palm = topology.load("palm")
    counts = noisy(palm, 700)
    turns = np.arange(400) % 2 * band
    counts[100:500, channel, 7] = counts[100, channel, 7] + turns
    stuck = stuck_by(palm, counts)
    first = 100 + int(stuck_limits(palm)[1][channel, 7])
    assert (stuck[first:500, 7] == 1 << channel).all()
    assert not stuck[: first - 2].any()
    assert not stuck[501:].any()
    assert not np.delete(stuck, 7, axis=1).any()


def test_a_unit_that_never_freezes_is_not_watched_nor_are_channels_without_noise():
    palm = topology.load("palm")
    _, cycles = stuck_limits(palm)
    assert (cycles[5] == 0).all()
    assert (cycles[:5] >= 50).all()
    parameters = palm.parameters | {"frozen_cycles": np.zeros(palm.n)}
    assert not stuck_limits(replace(palm, parameters=parameters))[1].any()
    parameters = palm.parameters | {"field_noise_ut": np.full(palm.n, 0.01)}
    _, cycles = stuck_limits(replace(palm, parameters=parameters))
    assert (cycles[2:5] == 0).all()
    assert (cycles[:2] > 0).all()


@pytest.mark.parametrize("share", [0.5, 1.0])
@pytest.mark.parametrize("skin", ["palm", "strip"])
def test_noise_is_stuck_no_more_often_than_is_said(skin, share, monkeypatch):
    """Of a skin that may be so often that it can be counted; noise of a half of what is stated is
    what the times are made for."""
    small = topology.load(skin)
    parameters = small.parameters | {"frozen_cycles": np.full(small.n, 6.0)}
    small, cycles = replace(small, parameters=parameters), 2000
    days = cycles / small.cycle_rate_hz / 86400.0
    monkeypatch.setattr("bus.assemble.stuck_channels.FALSE_ALARMS_PER_DAY", 200.0 / days)
    watched = stuck_limits(small)[1] > 0
    stuck = stuck_by(small, noisy(small, cycles, seed=3, share=share))

    alarms = sum(int(((stuck >> c & 1)[1:] > (stuck >> c & 1)[:-1]).sum()) for c in range(5))
    expected = 200.0 * watched.sum() / watched.size
    assert alarms < 1.3 * expected + 3.0 * np.sqrt(expected)
    if share == 0.5:
        assert alarms > 0.02 * expected
