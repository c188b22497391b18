"""Acceptance of data frames: sequence numbers, repeats, gaps, steps back, second senders.

Compiled into `bus.assemble.feed`. `f` is a frame of the topology, `row` the index of the received
frame in the batch.
"""

from __future__ import annotations

import numpy as np

from bus.assemble.memory import REGULAR, SUSPECT, Outcome
from bus.compiled.jit import jitable
from bus.frame import PAYLOAD

PIECE, ENOUGH = 8, 24
"""Weight of a piece of evidence for a duplicate identifier, which decays by 1 a cycle: three pieces
within a few cycles suffice, and as many cycles without any clear it. [assumed]"""


@jitable
def count(memory, f, outcome):
    """Count a frame of source f."""
    memory.totals[outcome] += 1
    memory.tallies[f, outcome] += 1


@jitable
def drop(memory, f, outcome):
    """Count a frame of source f that is not taken."""
    count(memory, f, outcome)
    memory.sources[f]["dropped"] += 1


@jitable
def is_other_payload(f, row, data, tables, memory):
    """Whether a frame differs from the last one taken from the same source."""
    for k in range(np.int64(tables.frames[f]["size"])):
        if data[row, PAYLOAD + k] != memory.last[f, k]:
            return True
    return False


@jitable
def repeat(f, row, data, tables, memory):
    """Count a repeated sequence number; other bytes under it show another sender."""
    count(memory, f, Outcome.REPEATED.value)
    if is_other_payload(f, row, data, tables, memory):
        memory.sources[f]["evidence"] += PIECE


@jitable
def lose(f, gap, limit, memory):
    """Count a gap in the sequence; from `limit` on it is silence or a restart, not loss."""
    source = memory.sources[f]
    if 0 < gap < limit and not source["is_duplicate"]:
        lost = max(gap - source["dropped"], 0)
        memory.totals[Outcome.LOST.value] += lost
        memory.tallies[f, Outcome.LOST.value] += lost


@jitable
def cycles_behind(sequence, expected, state):
    """Cycles from that of a frame to the newest one: 0 where the sequence number is not the counter
    of a SYNC."""
    if sequence < 0 or not expected["echoes"]:
        return np.int64(0)
    size = min(np.int64(expected["sequence"]["mask"]) + 1, 256)
    return (state["number"] - state["base"] - sequence) & (size - 1)


@jitable
def position(expected, state):
    """The open cycle as the sender counts it: where it has its own count, numbers without a SYNC
    are left out, for nobody asked it."""
    return state["number"] - (0 if expected["echoes"] else state["left_out"])


@jitable
def accept_echo(f, behind, row, data, tables, memory):
    """Accept or reject a frame whose sequence number is the counter of its SYNC, which was sent
    `behind` cycles before the newest; True: take it."""
    state, source = memory.state[0], memory.sources[f]
    size = min(np.int64(tables.frames[f]["sequence"]["mask"]) + 1, 256)
    number = state["number"]
    if number < 0:
        drop(memory, f, Outcome.LATE.value)
    elif behind == 0 and source["taken_at"] == number:
        repeat(f, row, data, tables, memory)
    elif behind == 0 and state["is_open"]:
        if source["heard"] >= 0:
            asked = number - source["heard"] - 1 - source["unasked"]
            lose(f, asked, max(size // 2, 1), memory)
        source["heard"] = number
        return True
    elif behind == 0:
        # The cycle was closed without it: the next one awaits it again.
        source["missed"] = 0
        drop(memory, f, Outcome.LATE.value)
    elif 0 <= source["heard"] == number - behind:
        repeat(f, row, data, tables, memory)
    else:
        drop(memory, f, Outcome.LATE.value)
    return False


@jitable
def accept_count(f, sequence, row, data, tables, memory):
    """Accept or reject a frame whose sequence number is the sender's own count; True: take it."""
    state, source = memory.state[0], memory.sources[f]
    mask = np.int64(tables.frames[f]["sequence"]["mask"])
    heard, back = source["heard"], source["back"]
    was_silent = heard < 0 or source["missed"] >= state["stale_cycles"]
    step = (sequence - heard) & mask
    if heard >= 0 and step == 0:
        # The same number after a silence may be chance, unless all bytes are equal.
        if not was_silent or not is_other_payload(f, row, data, tables, memory):
            repeat(f, row, data, tables, memory)
            return False
    if not state["is_open"]:
        source["missed"] = 0
        drop(memory, f, Outcome.LATE.value)
        return False
    if not was_silent:
        if step < max((mask + 1) // 2, 2):
            lose(f, step - 1, mask + 1, memory)
        else:
            # A count that continues from a step back: a restart, or two senders; while others
            # arrive as well it is no restart.
            goes_on = back >= 0 and sequence == (back + 1) & mask
            if goes_on:
                source["evidence"] += PIECE
            if not goes_on or source["before"] != 1 or source["came"] > 1:
                source["back"] = sequence
                drop(memory, f, Outcome.LATE.value)
                return False
    source["heard"] = sequence
    return True


@jitable
def is_old(f, sequence, expected, memory):
    """Whether a frame is an old one that a link has buffered: its source is suspect after an
    outage; or, for a sender's own count, the count is behind the cycles since the last frame that
    was taken, and frames do not come at their rate."""
    state, source = memory.state[0], memory.sources[f]
    if source["trust"] == SUSPECT:
        return True
    if sequence < 0 or expected["echoes"] or state["is_free"] or not state["is_open"]:
        return False
    if source["heard"] < 0 or source["missed"] >= state["stale_cycles"]:
        return False
    since = position(expected, state) - source["came_at"]
    if source["regular_cycles"] >= REGULAR and since <= source["every"]:
        return False
    mask = np.int64(expected["sequence"]["mask"])
    step = (sequence - source["heard"]) & mask
    behind = step * source["every"] < state["number"] - source["taken_at"] - source["unasked"]
    return 0 < step < (mask + 1) // 2 and behind


@jitable
def accept_plain(f, memory):
    """Accept or reject a frame without a sequence number; True: take it."""
    state, source = memory.state[0], memory.sources[f]
    if not state["is_open"]:
        source["missed"] = 0
        drop(memory, f, Outcome.LATE.value)
        return False
    if not state["is_free"] and source["taken_at"] == state["number"]:
        count(memory, f, Outcome.REPEATED.value)
        return False
    return True
