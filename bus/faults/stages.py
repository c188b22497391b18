"""Stages: what each kind of fault does to the frames that pass, in the order of the bus."""

from __future__ import annotations

from collections import deque

import numpy as np

from bus.faults import script as kinds
from bus.faults.payload import ExpectedFrame, count_in, flip, frames_of, put_count
from bus.faults.script import Fault
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, ECHO, FD_LENGTHS
from topology import Topology

__all__ = ["STAGES"]

_INJECTED = 0x80
"""Bit of `origin`, between stages only: a fault has made this frame."""
_MOST_HELD = 65536
"""Delayed frames that are kept; beyond, the oldest one goes."""


class _Stage:
    """One fault of a script: which frames it hits, and, in the subclasses, what it does to them."""

    def __init__(
        self, fault: Fault, topology: Topology | None, index: int, rng: np.random.Generator
    ) -> None:
        self.fault = fault
        self.kind = str(fault.__struct_config__.tag)
        self.injected = 0
        self.rng = rng
        self._chance = rng.spawn(1)[0]
        self._frames = {} if topology is None else frames_of(topology, index)
        self._ids = self._targets(topology, index)
        self._passed = self._hits = 0
        self._origin_ns = 0
        self._has_begun = False
        once = fault.at_s is not None and fault.count is None
        self._most = 1 if once else fault.count
        self._from_s = fault.from_s if fault.at_s is None else fault.at_s

    def __call__(self, frames: np.ndarray, now_ns: int | None = None) -> np.ndarray:
        """Do what the fault is to frames: at `now_ns`, all of them, or at their stamps if None."""
        if not frames.size:
            return frames
        times_ns = frames["stamp_ns"] if now_ns is None else np.full(frames.size, now_ns)
        if not self._has_begun:
            self._has_begun, self._origin_ns = True, int(times_ns[0])
        return self.apply(frames, self._select(frames, times_ns))

    def apply(self, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
        """Do to `frames`, at the rows `hits`, what the fault is."""
        raise NotImplementedError

    def frame_of(self, record: np.void) -> ExpectedFrame | None:
        """What the topology says of a frame."""
        for expected in self._frames.get(int(record["id"]), ()):
            if expected.page is None or expected.page == record["data"][0]:
                return expected
        return None

    def units_in(self, expected: ExpectedFrame) -> list[int]:
        """Slots of a frame that hold units of this fault: all, unless units are named."""
        named = self._units
        return [s for s, unit in enumerate(expected.units) if named is None or unit in named]

    def matches(self, frames: np.ndarray) -> np.ndarray:
        """Which frames are among those of this fault, at any time; shape (m,), bool."""
        found = (frames["id"] & np.uint32(CAN_ERR | CAN_RTR)) == 0
        found &= (frames["origin"] & (ECHO | _INJECTED)) == 0
        if self._ids is not None:
            found &= np.isin(frames["id"], self._ids)
        return found

    def _targets(self, topology: Topology | None, index: int) -> np.ndarray | None:
        fault = self.fault
        self._units: set[int] | None = None
        if topology is not None and fault.bus not in (None, topology.buses[index].name):
            return np.zeros(0, np.uint32)
        ids = [can_id | (CAN_EFF if can_id > 0x7FF else 0) for can_id in fault.ids]
        if fault.units and topology is not None:
            patches = np.array(topology.patch_names)[topology.patch]
            is_named = np.isin(topology.unit_names, fault.units) | np.isin(patches, fault.units)
            self._units = set(np.flatnonzero(is_named).tolist())
        if fault.units or (topology is not None and not ids):
            for can_id, parts in self._frames.items():
                if any(self.units_in(expected) for expected in parts):
                    ids.append(can_id)
        return np.array(ids, np.uint32) if ids or topology is not None else None

    def _select(self, frames: np.ndarray, times_ns: np.ndarray) -> np.ndarray:
        """Rows that the fault hits."""
        fault = self.fault
        found = self.matches(frames)
        time_s = 1e-9 * (times_ns.astype(np.float64) - self._origin_ns)
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


class _Withhold(_Stage):
    def apply(self, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
        self.injected += hits.size
        return np.delete(frames, hits)


class _Delay(_Stage):
    def __init__(self, fault: kinds.Delay, *rest) -> None:
        super().__init__(fault, *rest)
        self._held: deque[np.ndarray] = deque()
        self._delay_ns = round(fault.delay_s * 1e9)

    def apply(self, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
        if not hits.size and not self._held:
            return frames
        is_hit = np.zeros(frames.size, bool)
        is_hit[hits] = True
        out = []
        for i in range(frames.size):
            frame = frames[i : i + 1]
            while self._held and self._held[0]["stamp_ns"][0] <= frame["stamp_ns"][0]:
                out.append(self._held.popleft())
            if not is_hit[i]:
                out.append(frame)
                continue
            later = frame.copy()
            later["stamp_ns"] += self._delay_ns
            self._held.append(later)
            if len(self._held) > _MOST_HELD:
                out.append(self._held.popleft())
        self.injected += hits.size
        return np.concatenate(out) if out else frames[:0]


class _Corrupt(_Stage):
    fault: kinds.Corrupt

    def apply(self, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
        for i in hits:
            size = 8 * min(int(frames["length"][i]), 64)
            if not size:
                continue
            bits = self.rng.choice(size, min(self.fault.bits, size), replace=False)
            for bit in bits:
                frames["data"][i, bit // 8] ^= np.uint8(1 << (bit % 8))
            self.injected += 1
        return frames


class _Truncate(_Stage):
    fault: kinds.Truncate

    def apply(self, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
        for i in hits:
            shorter = [length for length in FD_LENGTHS if length < frames["length"][i]]
            if self.fault.length is not None:
                shorter = [length for length in shorter if length == self.fault.length]
            if shorter:
                frames["length"][i] = shorter[self.rng.integers(len(shorter))]
                self.injected += 1
        return frames


class _InPlace(_Stage):
    """Faults that write into whole frames of the topology."""

    def apply(self, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
        is_hit = np.zeros(frames.size, bool)
        is_hit[hits] = True
        for i in np.flatnonzero(self.matches(frames)):
            expected = self.frame_of(frames[i])
            if expected is None or frames["length"][i] != expected.layout.size:
                continue
            data = frames["data"][i]
            if self.strike(data, expected, is_hit=bool(is_hit[i])):
                expected.seal(data)
                self.injected += 1
        return frames

    def strike(self, data: np.ndarray, expected: ExpectedFrame, *, is_hit: bool) -> bool:
        """Write into a frame if it is hit; whether that was done. Asked for each frame."""
        raise NotImplementedError


class _Freeze(_InPlace):
    def __init__(self, *given) -> None:
        super().__init__(*given)
        self._last: dict[tuple[int, int | None], np.ndarray] = {}

    def strike(self, data: np.ndarray, expected: ExpectedFrame, *, is_hit: bool) -> bool:
        key = expected.can_id, expected.page
        if not is_hit or key not in self._last:
            self._last[key] = data.copy()
            return False
        held = expected.counts_of(self.units_in(expected))
        data[:] = (data & ~held) | (self._last[key] & held)
        return True


class _Wrong(_InPlace):
    """Faults that write other counts."""

    fault: kinds.Gain | kinds.Offset | kinds.Stuck

    def strike(self, data: np.ndarray, expected: ExpectedFrame, *, is_hit: bool) -> bool:
        size, slots = expected.layout.size, self.units_in(expected)
        struck = [
            signal
            for signal in expected.channels
            if signal.slot in slots and self.fault.channel in (None, signal.name)
        ]
        for signal in struck if is_hit else ():
            put_count(data, signal, size, self.wrong(count_in(data, signal, size)))
        return is_hit and bool(struck)

    def wrong(self, count: int) -> int:
        """What is sent in place of a count."""
        match self.fault:
            case kinds.Gain(gain=gain):
                return round(gain * count)
            case kinds.Offset(counts=counts):
                return count + counts
        return self.fault.counts


class _PutIn(_Stage):
    """Faults that add frames: after those that they hit, with the same stamp."""

    def apply(self, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
        if not hits.size:
            return frames
        made = [self.make(frames[i : i + 1]) for i in hits]
        new = np.concatenate(made)
        new["origin"] |= _INJECTED
        self.injected += new.size
        place = np.repeat(2 * hits + self.side(), [part.size for part in made])
        order = np.argsort(np.concatenate([2 * np.arange(frames.size), place]), kind="stable")
        return np.concatenate([frames, new])[order]

    def side(self) -> int:
        """1: after the frame that is hit; -1: before it."""
        return 1

    def make(self, frame: np.ndarray) -> np.ndarray:
        """The frames to add to `frame`, shape (1,)."""
        raise NotImplementedError


class _Babble(_PutIn):
    fault: kinds.Babble

    def make(self, frame: np.ndarray) -> np.ndarray:
        can_id = self.fault.id | (CAN_EFF if self.fault.id > 0x7FF else 0)
        made = _bare(frame, can_id, 8, self.fault.copies)
        made["data"][:, :8] = self.rng.integers(0, 256, (made.size, 8), np.uint8)
        return made


class _Duplicate(_PutIn):
    fault: kinds.Duplicate

    def side(self) -> int:
        return -1 if self.fault.first else 1

    def make(self, frame: np.ndarray) -> np.ndarray:
        expected = self.frame_of(frame[0])
        if expected is None or frame["length"][0] != expected.layout.size:
            return frame[:0]
        twin = frame.copy()
        data = twin["data"][0]
        for signal in expected.channels:
            flip(data, signal, expected.layout.size, 1 | int(self.rng.integers(16)))
        expected.count_on(data, self.fault.offset)
        expected.seal(data)
        return twin


class _Error(_PutIn):
    fault: kinds.Error

    def make(self, frame: np.ndarray) -> np.ndarray:
        error_class, data = kinds.ERRORS[self.fault.what]
        made = _bare(frame, CAN_ERR | error_class, 8)
        made["data"][0, :8] = np.frombuffer(data, np.uint8)
        return made


def _bare(frame: np.ndarray, can_id: int, length: int, copies: int = 1) -> np.ndarray:
    """Classic frames of the time and the bus of another one."""
    made = np.repeat(frame, copies)
    made["id"], made["length"] = can_id, length
    made["flags"] = 0
    made["data"] = 0
    return made


STAGES: dict[type[Fault], type[_Stage]] = {
    kinds.Drop: _Withhold,
    kinds.Kill: _Withhold,
    kinds.Delay: _Delay,
    kinds.Corrupt: _Corrupt,
    kinds.Truncate: _Truncate,
    kinds.Freeze: _Freeze,
    kinds.Gain: _Wrong,
    kinds.Offset: _Wrong,
    kinds.Stuck: _Wrong,
    kinds.Babble: _Babble,
    kinds.Duplicate: _Duplicate,
    kinds.Error: _Error,
}
