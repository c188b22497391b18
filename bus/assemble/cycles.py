"""Cycles: which SYNC opens one, what its frames leave, what closes it, and the counts and status of
each unit then.

Compiled into `bus.assemble.feed`.
"""

from __future__ import annotations

import numpy as np

from bus.assemble.accept import ENOUGH, count, position
from bus.assemble.memory import BY_END, RECOVERING, REGULAR, SUSPECT, TRUSTED, Outcome
from bus.codec_kernels import unpack_frame_python
from bus.compiled.jit import compiled, jitable
from bus.status import INVALID, Status

NEVER, LATE, STALE, FROZEN, FAULT, DUPLICATE, DISABLED, TORN = (
    int(Status[name])
    for name in ("NEVER", "LATE", "STALE", "FROZEN", "FAULT", "DUPLICATE", "DISABLED", "TORN")
)
INVALID_BITS = int(INVALID)
LONGEST = 2**31 - 2
"""Upper bound of the count of equal readings."""
STEADY = 16
"""Cycles with equally many frames that establish the usual number: no link buffers so many
[assumed]."""


# -- taken frames: units wait for the other parts of their set, then for the end of the cycle ------


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


# -- cycles ----------------------------------------------------------------------------------------


@jitable
def sync_number(bus, counter, stamp, memory):
    """Cycle number of a SYNC; `counter` is -1 where it has none."""
    state, sync = memory.state[0], memory.syncs[bus]
    synced, before = state["synced"], sync["number"]
    if counter < 0:
        return max(synced, 0) if before < 0 else before + 1
    if synced < 0:
        number = counter
    else:
        nearest = synced + ((counter - synced + 128) & 0xFF) - 128
        if before < 0:
            number = nearest
        else:
            number = before + ((counter - before) & 0xFF)
            if number == before and abs(stamp - sync["stamp"]) > state["period"] // 2:
                number += 256
            if synced - number >= 128:
                number = nearest
    if number > synced:
        while number <= state["number"]:
            number += 256
    return number


@jitable
def open_cycle(number, stamp, tables, memory):
    """Open the cycle of a SYNC."""
    state = memory.state[0]
    stale_cycles = state["stale_cycles"]
    has_restarted = number - state["number"] > stale_cycles
    unasked = number - state["number"] - 1
    state["number"] = number
    state["left_out"] += unasked
    waiting = 0
    for f in range(memory.sources.size):
        expected, source = tables.frames[f], memory.sources[f]
        source["unasked"] += unasked
        if has_restarted and expected["echoes"]:
            source["heard"] = -1
            source["dropped"] = 0
        source["is_awaited"] = 0
        since = position(expected, state) - source["came_at"]
        is_due = source["came_at"] >= 0 and since == source["every"]
        returns = source["missed"] < stale_cycles or source["trust"] == RECOVERING
        if expected["is_awaited"] and (returns or is_due):
            source["is_awaited"] = 1
            waiting += 1
    state["synced"] = number
    state["is_open"] = 1
    state["waiting"] = waiting
    state["stamp"] = stamp


@jitable
def is_tick(stamp, memory):
    """Whether a free-running cycle ends before a frame of this time stamp."""
    state = memory.state[0]
    period, tick = state["period"], state["tick"]
    if tick == 0:
        # Half a period after the first frame, so that no tick divides a periodic burst.
        state["tick"] = stamp + period + period // 2
    elif stamp < tick - 2 * period:
        state["tick"] = stamp + period // 2
    elif stamp >= tick:
        if state["is_busy"] or state["idle"] <= state["stale_cycles"]:
            state["tick"] += period
            return True
        periods = (stamp - tick) // period + 1
        state["tick"] += periods * period
        state["number"] += periods
    return False


@jitable
def close_cycle_python(why, tables, memory, shown):
    """Close the open cycle: complete sets are shown, all others age; `why` is a BY_…."""
    state = memory.state[0]
    close_sources(why, tables, memory)
    show_units(memory, shown)
    state["closed_by"] = why
    state["closed_number"] = state["number"]
    if state["stamp"] < 0:
        state["stamp"] = state["closed_stamp"] + state["period"]
    state["closed_stamp"] = state["stamp"]
    if state["is_free"]:
        state["number"] += 1
        state["stamp"] = -1
        state["idle"] = 0 if state["is_busy"] else state["idle"] + 1
    else:
        state["is_open"] = 0
    state["is_busy"] = 0


close_cycle = compiled(close_cycle_python, allocates=False)


