"""The compiled path of a frame: from the batch to its cycle.

Frames are `bus.frame.FrameViews`, the expected ones `bus.table.Tables`.
"""

from __future__ import annotations

import numpy as np

from bus.assemble.accept import (
    accept_count,
    accept_echo,
    accept_plain,
    count,
    cycles_behind,
    drop,
    is_old,
    position,
)
from bus.assemble.cycles import close_cycle_python, is_tick, open_cycle, stage, sync_number
from bus.assemble.memory import (
    BY_COMPLETE,
    BY_DEADLINE,
    BY_NOTHING,
    BY_SYNC,
    Outcome,
)
from bus.codec_kernels import frame_crc_python, read_bits
from bus.compiled.jit import compiled, jitable
from bus.frame import CAN_ERR, CAN_RTR, ECHO, FD_FDF, PAYLOAD
from bus.heartbeat import COMMAND_ID
from bus.heartbeat import FIRST_ID as FIRST_HEARTBEAT
from bus.heartbeat import LAST_ID as LAST_HEARTBEAT

__all__ = ["feed"]

STAMP_MAX = 1 << 61
"""Stamps beyond are invalid; sums of those below cannot overflow."""


@jitable
def find(bus, can_id, tables):
    """Frame of the topology for an identifier on a bus, or -1."""
    if can_id < tables.standard.shape[1]:
        return np.int64(tables.standard[np.uintp(bus), np.uintp(can_id)])
    key = bus << 32 | can_id
    low, high = 0, tables.extended.size
    while low < high:
        middle = (low + high) // 2
        if tables.extended[middle]["key"] < key:
            low = middle + 1
        else:
            high = middle
    if low < tables.extended.size and tables.extended[low]["key"] == key:
        return tables.extended[low]["frame"]
    return np.int64(-1)


@jitable
def page_of(f, row, data, frames):
    """The frame given by the first byte, of those with the identifier of f; -1 for none."""
    pages = np.int64(frames[f]["pages"])
    for k in range(pages):
        if frames[f + k]["page"] == data[row, PAYLOAD]:
            return f + k
    return np.int64(-1) if pages else f


@jitable
def take_sync(bus, row, views, tables, memory):
    """Handle a SYNC; False: it ends the open cycle, which must be closed first."""
    state, sync = memory.state[0], memory.syncs[bus]
    header = views.words[row, 1]
    length = (header >> 32) & 0xFF
    if length > 1 or (header >> 40) & FD_FDF:
        memory.totals[Outcome.SHORT.value] += 1
        return True
    if length == 0 and state["is_counted"]:  # such as that of a CANopen master
        memory.totals[Outcome.FOREIGN.value] += 1
        return True
    counter = np.int64(-1)
    if length:
        if not state["is_counted"]:
            state["is_counted"] = 1
            if state["synced"] >= 0:
                state["base"] = state["synced"] + 1 - views.data[row, PAYLOAD]
        counter = (views.data[row, PAYLOAD] + state["base"]) & 0xFF
    stamp = state["last_stamp"]
    number = sync_number(bus, counter, stamp, memory)
    is_new = number > state["synced"]
    if is_new and state["is_open"]:
        return False
    memory.totals[Outcome.SYNC.value] += 1
    sync["number"] = number
    sync["stamp"] = stamp
    if is_new:
        open_cycle(number, stamp, tables, memory)
    return True


