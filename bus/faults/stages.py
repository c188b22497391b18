"""What each kind of fault does to the frames that pass, in the order of the bus; and the injector.

What was done is counted by kind, so that a test can hold it against what the receiver has counted.
Which frames are hit depends on the seed and on the frames alone, not on how they fall into batches,
nor, where the script goes by a scene's time, on how fast the machine is. A frame that a fault has
put in is never hit by another, so that what comes out is bounded by what went in.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from functools import cached_property

import numpy as np

from bus.faults import script as kinds
from bus.faults.payload import Payloads
from bus.faults.script import Fault, FaultScript, check_script
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, ECHO, FD_LENGTHS, FRAME_DTYPE
from topology import CHANNELS, Topology

__all__ = ["Injector"]

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
        self._topology, self._index = topology, index
        self._units: set[int] | None = None
        """Those that the fault names; None for all."""
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

    @cached_property
    def payloads(self) -> Payloads:
        """Writes other counts into frames."""
        assert self._topology is not None, "by the check of the script"
        return Payloads(self._topology, self._index)

    def matches(self, frames: np.ndarray) -> np.ndarray:
        """Which frames are among those of this fault, at any time; shape (m,), bool."""
        found = (frames["id"] & np.uint32(CAN_ERR | CAN_RTR)) == 0
        found &= (frames["origin"] & (ECHO | _INJECTED)) == 0
        if self._ids is not None:
            found &= np.isin(frames["id"], self._ids)
        return found

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
            self._units = set(np.flatnonzero(is_named).tolist())
            carries &= np.isin(topology.frames.units, list(self._units))
        if fault.units or not ids:
            here = (topology.frames.bus == index) & carries.any(axis=1)
            ids += topology.frames.can_id[here].tolist()
        return np.array(ids, np.uint32)

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
    """Faults that write other counts into whole frames of the topology."""

    def apply(self, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
        is_hit = np.zeros(frames.size, bool)
        is_hit[hits] = True
        for i in self.looked_at(frames, hits):
            record = frames[i : i + 1]
            if (f := self.payloads.find(record)) is None:
                continue
            channels, units = self.payloads.places(f)
            struck = self.strikes(channels, units)
            places = channels[struck], units[struck]
            counts = self.payloads.read(record, f)
            wrong = self.wrong(f, counts[places], is_hit=bool(is_hit[i]))
            if wrong is not None and wrong.size:
                counts[places] = wrong
                self.payloads.write(record, f)
                self.injected += 1
        return frames

    def looked_at(self, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
        """Rows of the frames of which `wrong` is asked."""
        return hits

    def strikes(self, channels: np.ndarray, units: np.ndarray) -> np.ndarray:
        """Which counts of a frame the fault changes."""
        return np.isin(units, list(self._units)) if self._units is not None else units >= 0

    def wrong(self, f: int, counts: np.ndarray, *, is_hit: bool) -> np.ndarray | None:
        """What is sent in place of counts; None where they stay."""
        raise NotImplementedError


class _Freeze(_InPlace):
    def __init__(self, *given) -> None:
        super().__init__(*given)
        self._last: dict[int, np.ndarray] = {}

    def looked_at(self, frames: np.ndarray, hits: np.ndarray) -> np.ndarray:
        return np.flatnonzero(self.matches(frames))

    def wrong(self, f: int, counts: np.ndarray, *, is_hit: bool) -> np.ndarray | None:
        if is_hit and f in self._last:
            return self._last[f]
        self._last[f] = counts
        return None


class _Wrong(_InPlace):
    fault: kinds.Gain | kinds.Offset | kinds.Stuck

    def strikes(self, channels: np.ndarray, units: np.ndarray) -> np.ndarray:
        struck = super().strikes(channels, units)
        if self.fault.channel is not None:
            struck = struck & (channels == CHANNELS.index(self.fault.channel))
        return struck

    def wrong(self, f: int, counts: np.ndarray, *, is_hit: bool) -> np.ndarray | None:
        match self.fault:
            case kinds.Gain(gain=gain):
                sent = np.round(gain * counts.astype(float))
            case kinds.Offset(counts=more):
                sent = counts.astype(float) + more
            case kinds.Stuck(counts=value):
                sent = np.full(counts.shape, value)
        return np.clip(sent, -32768, 32767)


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
        if (f := self.payloads.find(frame)) is None:
            return frame[:0]
        twin = frame.copy()
        counts, places = self.payloads.read(twin, f), self.payloads.places(f)
        counts[places] ^= 1 | self.rng.integers(0, 16, places[0].size, np.int16)
        self.payloads.write(twin, f, self.fault.offset)
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
            STAGES[type(fault)](fault, topology, index, np.random.default_rng([seed, index, i]))
            for i, fault in enumerate(script.faults)
        ]
        self.injected = {stage.kind: 0 for stage in self._stages}

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
            before = stage.injected
            frames = stage(frames, now_ns)
            self.injected[stage.kind] += stage.injected - before
        frames["origin"] &= ECHO
        return frames
