"""Faults put in against faults counted: every kind, one at a time, and what got through.

Counts are drawn anew each cycle, so that a value of another cycle is a wrong one. A wrong value is
one that is shown as valid and is not what the unit sent for that cycle. Where a fault can be seen
only after some cycles (counts that stand still, a second sender that speaks first), the values of
the cycles before stand in a column of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bus.assemble import Assembler
from bus.codec import Packer
from bus.cycle import FrameCounters, RawCycle
from bus.faults import FaultScript, FaultyTransport
from bus.faults.script import (
    Babble,
    Corrupt,
    Delay,
    Drop,
    Duplicate,
    Error,
    Fault,
    Freeze,
    Kill,
    Truncate,
)
from bus.frame import FrameBatch
from bus.memory import MemoryTransport
from bus.status import INVALID, Status
from bus.transport import Transport
from topology import CHANNELS, Topology, load

START_NS, SPACING_NS = 1_700_000_000_000_000_000, 50_000


@dataclass
class Trial:
    """One kind of fault.

    Attributes
    ----------
    name : str
    skin : str
        A ready-made topology: "palm" has CAN FD frames with a CRC, "strip" classic ones without.
    fault : Fault
    counter : str
        What must equal the number put in: a name of `FrameCounters`, or of a figure of `run`.
    flag : Status
        What the units that are hit must be flagged with, in the end.
    """

    name: str
    skin: str
    fault: Fault
    counter: str
    flag: Status = Status.OK


def trials(cycles: int) -> list[Trial]:
    """Every kind of fault; none in the last cycles, so that each can still be noticed."""
    palm, strip = load("palm"), load("strip")
    end = {name: (cycles - 20) / skin.cycle_rate_hz for name, skin in
           (("palm", palm), ("strip", strip))}  # fmt: skip
    often = {"probability": 0.05, "to_s": end["palm"]}
    classic = {"probability": 0.05, "to_s": end["strip"]}
    from_s = 10 / palm.cycle_rate_hz
    board, strip_unit = palm.unit_names[:1], strip.unit_names[3:4]
    late, stale = Status.LATE, Status.STALE
    return [
        Trial("drop", "palm", Drop(**often), "lost", late),
        Trial("drop, classic", "strip", Drop(**classic), "lost", late),
        Trial("kill and revive", "palm", Kill(units=board, from_s=from_s, to_s=0.4), "lost", stale),
        Trial("kill for good", "strip", Kill(units=strip_unit, from_s=0.2), "missing", stale),
        Trial("delay", "palm", Delay(delay_s=1.2 / palm.cycle_rate_hz, **often), "late", late),
        Trial("corrupt, 1 bit", "palm", Corrupt(**often), "crc", late),
        Trial("corrupt, 3 bits", "palm", Corrupt(bits=3, **often), "crc", late),
        Trial("truncate", "palm", Truncate(**often), "short", late),
        Trial("truncate, classic", "strip", Truncate(**classic), "short", late),
        Trial("freeze", "palm", Freeze(units=board, from_s=from_s), "standing", Status.FROZEN),
        Trial("babble", "palm", Babble(id=0x7F1, **often), "foreign"),
        Trial("duplicate id", "palm", Duplicate(units=board), "repeated", Status.DUPLICATE),
        Trial("duplicate id first", "palm", Duplicate(units=board, first=True), "repeated",
              Status.DUPLICATE),
        Trial("error frames", "palm", Error(**often), "error"),
        Trial("controller overflow", "palm", Error(what="overflow", **often),
              "controller_overflow"),
    ]  # fmt: skip


def beyond(cycles: int) -> list[Trial]:
    """What no receiver can see: a classic frame has no CRC of its own, CAN's ends at the wire."""
    end = (cycles - 20) / load("strip").cycle_rate_hz
    return [Trial("corrupt, classic", "strip", Corrupt(probability=0.05, to_s=end), "crc")]