@jitable
def take_data(f, row, views, tables, memory):
    """Handle a frame of the topology; True: it was the last one that the open cycle awaited."""
    state, source, expected = memory.state[0], memory.sources[f], tables.frames[f]
    data, header = views.data, views.words[row, 1]
    is_fd = ((header >> 40) & FD_FDF) != 0
    if (header >> 32) & 0xFF != expected["size"] or is_fd != (expected["is_fd"] != 0):
        drop(memory, f, Outcome.SHORT.value)
        return False
    if expected["crc"]["mask"] and (
        frame_crc_python(data, row, expected) != read_bits(data, row, expected["crc"])
    ):
        drop(memory, f, Outcome.CRC.value)
        return False
    sequence = np.int64(-1)
    if expected["sequence"]["mask"]:
        sequence = np.int64(read_bits(data, row, expected["sequence"]))
    behind = cycles_behind(sequence, expected, state)
    source["came"] += 1
    source["sent_at"] = max(source["sent_at"], position(expected, state) - behind)
    if is_old(f, sequence, expected, memory):
        drop(memory, f, Outcome.LATE.value)
        state["is_busy"] = 1  # the cycle is closed later, which may end the suspicion
        return False
    if expected["sequence"]["mask"]:
        if expected["echoes"]:
            is_taken = accept_echo(f, behind, row, data, tables, memory)
        else:
            is_taken = accept_count(f, sequence, row, data, tables, memory)
    else:
        is_taken = accept_plain(f, memory)
    if not is_taken:
        return False
    stamp = state["last_stamp"]
    if state["stamp"] < 0:
        state["stamp"] = stamp
    state["is_busy"] = 1
    source["dropped"] = source["unasked"] = 0
    source["taken_at"] = state["number"]
    for k in range(np.int64(expected["size"])):
        memory.last[f, k] = data[row, PAYLOAD + k]
    count(memory, f, Outcome.DATA.value)
    stage(f, sequence, stamp, row, data, tables, memory)
    if source["is_awaited"]:
        source["is_awaited"] = 0
        state["waiting"] -= 1
        return state["waiting"] == 0
    return False


def feed_python(row, views, tables, memory, shown):
    """Process frames from `row` on; stops when a cycle closes, and returns the next row."""
    state, totals, words = memory.state[0], memory.totals, views.words
    state["closed_by"] = BY_NOTHING
    while row < words.shape[0]:
        header = words[row, 1]
        can_id, bus = header & 0xFFFF_FFFF, (header >> 56) & 0xFF
        if can_id & CAN_ERR:
            totals[Outcome.ERROR.value] += 1
            # Class CRTL with RX_OVERFLOW in its second byte (linux/can/error.h).
            if can_id & 4 and (header >> 32) & 0xFF > 1 and views.data[row, PAYLOAD + 1] & 1:
                totals[Outcome.CONTROLLER_OVERFLOW.value] += 1
        elif can_id & CAN_RTR:
            totals[Outcome.REMOTE.value] += 1
        elif bus >= tables.standard.shape[0]:
            totals[Outcome.FOREIGN.value] += 1
        elif (header >> 48) & ECHO and can_id != memory.syncs[bus]["identifier"]:
            totals[Outcome.ECHO.value] += 1
        else:
            if 0 <= words[row, 0] < STAMP_MAX:
                state["last_stamp"] = words[row, 0]
            if state["is_free"] and not state["has_clock"] and is_tick(state["last_stamp"], memory):
                close_cycle_python(BY_DEADLINE, tables, memory, shown)
                return row
            f = find(bus, can_id, tables)
            if f >= 0:
                f = page_of(f, row, views.data, tables.frames)
            if can_id == memory.syncs[bus]["identifier"]:
                if not take_sync(bus, row, views, tables, memory):
                    close_cycle_python(BY_SYNC, tables, memory, shown)
                    return row
            elif f >= 0:
                if take_data(f, row, views, tables, memory):
                    close_cycle_python(BY_COMPLETE, tables, memory, shown)
                    return row + 1
            elif FIRST_HEARTBEAT <= can_id <= LAST_HEARTBEAT:
                totals[Outcome.HEARTBEAT.value] += 1
            elif can_id == COMMAND_ID:
                totals[Outcome.CONFIGURATION.value] += 1
            else:
                totals[Outcome.FOREIGN.value] += 1
        row += 1
    return row


feed = compiled(feed_python, allocates=False)
