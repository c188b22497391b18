"""What each kind of fault does to the frames that pass, in the order of the bus; and the injector.

What was done is counted by kind, so that a test can hold it against what the receiver has counted.
Which frames are hit depends on the seed and on the frames alone, not on how they fall into batches,
nor, where the script goes by a scene's time, on how fast the machine is. A frame that a fault has
put in is never hit by another, so that what comes out is bounded by what went in.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bus.faults import script as kinds
from bus.faults.script import Fault, FaultScript, check_script
from bus.frame import (
    CAN_EFF,
    CAN_ERR,
    CAN_RTR,
    ECHO,
    FD_LENGTHS,
    FRAME_DTYPE,
    PAYLOAD,
    as_bytes,
    views,
)
from bus.table import FrameTable
from topology import CHANNELS, Topology

__all__ = ["Injector", "Payloads"]

_INJECTED = 0x80
"""Bit of `origin`, between stages only: a fault has made this frame."""


class Payloads:
    """Writes other counts into data frames of one bus of a topology."""

    def __init__(self, topology: Topology, index: int) -> None:
        from bus.codec_kernels import pack, read_bits, unpack_frame  # compiled

        self._pack, self._read_bits, self._unpack = pack, read_bits, unpack_frame
        self._tables = FrameTable(topology).tables
        self._rows: dict[int, list[int]] = {}
        for f in np.flatnonzero(topology.frames.bus == index).tolist():
            self._rows.setdefault(int(topology.frames.can_id[f]), []).append(f)
        self._counts = np.zeros((len(CHANNELS), topology.n), np.int16)
        self._codes = np.zeros(topology.n, np.uint8)
        self._made = np.zeros(1, FRAME_DTYPE)

    def rewrite(
        self,
        record: np.ndarray,
        wrong: Callable[[int, np.ndarray, np.ndarray, np.ndarray], np.ndarray | None],
        offset: int = 0,
    ) -> bool:
        """Change the counts of a record, shape (1,), add `offset` to its sequence number, and write
        the CRC that fits; whether that was done.

        `wrong` takes the frame of the topology, and channel, unit and value of each of its counts,
        shape (k,); it returns the values to send, or None to leave the record as it is. A record
        that is cut, or no frame of the topology, stays as it is, too.
        """
        f = self._find(record)
        if f is None:
            return False
        expected, data = self._tables.frames[f], as_bytes(record)
        signals = self._tables.signals[expected["first_channel"] : expected["first_status"]]
        places = signals["target"], signals["unit"]
        self._codes[:] = 0
        self._unpack(data, 0, f, self._tables, self._counts.reshape(-1), self._codes)
        sent = wrong(f, *places, self._counts[places])
        if sent is None:
            return False
        self._counts[places] = sent
        field = expected["sequence"]
        sequence = int(self._read_bits(data, 0, field)) + offset if field["mask"] else 0
        made = views(self._made)
        self._pack(f, f + 1, sequence, 0, self._counts, self._codes, self._tables, made)
        data[0, PAYLOAD:] = made.data[0, PAYLOAD:]
        return True

    def _find(self, record: np.ndarray) -> int | None:
        for f in self._rows.get(int(record["id"][0]), ()):
            expected = self._tables.frames[f]
            if not expected["pages"] or expected["page"] == record["data"][0, 0]:
                return f if record["length"][0] == expected["size"] else None
        return None


class _Stage:
    """One fault of a script on one bus: which frames it hits, and how often it has struck."""

    def __init__(
        self, fault: Fault, topology: Topology | None, index: int, rng: np.random.Generator
    ) -> None:
        self.fault: Any = fault
        self.kind = str(fault.__struct_config__.tag)
        self.injected = 0
        self.rng = rng
        self.held = np.zeros(0, FRAME_DTYPE)
        """Delayed frames."""
        self.last: dict[int, np.ndarray] = {}
        """Counts of frozen frames."""
        self.payloads: Any = None
        if isinstance(fault, kinds.NEEDS_TOPOLOGY) and topology is not None:
            self.payloads = Payloads(topology, index)
        self._chance = rng.spawn(1)[0]
        self._units: list[int] | None = None
        """Those that the fault names; None for all."""
        self._ids = self._targets(topology, index)
        self._passed = self._hits = 0
        self._origin_ns: int | None = None
        once = fault.at_s is not None and fault.count is None
        self._most = 1 if once else fault.count
        self._from_s = fault.from_s if fault.at_s is None else fault.at_s

    def __call__(self, frames: np.ndarray, now_ns: int | None = None) -> np.ndarray:
        """Do what the fault is to frames: at `now_ns`, all of them, or at their stamps if None."""
        if not frames.size:
            return frames
        times_ns = frames["stamp_ns"] if now_ns is None else np.full(frames.size, now_ns)
        if self._origin_ns is None:
            self._origin_ns = int(times_ns[0])
        return ACTS[type(self.fault)](self, frames, self._select(frames, times_ns))

    def matches(self, frames: np.ndarray) -> np.ndarray:
        """Which frames are among those of this fault, at any time; shape (m,), bool."""
        found = (frames["id"] & np.uint32(CAN_ERR | CAN_RTR)) == 0
        found &= (frames["origin"] & (ECHO | _INJECTED)) == 0
        if self._ids is not None:
            found &= np.isin(frames["id"], self._ids)
        return found

    def strikes(self, channels: np.ndarray, units: np.ndarray) -> np.ndarray:
        """Which counts of a frame the fault changes; shape (k,), bool."""
        struck = units >= 0 if self._units is None else np.isin(units, self._units)
        channel = getattr(self.fault, "channel", None)
        return struck if channel is None else struck & (channels == CHANNELS.index(channel))

    def _targets(self, topology: Topology | None, index: int) -> np.ndarray | None:
        """Identifiers of the frames of this fault; None for all."""
        fault = self.fault
        ids = [can_id | (CAN_EFF if can_id > 0x7FF else 0) for can_id in fault.ids]
        if topology is None:
            return np.array(ids, np.uint32) if ids else None
        if fault.bus not in (None, topology.buses[index].name):
            return np.zeros(0, np.uint32)
        carries = topology.frames.units >= 0
        if fault.units:
            patches = np.array(topology.patch_names)[topology.patch]
            is_named = np.isin(topology.unit_names, fault.units) | np.isin(patches, fault.units)
            self._units = np.flatnonzero(is_named).tolist()
            carries &= np.isin(topology.frames.units, self._units)
        if fault.units or not ids:
            here = (topology.frames.bus == index) & carries.any(axis=1)
            ids += topology.frames.can_id[here].tolist()
        return np.array(ids, np.uint32)

    def _select(self, frames: np.ndarray, times_ns: np.ndarray) -> np.ndarray:
        """Rows that the fault hits."""
        fault = self.fault
        found = self.matches(frames)
        time_s = 1e-9 * (times_ns.astype(np.float64) - (self._origin_ns or 0))
        found &= time_s >= self._from_s
        if fault.to_s is not None:
            found &= time_s < fault.to_s
        rows = np.flatnonzero(found)
        if fault.probability is not None:
            rows = rows[self._chance.random(rows.size) < fault.probability]
        elif fault.every is not None:
            turn = self._passed + 1 + np.arange(rows.size)
            self._passed += rows.size
            rows = rows[turn % fault.every == 0]
        if self._most is not None:
            rows = rows[: self._most - self._hits]
        self._hits += rows.size
        return rows


# -- what each kind does to frames at the rows `hits`: it returns the frames that go on ------------


def _withhold(stage: _Stage, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
    stage.injected += hits.size
    return np.delete(frames, hits)


def _delay(stage: _Stage, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
    late = frames[hits]
    late["stamp_ns"] += round(stage.fault.delay_s * 1e9)
    held, known = np.concatenate([stage.held, late]), stage.held.size
    stage.injected += hits.size
    is_hit = np.zeros(frames.size, bool)
    is_hit[hits] = True
    out, first = [], 0
    for i, stamp_ns in enumerate(frames["stamp_ns"].tolist()):
        while first < known and held["stamp_ns"][first] <= stamp_ns:
            out.append(held[first : first + 1])
            first += 1
        if is_hit[i]:
            known += 1
        else:
            out.append(frames[i : i + 1])
    stage.held = held[first:]
    return np.concatenate(out) if out else frames[:0]


def _corrupt(stage: _Stage, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
    for i in hits:
        size = 8 * min(int(frames["length"][i]), 64)
        if not size:
            continue
        for bit in stage.rng.choice(size, min(stage.fault.bits, size), replace=False):
            frames["data"][i, bit // 8] ^= np.uint8(1 << (bit % 8))
        stage.injected += 1
    return frames


def _truncate(stage: _Stage, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
    for i in hits:
        shorter = [length for length in FD_LENGTHS if length < frames["length"][i]]
        if stage.fault.length is not None:
            shorter = [length for length in shorter if length == stage.fault.length]
        if shorter:
            frames["length"][i] = shorter[stage.rng.integers(len(shorter))]
            stage.injected += 1
    return frames


def _freeze(stage: _Stage, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
    hit = set(hits.tolist())
    for i in np.flatnonzero(stage.matches(frames)).tolist():

        def wrong(f, channels, units, counts, is_hit=i in hit):
            struck = stage.strikes(channels, units)
            if is_hit and f in stage.last and struck.any():
                return np.where(struck, stage.last[f], counts)
            stage.last[f] = counts
            return None

        stage.injected += stage.payloads.rewrite(frames[i : i + 1], wrong)
    return frames


def _wrong_channel(stage: _Stage, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
    def wrong(_f, channels, units, counts):
        struck = stage.strikes(channels, units)
        match stage.fault:
            case kinds.Gain(gain=gain):
                sent = np.round(gain * counts.astype(float))
            case kinds.Offset(counts=more):
                sent = counts.astype(float) + more
            case kinds.Stuck(counts=value):
                sent = np.full(counts.shape, value)
        return np.where(struck, np.clip(sent, -32768, 32767), counts) if struck.any() else None

    for i in hits:
        stage.injected += stage.payloads.rewrite(frames[i : i + 1], wrong)
    return frames


def _babble(stage: _Stage, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
    can_id = stage.fault.id | (CAN_EFF if stage.fault.id > 0x7FF else 0)
    made = _bare(frames[np.repeat(hits, stage.fault.copies)], can_id)
    made["data"][:, :8] = stage.rng.integers(0, 256, (made.size, 8), np.uint8)
    return _put_in(stage, frames, np.repeat(hits, stage.fault.copies), made)


def _duplicate(stage: _Stage, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
    def wrong(_f, _channels, _units, counts):
        return counts ^ (1 | stage.rng.integers(0, 16, counts.size, np.int16))

    twins = frames[hits]
    made = [stage.payloads.rewrite(twins[i : i + 1], wrong, stage.fault.offset)
            for i in range(hits.size)]  # fmt: skip
    return _put_in(stage, frames, hits[made], twins[made], is_before=stage.fault.first)


def _error(stage: _Stage, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
    error_class, data = kinds.ERRORS[stage.fault.what]
    made = _bare(frames[hits], CAN_ERR | error_class)
    made["data"][:, :8] = np.frombuffer(data, np.uint8)
    return _put_in(stage, frames, hits, made)


def _bare(frames: np.ndarray, can_id: int) -> np.ndarray:
    """Classic frames of eight bytes, of the time and the bus of others."""
    frames["id"], frames["length"], frames["flags"], frames["data"] = can_id, 8, 0, 0
    return frames


def _put_in(
    stage: _Stage, frames: np.ndarray, rows: np.ndarray, made: np.ndarray, is_before: bool = False
) -> np.ndarray:
    """Add frames, each after the one at its row, or before it."""
    made["origin"] |= _INJECTED
    stage.injected += made.size
    return np.insert(frames, rows + (not is_before), made)


ACTS: dict[type[Fault], Callable[[_Stage, np.ndarray, np.ndarray], np.ndarray]] = {
    kinds.Drop: _withhold,
    kinds.Kill: _withhold,
    kinds.Delay: _delay,
    kinds.Corrupt: _corrupt,
    kinds.Truncate: _truncate,
    kinds.Freeze: _freeze,
    kinds.Gain: _wrong_channel,
    kinds.Offset: _wrong_channel,
    kinds.Stuck: _wrong_channel,
    kinds.Babble: _babble,
    kinds.Duplicate: _duplicate,
    kinds.Error: _error,
}


class Injector:
    """Frames in, the same with faults out; for live frames and those of a log.

    Parameters
    ----------
    script : FaultScript
    seed : int, optional
        In place of the script's own.
    topology : Topology, optional
        The skin.
    index : int
        Bus of the topology whose frames these are.
    clock : callable, optional
        Gives the time, in ns, by which the script goes, asked for once for each call. If not given,
        the script goes by the stamps of the frames.

    Attributes
    ----------
    injected : dict of str to int
        How often each kind has struck: frames withheld, changed, moved or put in.
    """

    def __init__(
        self,
        script: FaultScript,
        seed: int | None = None,
        topology: Topology | None = None,
        *,
        index: int = 0,
        clock: Callable[[], int] | None = None,
    ) -> None:
        check_script(script, topology)
        self._clock = clock
        seed = script.seed if seed is None else seed
        self._stages = [
            _Stage(fault, topology, index, np.random.default_rng([seed, index, i]))
            for i, fault in enumerate(script.faults)
        ]

    @property
    def injected(self) -> dict[str, int]:
        """How often each kind has struck so far."""
        found = dict.fromkeys((stage.kind for stage in self._stages), 0)
        for stage in self._stages:
            found[stage.kind] += stage.injected
        return found

    def __call__(self, records: np.ndarray) -> np.ndarray:
        """Pass frames of one bus on, in its order.

        Parameters
        ----------
        records : ndarray, shape (m,), FRAME_DTYPE

        Returns
        -------
        ndarray, shape (k,), FRAME_DTYPE
            A copy.
        """
        frames = np.array(records, FRAME_DTYPE)
        frames["origin"] &= ECHO
        unstamped = frames["stamp_ns"] == 0
        if unstamped.any():
            frames["stamp_ns"][unstamped] = time.time_ns()
        now_ns = None if self._clock is None else self._clock()
        for stage in self._stages:
            frames = stage(frames, now_ns)
        frames["origin"] &= ECHO
        return frames