class Tally:
    """What has come of each unit in each cycle, against what was sent."""

    def __init__(self, skin: Topology, flag: Status) -> None:
        self.sent: dict[int, np.ndarray] = {}
        self.flag = int(flag)
        self.flagged = np.zeros(skin.n, bool)
        self.has_flag = np.zeros(skin.n, bool)
        self.early = np.zeros(skin.n, np.int64)
        self.wrong = self.standing = self.missing = 0
        self.struck_at: int | None = None
        self.flagged_at: int | None = None
        self._wired = skin.wired

    def add(self, cycle: RawCycle) -> None:
        """Take the next cycle."""
        sent = self.sent[cycle.number]
        wrong = ((cycle.counts != sent) & self._wired).any(axis=0) & cycle.valid
        self.has_flag |= (cycle.status & self.flag) != 0
        if self.flagged_at is None and self.has_flag.any():
            self.flagged_at = cycle.number
        self.early += wrong & ~self.has_flag
        self.wrong += int((wrong & self.has_flag).sum())
        self.flagged |= (cycle.status & int(INVALID)) != 0
        self.standing += int(((cycle.status & int(Status.FROZEN)) != 0).sum())
        self.missing += int((cycle.age != 0).sum())

    def finish(self) -> int:
        """Wrong values before their unit was flagged; of units that never were, they got through.

        Where no flag is due, all of them got through.
        """
        self.wrong += int(self.early[~self.has_flag].sum())
        before = int(self.early[self.has_flag].sum())
        self.standing += before
        return before


def measure(trial: Trial, cycles: int, seed: int = 1) -> dict[str, object]:
    """Send `cycles` cycles past one fault, in memory."""
    return past(trial, load(trial.skin), *MemoryTransport.pair(), cycles, seed)


def past(
    trial: Trial, skin: Topology, near: Transport, far: Transport, cycles: int, seed: int = 1
) -> dict[str, object]:
    """Send `cycles` cycles of a skin from `near` to `far`, past one fault; closes both."""
    script = FaultScript(faults=(trial.fault,))
    with near, FaultyTransport(far, script, seed, skin) as host:
        tally, counters = play(skin, near, host, cycles, trial.flag, seed)
        (injected,) = host.injected.values()
    early = tally.finish()
    seen = tally.struck_at is not None and tally.flagged_at is not None
    counted = (
        getattr(counters, trial.counter)
        if hasattr(counters, trial.counter)
        else getattr(tally, trial.counter)
    )
    return {
        "fault": trial.name,
        "injected": injected,
        "counted": int(counted),
        "counter": trial.counter,
        "units_flagged": int(tally.flagged.sum()),
        "units": skin.n,
        "cycles_to_flag": tally.flagged_at - tally.struck_at if seen else None,
        "wrong_before_flag": early,
        "wrong_unflagged": tally.wrong,
    }


def play(
    skin: Topology, near: Transport, host: FaultyTransport, cycles: int, flag: Status,
    seed: int,
) -> tuple[Tally, FrameCounters]:  # fmt: skip
    """SYNC and data of all units, cycle by cycle, from `near` to an assembler behind `host`."""
    rng = np.random.default_rng(seed)
    packer, assembler = Packer(skin), Assembler(skin)
    out, heard, tally = FrameBatch(len(skin.frames) + 1), FrameBatch(256), Tally(skin, flag)
    period_ns = round(1e9 / skin.cycle_rate_hz)
    for number in range(cycles):
        counts = rng.integers(0, 100, (len(CHANNELS), skin.n)).astype(np.int16)
        tally.sent[number] = counts
        stamp_ns = START_NS + number * period_ns
        out.clear()
        out.append(skin.sync_id, bytes([number & 0xFF]), stamp_ns=stamp_ns)
        packer(counts, out, sequence=number & 0xFF)
        out.frames["stamp_ns"] = stamp_ns + SPACING_NS * np.arange(out.count)
        near.send(out.frames)
        while heard.clear() is None and host.receive(heard):
            for cycle in assembler.feed(heard.frames):
                tally.add(cycle)
        if tally.struck_at is None and any(host.injected.values()):
            tally.struck_at = number
    last = assembler.flush()
    if last is not None:
        tally.add(last)
    return tally, assembler.counters
