"""State of an assembler, and the arrays that it shows.

n units, c channels, f frames of the topology, g sets of units, b buses. Time stamps in ns.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from bus.assemble.stuck_channels import stuck_limits
from bus.compiled.aligned import zeros
from bus.table import FrameTable
from topology import CHANNELS, Topology

__all__ = ["SET", "SOURCE", "STATE", "STUCK", "SYNC", "UNIT", "Memory", "Outcome", "Shown"]


def _integers(*names: str) -> np.dtype:
    return np.dtype([(name, np.int64) for name in names])


STATE = _integers(
    "number",  # of the open cycle, or of the last one; -1 before the first SYNC
    "synced",  # largest number of a SYNC
    "is_counted",  # whether SYNCs have a counter: others are foreign
    "base",  # number minus counter of the first one that has, modulo 256
    "left_out",  # numbers without a SYNC so far
    "is_open",
    "waiting",  # frames that the open cycle awaits
    "stamp",  # time stamp of the open cycle, -1: none yet
    "tick",  # time stamp at which a free-running cycle closes, 0: none yet
    "idle",  # free-running cycles in a row without any data
    "is_busy",  # whether data came in the open cycle
    "last_stamp",
    "has_clock",  # whether the caller's clock closes free-running cycles
    "closed_by",  # a BY_…
    "closed_number",
    "closed_stamp",
    "is_free",  # whether no bus has a SYNC
    "period",  # ns
    "stale_cycles",
)
BY_NOTHING, BY_COMPLETE, BY_SYNC, BY_DEADLINE, BY_END = range(5)
SYNC = _integers("identifier", "number", "stamp")
"""The SYNC of a bus: identifier (-1: none), last number, its time stamp."""
SOURCE = _integers(
    "heard",  # sequence of the last frame taken (SYNC number where it echoes that), -1: none
    "unasked",  # cycles without a SYNC since a frame was last taken
    "dropped",  # frames since then that were not taken
    "missed",  # cycles in a row without a frame taken
    "is_awaited",  # whether the open cycle awaits it
    "taken_at",  # cycle in which a frame was last taken
    "back",  # sequence of the last frame that stepped back, -1: none
    "came",  # frames that came in this cycle, taken or not
    "before",  # in the last cycle before in which any came
    "sent_at",  # newest cycle to which a frame that came belongs, as `position`, -1: none
    "came_at",  # newest cycle in which frames came, as `position`, -1: none
    "every",  # interval of cycles with frames
    "nominal_frames",  # largest number of frames in such a cycle without buffered ones
    "steady",  # consecutive such cycles with equally many frames
    "regular_cycles",  # such cycles in a row, up to REGULAR, with no more frames, at one rate
    "outage",  # cycles of silence after which frames may be old
    "trust",  # one of the below
    "evidence",  # of two senders with this identifier
    "is_duplicate",  # whether there is enough of it
)
REGULAR = 2
"""Cycles with the usual number and rate of frames after which a source is trusted [assumed: the
first frame of a burst may come alone, before a SYNC that cuts it off]."""
TRUSTED, SUSPECT, RECOVERING = range(3)
"""States of a source after an outage: frames of a suspect one are late; the next frame of a
recovering one is taken."""
SET = _integers(
    "parts_in",  # bit for each part that is in
    "key",  # sequence number of the parts, -1: none has one
    "stamp",  # time stamp of the first part
    "whole_at",  # cycle in which it was last whole
    "torn_at",  # cycle in which it was last torn
    "is_twice",  # whether one of its frames has two senders
)
UNIT = _integers(
    "seen_at",  # cycle of the last good reading, -1: none
    "run",  # cycles in a row with the same counts
    "frozen_after",  # such cycles that make it FROZEN, 0: none do
    "is_enabled",
    "set",  # -1: none
)

STUCK = np.dtype(
    [
        ("count", np.int16),  # first count of the constant channel
        ("band", np.int16),  # largest deviation from it
        ("cycles", np.int32),  # consecutive readings within the band
        ("stuck_after", np.int32),  # number of them that shows a stuck channel, 0: not tested
    ]
)


class Outcome(IntEnum):
    """Outcomes of a frame: the order of `FrameCounters`."""

    DATA = 0
    SYNC = 1
    HEARTBEAT = 2
    CONFIGURATION = 3
    LATE = 4
    REPEATED = 5
    TORN = 6
    SHORT = 7
    FOREIGN = 8
    REMOTE = 9
    ERROR = 10
    CRC = 11
    ECHO = 12
    LOST = 13
    CONTROLLER_OVERFLOW = 14


class Memory(NamedTuple):
    """State of an assembler."""

    state: np.ndarray
    """Shape (1,), STATE."""
    syncs: np.ndarray
    """Shape (b,), SYNC."""
    sources: np.ndarray
    """Shape (f,), SOURCE."""
    last: np.ndarray
    """Shape (f, 64), uint8: payload of the last frame taken."""
    sets: np.ndarray
    """Shape (g,), SET."""
    units: np.ndarray
    """Shape (n,), UNIT."""
    totals: np.ndarray
    """Frames by `Outcome`, int64."""
    tallies: np.ndarray
    """Shape (f, outcomes), int64: the same by frame of the topology."""
    gathered: np.ndarray
    """Shape (c * n,), int16: counts of incomplete sets."""
    gathered_codes: np.ndarray
    """Shape (n,), uint8: their fault codes."""
    staged: np.ndarray
    """Shape (c * n,), int16: counts of complete sets, for the open cycle."""
    staged_codes: np.ndarray
    """Shape (n,), uint8: their fault codes."""
    staged_sequence: np.ndarray
    """Shape (n,), uint8: their sequence numbers."""
    staged_stamp: np.ndarray
    """Shape (n,), int64: time stamps of their sampling."""
    stuck: np.ndarray
    """Shape (c, n), STUCK."""


class Shown(NamedTuple):
    """The arrays of a `RawCycle`."""

    counts: np.ndarray
    valid: np.ndarray
    status: np.ndarray
    age: np.ndarray
    sequence: np.ndarray
    fault_code: np.ndarray
    stuck: np.ndarray
    sampled_ns: np.ndarray


def new_memory(topology: Topology, table: FrameTable, stale_cycles: int) -> Memory:
    """The state of an assembler before the first frame."""
    n, frames = topology.n, len(topology.frames)
    is_free = topology.sync_id is None
    state = np.zeros(1, STATE)
    state["is_free"] = state["is_open"] = is_free
    state["number"] = state["synced"] = 0 if is_free else -1
    state["stamp"] = -1 if is_free else 0
    state["period"] = max(1, round(1e9 / topology.cycle_rate_hz))
    state["stale_cycles"] = stale_cycles
    identifier = -1 if topology.sync_id is None else topology.sync_id
    syncs = np.array([(identifier, -1, -1)] * len(topology.buses), SYNC)
    sources = np.zeros(frames, SOURCE)
    sources["heard"] = sources["back"] = sources["taken_at"] = -1
    sources["sent_at"] = sources["came_at"] = -1
    sources["every"] = sources["nominal_frames"] = 1
    sources["outage"] = _outages(table, stale_cycles)
    sets = np.zeros(len(table.tables.parts), SET)
    sets["key"] = sets["whole_at"] = sets["torn_at"] = -1
    units = np.zeros(n, UNIT)
    units["seen_at"] = -1
    units["frozen_after"] = topology.parameters["frozen_cycles"]
    units["is_enabled"] = topology.enabled
    units["set"] = table.unit_group
    stuck = np.zeros((len(CHANNELS), n), STUCK)
    stuck["band"], stuck["stuck_after"] = stuck_limits(topology)
    return Memory(
        state=state,
        syncs=syncs,
        sources=sources,
        last=np.zeros((frames, 64), np.uint8),
        sets=sets,
        units=units,
        totals=np.zeros(len(Outcome), np.int64),
        tallies=np.zeros((frames, len(Outcome)), np.int64),
        gathered=np.zeros(len(CHANNELS) * n, np.int16),
        gathered_codes=np.zeros(n, np.uint8),
        staged=np.zeros(len(CHANNELS) * n, np.int16),
        staged_codes=np.zeros(n, np.uint8),
        staged_sequence=np.zeros(n, np.uint8),
        staged_stamp=np.zeros(n, np.int64),
        stuck=stuck,
    )


def _outages(table: FrameTable, stale_cycles: int) -> np.ndarray:
    """Cycles of silence after which a frame may be old: the range of its sequence number where that
    is the counter of its SYNC."""
    frames = table.tables.frames
    range_of = np.minimum(frames["sequence"]["mask"].astype(np.int64) + 1, 256)
    counted = (frames["sequence"]["mask"] > 0) & (frames["echoes"] != 0)
    return np.where(counted, range_of, stale_cycles)


def new_shown(n: int) -> Shown:
    """Arrays of n units before the first cycle."""
    return Shown(
        counts=zeros((len(CHANNELS), n), np.int16),
        valid=np.zeros(n, bool),
        status=np.zeros(n, np.uint16),
        age=np.full(n, -1, np.int32),
        sequence=np.zeros(n, np.uint8),
        fault_code=np.zeros(n, np.uint8),
        stuck=np.zeros(n, np.uint8),
        sampled_ns=np.full(n, -1, np.int64),
    )
