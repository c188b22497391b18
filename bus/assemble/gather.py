"""Taken frames: units wait for the other parts of their set, then for the end of the cycle.

Compiled into `bus.assemble.feed`.
"""

from __future__ import annotations

import numpy as np

from bus.assemble.accept import count
from bus.assemble.memory import Outcome
from bus.codec_kernels import unpack_frame_python
from bus.compiled.jit import jitable


@jitable
def tear(g, tables, memory):
    """Drop the parts of an incomplete set."""
    group = memory.sets[g]
    for part in range(tables.groups.shape[1]):
        if (group["parts_in"] >> part) & 1:
            f = tables.groups[g, part]
            memory.totals[Outcome.DATA.value] -= 1
            memory.tallies[f, Outcome.DATA.value] -= 1
            count(memory, f, Outcome.TORN.value)
    group["parts_in"] = 0
    group["torn_at"] = memory.state[0]["number"]


@jitable
def clear_codes(f, tables, codes):
    """Clear the fault codes of a frame's units."""
    for slot in range(tables.units.shape[1]):
        if tables.units[f, slot] >= 0:
            codes[tables.units[f, slot]] = 0


@jitable
def gather(f, sequence, stamp, row, data, tables, memory):
    """Take a part of a set; True: the set is complete."""
    state, expected = memory.state[0], tables.frames[f]
    g, part = np.int64(expected["group"]), np.int64(expected["part"])
    group = memory.sets[g]
    if group["parts_in"] != 0 and (
        (group["parts_in"] >> part) & 1
        or (sequence >= 0 and group["key"] >= 0 and sequence != group["key"])
        or (state["is_free"] and abs(stamp - group["stamp"]) > state["period"] // 2)
    ):
        tear(g, tables, memory)
    if group["parts_in"] == 0:
        group["key"] = -1
        group["stamp"] = stamp
        clear_codes(f, tables, memory.gathered_codes)
    if sequence >= 0:
        group["key"] = sequence
    group["parts_in"] |= 1 << part
    unpack_frame_python(data, row, f, tables, memory.gathered, memory.gathered_codes)
    if group["parts_in"] != (1 << tables.parts[g]) - 1:
        return False
    group["parts_in"] = 0
    for slot in range(tables.units.shape[1]):
        unit = tables.units[f, slot]
        if unit >= 0:
            for place in range(unit, memory.staged.size, memory.units.size):
                memory.staged[place] = memory.gathered[place]
            memory.staged_codes[unit] = memory.gathered_codes[unit]
    return True


@jitable
def sampled_at(f, stamp, tables, memory):
    """Sampling time of the units of a frame: the SYNC of their bus, or, without one, about the
    arrival of the first frame of their set."""
    state, g = memory.state[0], np.int64(tables.frames[f]["group"])
    if state["is_free"]:
        return stamp if tables.parts[g] == 1 else memory.sets[g]["stamp"]
    sync = memory.syncs[np.int64(tables.frames[f]["bus"])]
    return sync["stamp"] if sync["number"] == state["number"] else state["stamp"]


@jitable
def stage(f, sequence, stamp, row, data, tables, memory):
    """Take a frame: its units are shown at the end of the cycle, once their set is complete."""
    g = np.int64(tables.frames[f]["group"])
    if tables.parts[g] == 1:
        clear_codes(f, tables, memory.staged_codes)
        unpack_frame_python(data, row, f, tables, memory.staged, memory.staged_codes)
    elif not gather(f, sequence, stamp, row, data, tables, memory):
        return
    memory.sets[g]["whole_at"] = memory.state[0]["number"]
    sampled = sampled_at(f, stamp, tables, memory)
    for slot in range(tables.units.shape[1]):
        unit = tables.units[f, slot]
        if unit >= 0:
            memory.staged_sequence[unit] = max(sequence, 0) & 0xFF
            memory.staged_stamp[unit] = sampled
