"""Random and mutated frames, assembled and decoded: nothing raises, nothing lies, all count."""

from __future__ import annotations

import resource
from dataclasses import asdict

import numpy as np
import pytest

import topology
from bus.assemble import Assembler
from bus.codec import Packer
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, FRAME_DTYPE, FrameBatch
from bus.status import INVALID, Status
from skin.decode.decoder import Decoder

NOT_FRAMES = {"lost", "controller_overflow"}
"""Counters of what is not a received frame, or of one that another counter has."""


def frames_of(skin, cycles, rng):
    """Real frames of a skin with SYNC, of random counts."""
    pack, batch = Packer(skin), FrameBatch((len(skin.frames) + len(skin.buses)) * cycles)
    for cycle in range(cycles):
        for index in range(len(skin.buses)):
            batch.append(skin.sync_id, bytes([cycle & 0xFF]), bus=index, stamp_ns=cycle * 4_000_000)
        counts = rng.integers(-32768, 32768, (6, skin.n)).astype(np.int16)
        pack(counts, batch, sequence=cycle & 0xFF, stamp_ns=cycle * 4_000_000)
    return batch.frames.copy()


def mutate(frames, rng):
    """A third of the frames damaged in every way that a bus, a driver or a lie can think of."""
    frames = frames.copy()
    size = frames.size
    raw = frames.view(np.uint8).reshape(size, FRAME_DTYPE.itemsize)

    def some(share):
        return rng.random(size) < share

    hit = some(0.05)
    frames["data"][hit] = rng.integers(0, 256, (hit.sum(), 64))
    hit = some(0.05)
    frames["id"][hit] = rng.integers(0, 1 << 32, hit.sum())
    hit = some(0.05)
    frames["length"][hit] = rng.integers(0, 256, hit.sum())
    hit = some(0.05)
    frames["flags"][hit] = rng.integers(0, 256, hit.sum())
    for bit in (CAN_EFF, CAN_RTR, CAN_ERR):
        frames["id"][some(0.02)] ^= np.uint32(bit)
    hit = some(0.02)
    frames["origin"][hit] = rng.integers(0, 256, hit.sum())
    hit = some(0.02)
    frames["bus"][hit] = rng.integers(0, 256, hit.sum())
    hit = some(0.02)
    frames["stamp_ns"][hit] = rng.integers(-(1 << 62), 1 << 62, hit.sum())
    hit = np.flatnonzero(some(0.02))
    raw[hit, rng.integers(0, raw.shape[1], hit.size)] ^= np.uint8(1) << rng.integers(
        0, 8, hit.size, dtype=np.uint8
    )
    hit = np.flatnonzero(some(0.05))
    frames[hit] = frames[rng.integers(0, size, hit.size)]
    return frames


def memory_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def flood(name, total, seed):
    """Feed `total` frames; return the peak of memory after a tenth of them, and at the end."""
    rng = np.random.default_rng(seed)
    skin = topology.load(name)
    assembler, decoder = Assembler(skin), Decoder(skin, sweeps=0, ambient=False)
    whole = frames_of(skin, 256, rng)
    fed, early = 0, 0.0
    while fed < total:
        frames = mutate(whole, rng)[: total - fed]
        fed += frames.size
        for cycle in assembler.feed(frames):
            reading = decoder(cycle.counts, cycle.status)
            sound = (reading.status & int(INVALID | Status.NEVER)) == 0
            assert np.array_equal(sound, reading.valid)
            assert np.isfinite(reading.force[:, sound]).all()
            assert np.isfinite(reading.temperature[sound]).all()
            assert not (reading.valid & ~cycle.valid).any()
        if early == 0.0 and fed >= total / 10:
            early = memory_mb()
    counted = asdict(assembler.counters)
    assert sum(count for kind, count in counted.items() if kind not in NOT_FRAMES) == total
    assert counted["data"] > 0.3 * total
    for kind in ("crc", "short", "foreign", "remote", "error", "echo", "repeated", "late"):
        assert counted[kind] > 0 or (kind == "crc" and name == "strip"), kind
    return early, memory_mb()


@pytest.mark.parametrize("name", ["palm", "strip", "hand"])
def test_hundred_thousand_frames_of_any_content(name):
    flood(name, 100_000, seed=1)


@pytest.mark.long
@pytest.mark.parametrize("name", ["palm", "strip", "hand"])
def test_ten_million_frames_of_any_content_leave_memory_flat(name):
    early, late = flood(name, 10_000_000, seed=2)
    assert late < early + 20.0