@jitable
def detect_burst(here, number, source):
    """After an outage a link may deliver buffered frames at once, whose sequence numbers are
    ambiguous. A source is trusted again once `REGULAR` cycles with frames had no more of them than
    usual, at its usual rate: buffered frames come in a burst."""
    came = source["came"]
    if came == 0:
        silent = here - source["came_at"]
        if source["came_at"] >= 0 and silent >= max(source["outage"], 2 * source["every"] + 1):
            source["trust"] = SUSPECT
            source["regular_cycles"] = 0
        return
    # frames after the end of their cycle are counted in the next one
    sent_at = source["sent_at"]
    after = sent_at - source["came_at"] if source["came_at"] >= 0 else np.int64(1)
    source["steady"] = source["steady"] + 1 if came == source["before"] else 0
    if source["steady"] >= STEADY:
        source["nominal_frames"] = came
    elif source["trust"] == TRUSTED:
        source["nominal_frames"] = max(source["nominal_frames"], min(came, source["before"]))
    if came > source["nominal_frames"]:
        source["regular_cycles"] = 0
    elif after > 0:
        regular = min(source["regular_cycles"] + 1, REGULAR)
        source["regular_cycles"] = 1 if after > source["every"] else regular
        source["every"] = after
    if source["trust"] != TRUSTED:
        # one more than usual may have come after the end of the cycle before
        is_over = source["taken_at"] == number and came <= source["nominal_frames"] + 1
        going = RECOVERING if source["regular_cycles"] >= REGULAR else SUSPECT
        source["trust"] = TRUSTED if is_over else going
    source["before"], source["came_at"], source["came"] = came, sent_at, 0


@jitable
def close_sources(why, tables, memory):
    """Update the frames and sets of the topology at the end of a cycle."""
    state, sets = memory.state[0], memory.sets
    for g in range(sets.size):
        sets[g]["is_twice"] = 0
    for f in range(memory.sources.size):
        source = memory.sources[f]
        if source["taken_at"] == state["number"]:
            source["missed"] = 0
        else:
            source["missed"] += 1
        detect_burst(position(tables.frames[f], state), state["number"], source)
        evidence = min(source["evidence"], 2 * ENOUGH)
        if evidence >= ENOUGH:
            source["is_duplicate"] = 1
        elif evidence == 0:
            source["is_duplicate"] = 0
        source["evidence"] = max(evidence - 1, 0)
        if source["is_duplicate"]:
            sets[tables.frames[f]["group"]]["is_twice"] = 1
    if why == BY_END or not state["is_free"]:
        for g in range(sets.size):
            if sets[g]["parts_in"] != 0:
                tear(g, tables, memory)


@jitable
def show_units(memory, shown):
    """Counts and status of every unit at the end of a cycle."""
    for u in range(memory.units.size):
        flags = show_unit(u, memory, shown)
        shown.status[u] = flags
        shown.valid[u] = flags & INVALID_BITS == 0


@jitable
def is_stuck(count, channel):
    """Update a channel with a count: 1 if it has been constant for too long, else 0."""
    off = np.int64(count) - np.int64(channel["count"])
    if channel["cycles"] == 0 or abs(off) > channel["band"]:
        channel["count"] = count
        channel["cycles"] = 0
    channel["cycles"] = min(channel["cycles"] + 1, LONGEST)
    return 1 if 0 < channel["stuck_after"] <= channel["cycles"] else 0


@jitable
def show_unit(u, memory, shown):
    """Show the counts of a unit, if they are of this cycle; returns its flags."""
    state, unit, g = memory.state[0], memory.units[u], memory.units[u]["set"]
    number = state["number"]
    flags = 0 if unit["is_enabled"] else DISABLED
    if g >= 0 and memory.sets[g]["whole_at"] == number:
        is_same = unit["run"] > 0
        stuck = 0
        for c in range(shown.counts.shape[0]):
            count = memory.staged[c * memory.units.size + u]
            if count != shown.counts[c, u]:
                is_same = False
                shown.counts[c, u] = count
            stuck |= is_stuck(count, memory.stuck[c, u]) << c
        shown.stuck[u] = stuck
        unit["run"] = unit["run"] + 1 if is_same else 1
        unit["seen_at"] = number
        shown.fault_code[u] = memory.staged_codes[u]
        shown.sequence[u] = memory.staged_sequence[u]
        shown.sampled_ns[u] = memory.staged_stamp[u]
        shown.age[u] = 0
    else:
        if g >= 0 and memory.sets[g]["torn_at"] == number:
            flags |= TORN
        if unit["seen_at"] < 0:
            flags |= NEVER
        else:
            age = min(number - unit["seen_at"], 0x7FFF_FFFF)
            shown.age[u] = age
            # Without SYNC units and ticks are not synchronous.
            if age >= (2 if state["is_free"] else 1):
                flags |= LATE
            if age >= state["stale_cycles"]:
                flags |= STALE
    if shown.fault_code[u] != 0:
        flags |= FAULT
    if unit["frozen_after"] > 0 and unit["run"] >= max(unit["frozen_after"], 2):
        shown.stuck[u] = (1 << shown.counts.shape[0]) - 1
    if shown.stuck[u] != 0:
        flags |= FROZEN
    if g >= 0 and memory.sets[g]["is_twice"]:
        flags |= DUPLICATE
    return flags
