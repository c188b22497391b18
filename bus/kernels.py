"""All compiled code of the bus: CRC, packing, unpacking, and the assembly of frames into cycles.

One file, because numba's cache does not see a change in another one. Each kernel is a plain
function and, at the end of the file, one line that compiles it.

A batch of m frames enters as two views of the same memory: `words` (`as_words`), shape (m, 10),
int64, holds the time stamp in column 0 and identifier, length, flags, origin and bus in column 1;
`data` (`as_bytes`), shape (m, 80), uint8, holds everything byte by byte. The tables are those of
`bus.table.FrameTable`; its columns are named here. n units, f frames, g sets of units, b buses.
The rules of assembling are told in `bus.assemble`.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numba import njit, types

from bus.configure import IDENTIFIER as CONFIGURATION_ID
from bus.frame import CAN_ERR, CAN_RTR, ECHO, FD_BRS, FD_FDF, FRAME_DTYPE
from bus.heartbeat import FIRST_ID as FIRST_HEARTBEAT
from bus.heartbeat import LAST_ID as LAST_HEARTBEAT
from bus.status import INVALID, Status

PAYLOAD = FRAME_DTYPE.fields["data"][1]
"""Place of the first data byte in a record."""
CHANNEL_COUNT = 6
_WORDS = np.dtype((np.int64, FRAME_DTYPE.itemsize // 8))
_BYTES = np.dtype((np.uint8, FRAME_DTYPE.itemsize))

# A field: four bytes of the record as one number, shifted right and masked. WHERE has the first of
# the bytes from bit BYTE_AT on, SWAPPED where the high byte comes first, and the shift below that:
# in one number, since a signal takes about as long as its numbers are many.
WHERE, MASK = range(2)
SWAPPED, BYTE_AT, SHIFT_MASK = 1 << 5, 6, (1 << 5) - 1
FIELD_WIDTH = 2
# Columns of `signals`, one row for each signal of each frame; the first two are a field.
# A count is (field ^ FLIP) - BIAS: that is how signs, and 16 bits unsigned, are read. PLACE is that
# of the count in the channels of all units, one after the other.
FLIP, BIAS, CHANNEL, UNIT, PLACE = range(FIELD_WIDTH, FIELD_WIDTH + 5)
SIGNAL_COLUMNS = FIELD_WIDTH + 5
# Columns of `frames`; the last three are fields of two columns each, mask 0 where there is none.
# PAGES frames have the same identifier (0: it is the frame's own), and PAGE as their first byte.
(
    BUS, IDENTIFIER, SIZE, IS_FD, FIRST_CHANNEL, FIRST_STATUS, END_STATUS, GROUP, PART, PAGES, PAGE,
    AWAITED, ECHOES, CRC_PLACE,
) = range(14)  # fmt: skip
SEQUENCE = 14
STATUS = SEQUENCE + FIELD_WIDTH
CRC = STATUS + FIELD_WIDTH
FRAME_COLUMNS = CRC + FIELD_WIDTH

# Columns of `Memory.sources`, one row a frame of the table.
HEARD = 0  # sequence of the last frame taken (SYNC number where it echoes that), -1: none
DROPPED = 1  # frames that came since then and were not taken, for whatever reason
MISSED = 2  # cycles in a row without a frame taken
WAITED_FOR = 3  # whether the open cycle still waits for it
TAKEN_AT = 4  # cycle in which a frame was last taken
BACK = 5  # sequence of the last frame that stepped back, -1: none
EVIDENCE = 6  # of two senders with this identifier
DUPLICATE = 7  # whether there was enough of it
SOURCE_COLUMNS = 8
# Columns of `Memory.sets`, one row a set of units.
PARTS_IN = 0  # bit for each part that is in
KEY = 1  # sequence number of the parts, -1: none has one
SET_STAMP = 2  # time stamp of the first part
WHOLE_AT, TORN_AT = 3, 4  # cycle in which the set was last whole, or torn
TWICE = 5  # whether one of its frames has two senders
SET_COLUMNS = 6
# Rows of `Memory.units`.
SEEN_AT, RUN, FROZEN_AFTER, ENABLED, SET = range(5)
UNIT_ROWS = 5
# Columns of `Memory.syncs`, one row a bus: identifier (-1: none), last number, its time stamp.
SYNC_IDENTIFIER, SYNC_NUMBER, SYNC_STAMP = range(3)
# Places of `Memory.state`.
NUMBER = 0  # of the open cycle, or of the last one; -1 before the first SYNC
SYNCED = 1  # largest number that a SYNC has given
OPEN = 2
WAITING = 3  # frames that the open cycle waits for
STAMP = 4  # time stamp of the open cycle, -1: none yet
TICK = 5  # time stamp at which a free-running cycle closes, 0: none yet
IDLE = 6  # free-running cycles in a row without any data
BUSY = 7  # whether the open cycle has taken data
LAST_STAMP = 8
OWN_CLOCK = 9  # whether the caller closes free-running cycles by a clock of its own
CLOSED_BY, CLOSED_NUMBER, CLOSED_STAMP = 10, 11, 12
FREE = 13  # whether no bus has a SYNC
PERIOD = 14  # ns
STALE_CYCLES = 15
STATE_SIZE = 16
# Values of state[CLOSED_BY].
BY_NOTHING, BY_COMPLETE, BY_SYNC, BY_DEADLINE, BY_END = range(5)
# What becomes of a frame: places of `Memory.totals`, in the order of `FrameCounters`.
(
    DATA, SYNC, HEARTBEAT, CONFIGURATION, LATE, REPEATED, TORN, SHORT,
    FOREIGN, REMOTE, ERROR, CRC_FAILED, ECHOED, LOST, OVERFLOW,
) = range(15)  # fmt: skip
KINDS = 15

PIECE, ENOUGH = 8, 24
"""Each piece of evidence for a duplicate identifier counts 8, each cycle takes 1 away: three
pieces within a few cycles are enough, and as many cycles without any clear it."""
STAMP_MAX = 1 << 61
"""Time stamps beyond are not believed; sums of those below cannot overflow."""
NEVER_BIT, LATE_BIT, STALE_BIT, FROZEN_BIT = (
    int(flag) for flag in (Status.NEVER, Status.LATE, Status.STALE, Status.FROZEN)
)
FAULT_BIT, DUPLICATE_BIT, DISABLED_BIT, TORN_BIT = (
    int(flag) for flag in (Status.FAULT, Status.DUPLICATE, Status.DISABLED, Status.TORN)
)
INVALID_BITS = int(INVALID)


class Tables(NamedTuple):
    """What a topology expects; see `bus.table.FrameTable`.

    int32 but as noted: indexing by unsigned integers spares the test for negative ones.
    """

    frames: np.ndarray  # (f, FRAME_COLUMNS), uint32
    signals: np.ndarray  # (m, SIGNAL_COLUMNS)
    units: np.ndarray  # (f, s)
    standard: np.ndarray  # (b, 2048)
    extended: np.ndarray  # (e, 2), int64
    groups: np.ndarray  # (g, p)
    parts: np.ndarray  # (g,)


class Memory(NamedTuple):
    """What an assembler remembers. All int64 but as noted."""

    state: np.ndarray  # (STATE_SIZE,)
    syncs: np.ndarray  # (b, 3)
    sources: np.ndarray  # (f, SOURCE_COLUMNS)
    last: np.ndarray  # (f, 64), uint8: payload of the last frame taken
    sets: np.ndarray  # (g, SET_COLUMNS)
    units: np.ndarray  # (UNIT_ROWS, n)
    totals: np.ndarray  # (KINDS,)
    tallies: np.ndarray  # (f, KINDS): the same by frame of the table
    gathered: np.ndarray  # (c * n,), int16: parts of a set that is not whole yet
    gathered_codes: np.ndarray  # (n,), uint8
    staged: np.ndarray  # (c * n,), int16: whole, for the open cycle
    staged_codes: np.ndarray  # (n,), uint8
    staged_sequence: np.ndarray  # (n,), uint8


class Shown(NamedTuple):
    """The arrays of a `RawCycle`."""

    counts: np.ndarray
    valid: np.ndarray
    status: np.ndarray
    age: np.ndarray
    sequence: np.ndarray
    fault_code: np.ndarray


def _crc_tables() -> np.ndarray:
    """CRC-16 with polynomial 0x1021 of each byte, followed by none to seven zero bytes."""
    tables = np.zeros((8, 256), np.int64)
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x11021 if crc & 0x8000 else 0)
        tables[0, byte] = crc
    for k in range(1, 8):
        before = tables[k - 1]
        tables[k] = ((before << 8) & 0xFFFF) ^ tables[0, before >> 8]
    return tables.astype(np.uint16)


CRC_TABLES = _crc_tables()


def as_words(records: np.ndarray) -> np.ndarray:
    """View of FRAME_DTYPE records, shape (m,), contiguous, as int64, shape (m, 10)."""
    return records.view(_WORDS)


def as_bytes(records: np.ndarray) -> np.ndarray:
    """View of FRAME_DTYPE records, shape (m,), contiguous, as uint8, shape (m, 80)."""
    return records.view(_BYTES)


def _crc16(crc, data, row, begin, end):
    """CRC-16/CCITT-FALSE carried on from `crc` over data[row, begin:end], eight bytes a step."""
    i = begin
    while i + 8 <= end:
        crc = (
            CRC_TABLES[7, (crc >> 8) ^ data[row, i]]
            ^ CRC_TABLES[6, (crc & 0xFF) ^ data[row, i + 1]]
            ^ CRC_TABLES[5, data[row, i + 2]]
            ^ CRC_TABLES[4, data[row, i + 3]]
            ^ CRC_TABLES[3, data[row, i + 4]]
            ^ CRC_TABLES[2, data[row, i + 5]]
            ^ CRC_TABLES[1, data[row, i + 6]]
            ^ CRC_TABLES[0, data[row, i + 7]]
        )
        crc = np.int64(crc)
        i += 8
    while i < end:
        crc = ((crc << 8) & 0xFFFF) ^ np.int64(CRC_TABLES[0, (crc >> 8) ^ data[row, i]])
        i += 1
    return crc


def _frame_crc(data, row, frames, f):
    """CRC of a frame: its identifier's low 16 bits, low byte first, then all but the crc itself."""
    begin, place = PAYLOAD, np.int64(frames[f, CRC_PLACE])
    end = begin + np.int64(frames[f, SIZE])
    crc = np.int64(0xFFFF)
    for k in range(2):
        byte = (frames[f, IDENTIFIER] >> (8 * k)) & 0xFF
        crc = ((crc << 8) & 0xFFFF) ^ np.int64(CRC_TABLES[0, (crc >> 8) ^ byte])
    crc = crc16(crc, data, row, begin, place)
    return crc16(crc, data, row, place + 2, end)


def _low_first(data, row, byte):
    """Four bytes of a record as one number, in one load: the compiler sees through the shifts."""
    return (
        np.uint32(data[row, byte])
        | (np.uint32(data[row, byte + np.uintp(1)]) << np.uint32(8))
        | (np.uint32(data[row, byte + np.uintp(2)]) << np.uint32(16))
        | (np.uint32(data[row, byte + np.uintp(3)]) << np.uint32(24))
    )


def _high_first(data, row, byte):
    """The same four bytes in the other order."""
    return (
        (np.uint32(data[row, byte]) << np.uint32(24))
        | (np.uint32(data[row, byte + np.uintp(1)]) << np.uint32(16))
        | (np.uint32(data[row, byte + np.uintp(2)]) << np.uint32(8))
        | np.uint32(data[row, byte + np.uintp(3)])
    )


def _read_bits(data, row, table, t, k):
    """The unsigned integer in the field at table[t, k:k + 4]."""
    row, t = np.uintp(row), np.uintp(t)
    where = np.uint32(table[t, k + WHERE])
    byte = np.uintp(where >> np.uint32(BYTE_AT))
    is_swapped = where & np.uint32(SWAPPED)
    word = high_first(data, row, byte) if is_swapped else low_first(data, row, byte)
    return np.int32((word >> (where & np.uint32(SHIFT_MASK))) & np.uint32(table[t, k + MASK]))


def _write_bits(value, data, row, table, t, k):
    """Set the bits of a field, which are 0, to the low bits of `value`."""
    where = np.int64(table[t, k + WHERE])
    word = (np.int64(value) & table[t, k + MASK]) << (where & SHIFT_MASK)
    for i in range(4):
        place = 3 - i if where & SWAPPED else i
        data[row, (where >> BYTE_AT) + place] |= np.uint8((word >> (8 * i)) & 0xFF)


def _unpack_frame(data, row, f, frames, signals, units, counts, codes):
    """Channels of one frame into `counts` (c * n,); fault codes, where not 0, into `codes` (n,)."""
    row, f = np.uintp(row), np.uintp(f)
    if frames[f, STATUS + MASK]:
        board = min(read_bits(data, row, frames, f, STATUS), 255)
        if board != 0:
            for slot in range(units.shape[1]):
                if units[f, slot] >= 0:
                    codes[units[f, slot]] = board
    for k in range(np.uintp(frames[f, FIRST_CHANNEL]), np.uintp(frames[f, FIRST_STATUS])):
        value = read_bits(data, row, signals, k, 0)
        counts[np.uintp(signals[k, PLACE])] = (value ^ signals[k, FLIP]) - signals[k, BIAS]
    for k in range(np.uintp(frames[f, FIRST_STATUS]), np.uintp(frames[f, END_STATUS])):
        value = read_bits(data, row, signals, k, 0)
        if value != 0:
            codes[np.uintp(signals[k, UNIT])] = min(value, 255)


def _pack(first, end, sequence, stamp, counts, codes, frames, signals, words, data):
    """Frames first … end - 1 of the table into rows 0 … of `words` and `data`."""
    for f in range(first, end):
        row = f - first
        words[row, 0] = stamp
        for k in range(4):
            data[row, 8 + k] = (frames[f, IDENTIFIER] >> (8 * k)) & 0xFF
        data[row, 12] = frames[f, SIZE]
        data[row, 13] = (FD_FDF | FD_BRS) if frames[f, IS_FD] else 0
        data[row, 14] = 0
        data[row, 15] = frames[f, BUS]
        for k in range(PAYLOAD, data.shape[1]):
            data[row, k] = 0
        if frames[f, PAGES]:
            data[row, PAYLOAD] = frames[f, PAGE]
        write_bits(sequence, data, row, frames, f, SEQUENCE)
        for k in range(frames[f, FIRST_CHANNEL], frames[f, FIRST_STATUS]):
            count = np.int64(counts[signals[k, CHANNEL], signals[k, UNIT]])
            value = min(max(count + signals[k, BIAS], 0), np.int64(signals[k, MASK]))
            write_bits(value ^ signals[k, FLIP], data, row, signals, k, 0)
        for k in range(frames[f, FIRST_STATUS], frames[f, END_STATUS]):
            code = min(np.int64(codes[signals[k, UNIT]]), np.int64(signals[k, MASK]))
            write_bits(code, data, row, signals, k, 0)
        if frames[f, CRC + MASK]:
            write_bits(frame_crc(data, row, frames, f), data, row, frames, f, CRC)


def _count(memory, f, kind):
    """Count a frame of source f."""
    memory.totals[kind] += 1
    memory.tallies[f, kind] += 1


def _drop(memory, f, kind):
    """Count a frame of source f that came but is not taken."""
    count(memory, f, kind)
    memory.sources[f, DROPPED] += 1


def _find(bus, can_id, tables):
    """Row of the frame table for an identifier on a bus, or -1."""
    if can_id < tables.standard.shape[1]:
        return np.int64(tables.standard[np.uintp(bus), np.uintp(can_id)])
    key = bus << 32 | can_id
    low, high = 0, tables.extended.shape[0]
    while low < high:
        middle = (low + high) // 2
        if tables.extended[middle, 0] < key:
            low = middle + 1
        else:
            high = middle
    if low < tables.extended.shape[0] and tables.extended[low, 0] == key:
        return tables.extended[low, 1]
    return np.int64(-1)


def _page_of(f, row, data, frames):
    """The frame that its first byte says, of those with the identifier of f; -1: none of them."""
    pages = np.int64(frames[f, PAGES])
    for k in range(pages):
        if frames[f + k, PAGE] == data[row, PAYLOAD]:
            return f + k
    return np.int64(-1) if pages else f


def _sync_number(bus, counter, stamp, memory):
    """Cycle number that a SYNC gives; `counter` is -1 where it carries none."""
    state, syncs = memory.state, memory.syncs
    synced, before = state[SYNCED], syncs[bus, SYNC_NUMBER]
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
            if number == before and abs(stamp - syncs[bus, SYNC_STAMP]) > state[PERIOD] // 2:
                number += 256
            if synced - number >= 128:
                number = nearest
    if number > synced:
        while number <= state[NUMBER]:
            number += 256
    return number


def _open_cycle(number, stamp, tables, memory):
    """Begin the cycle of a SYNC."""
    state, sources = memory.state, memory.sources
    restarted = number - state[NUMBER] > state[STALE_CYCLES]
    waiting = 0
    for f in range(sources.shape[0]):
        if restarted and tables.frames[f, ECHOES]:
            sources[f, HEARD] = -1
            sources[f, DROPPED] = 0
        sources[f, WAITED_FOR] = 0
        if tables.frames[f, AWAITED] and sources[f, MISSED] < state[STALE_CYCLES]:
            sources[f, WAITED_FOR] = 1
            waiting += 1
    state[NUMBER] = number
    state[SYNCED] = number
    state[OPEN] = 1
    state[WAITING] = waiting
    state[STAMP] = stamp


def _is_other_payload(f, row, data, tables, memory):
    """Whether a frame differs from the last one taken from the same source."""
    for k in range(np.int64(tables.frames[f, SIZE])):
        if data[row, PAYLOAD + k] != memory.last[f, k]:
            return True
    return False


def _repeat(f, row, data, tables, memory):
    """Count a sequence number that came again; other bytes under it mean another sender."""
    count(memory, f, REPEATED)
    if is_other_payload(f, row, data, tables, memory):
        memory.sources[f, EVIDENCE] += PIECE


def _lose(f, gap, limit, memory):
    """Count a gap in the sequence; `limit` and longer is silence or a restart, not loss."""
    if 0 < gap < limit and not memory.sources[f, DUPLICATE]:
        lost = max(gap - memory.sources[f, DROPPED], 0)
        memory.totals[LOST] += lost
        memory.tallies[f, LOST] += lost


def _accept_echo(f, sequence, row, data, tables, memory):
    """Judge a frame whose sequence number is the counter of its SYNC; True: take it."""
    state, sources = memory.state, memory.sources
    size = min(np.int64(tables.frames[f, SEQUENCE + MASK]) + 1, 256)
    number = state[NUMBER]
    behind = (number - sequence) & (size - 1)
    if number < 0:
        drop(memory, f, LATE)
    elif behind == 0 and sources[f, TAKEN_AT] == number:
        repeat(f, row, data, tables, memory)
    elif behind == 0 and state[OPEN]:
        if sources[f, HEARD] >= 0:
            lose(f, number - sources[f, HEARD] - 1, max(size // 2, 1), memory)
        sources[f, HEARD] = number
        return True
    elif behind == 0:
        # Closed without waiting for it: the next cycle shall wait.
        sources[f, MISSED] = 0
        drop(memory, f, LATE)
    elif number - behind == sources[f, HEARD]:
        repeat(f, row, data, tables, memory)
    else:
        drop(memory, f, LATE)
    return False


def _accept_count(f, sequence, row, data, tables, memory):
    """Judge a frame whose sequence number is the sender's own count; True: take it."""
    state, sources = memory.state, memory.sources
    mask = np.int64(tables.frames[f, SEQUENCE + MASK])
    heard, back = sources[f, HEARD], sources[f, BACK]
    was_silent = heard < 0 or sources[f, MISSED] >= state[STALE_CYCLES]
    step = (sequence - heard) & mask
    if heard >= 0 and step == 0:
        # The same number after a silence may be chance, but not if all bytes are the same.
        if not was_silent or not is_other_payload(f, row, data, tables, memory):
            repeat(f, row, data, tables, memory)
            return False
    if not state[OPEN]:
        sources[f, MISSED] = 0
        drop(memory, f, LATE)
        return False
    if not was_silent:
        if step < max((mask + 1) // 2, 2):
            lose(f, step - 1, mask + 1, memory)
        elif back >= 0 and sequence == (back + 1) & mask:
            # A count that goes on from a step back: restarted, or there are two of them.
            sources[f, EVIDENCE] += PIECE
        else:
            sources[f, BACK] = sequence
            drop(memory, f, LATE)
            return False
    sources[f, HEARD] = sequence
    return True


def _accept_plain(f, memory):
    """Judge a frame without a sequence number; True: take it."""
    state, sources = memory.state, memory.sources
    if not state[OPEN]:
        sources[f, MISSED] = 0
        drop(memory, f, LATE)
        return False
    if not state[FREE] and sources[f, TAKEN_AT] == state[NUMBER]:
        count(memory, f, REPEATED)
        return False
    return True


def _tear(g, tables, memory):
    """Drop the parts of a set whose others never came."""
    for part in range(tables.groups.shape[1]):
        if (memory.sets[g, PARTS_IN] >> part) & 1:
            f = tables.groups[g, part]
            memory.totals[DATA] -= 1
            memory.tallies[f, DATA] -= 1
            count(memory, f, TORN)
    memory.sets[g, PARTS_IN] = 0
    memory.sets[g, TORN_AT] = memory.state[NUMBER]


def _stage(f, sequence, stamp, row, data, tables, memory):
    """Take a frame: its units wait for the end of the cycle, or for the other parts of the set."""
    state, sets = memory.state, memory.sets
    g = np.int64(tables.frames[f, GROUP])
    if tables.parts[g] == 1:
        clear_codes(f, tables, memory.staged_codes)
        unpack_frame(
            data, row, f, tables.frames, tables.signals, tables.units,
            memory.staged, memory.staged_codes,
        )  # fmt: skip
    else:
        part = np.int64(tables.frames[f, PART])
        if sets[g, PARTS_IN] != 0 and (
            (sets[g, PARTS_IN] >> part) & 1
            or (sequence >= 0 and sets[g, KEY] >= 0 and sequence != sets[g, KEY])
            or (state[FREE] and abs(stamp - sets[g, SET_STAMP]) > state[PERIOD] // 2)
        ):
            tear(g, tables, memory)
        if sets[g, PARTS_IN] == 0:
            sets[g, KEY] = -1
            sets[g, SET_STAMP] = stamp
            clear_codes(f, tables, memory.gathered_codes)
        if sequence >= 0:
            sets[g, KEY] = sequence
        sets[g, PARTS_IN] |= 1 << part
        unpack_frame(
            data, row, f, tables.frames, tables.signals, tables.units,
            memory.gathered, memory.gathered_codes,
        )  # fmt: skip
        if sets[g, PARTS_IN] != (1 << tables.parts[g]) - 1:
            return
        sets[g, PARTS_IN] = 0
        for slot in range(tables.units.shape[1]):
            unit = tables.units[f, slot]
            if unit >= 0:
                for place in range(unit, memory.staged.size, memory.units.shape[1]):
                    memory.staged[place] = memory.gathered[place]
                memory.staged_codes[unit] = memory.gathered_codes[unit]
    sets[g, WHOLE_AT] = state[NUMBER]
    for slot in range(tables.units.shape[1]):
        if tables.units[f, slot] >= 0:
            memory.staged_sequence[tables.units[f, slot]] = max(sequence, 0) & 0xFF


def _clear_codes(f, tables, codes):
    """Forget the fault codes of a frame's units."""
    for slot in range(tables.units.shape[1]):
        if tables.units[f, slot] >= 0:
            codes[tables.units[f, slot]] = 0


def _close_cycle(why, tables, memory, shown):
    """End the open cycle: whole sets are shown, all others age."""
    state = memory.state
    close_sources(why, tables, memory)
    show_units(memory, shown)
    state[CLOSED_BY] = why
    state[CLOSED_NUMBER] = state[NUMBER]
    if state[STAMP] < 0:
        state[STAMP] = state[CLOSED_STAMP] + state[PERIOD]
    state[CLOSED_STAMP] = state[STAMP]
    if state[FREE]:
        state[NUMBER] += 1
        state[STAMP] = -1
        state[IDLE] = 0 if state[BUSY] else state[IDLE] + 1
    else:
        state[OPEN] = 0
    state[BUSY] = 0


def _close_sources(why, tables, memory):
    """What the end of a cycle means to the frames and sets of the table."""
    state, sources, sets = memory.state, memory.sources, memory.sets
    sets[:, TWICE] = 0
    for f in range(sources.shape[0]):
        if sources[f, TAKEN_AT] == state[NUMBER]:
            sources[f, MISSED] = 0
        else:
            sources[f, MISSED] += 1
        evidence = min(sources[f, EVIDENCE], 2 * ENOUGH)
        if evidence >= ENOUGH:
            sources[f, DUPLICATE] = 1
        elif evidence == 0:
            sources[f, DUPLICATE] = 0
        sources[f, EVIDENCE] = max(evidence - 1, 0)
        if sources[f, DUPLICATE]:
            sets[tables.frames[f, GROUP], TWICE] = 1
    if why == BY_END or not state[FREE]:
        for g in range(sets.shape[0]):
            if sets[g, PARTS_IN] != 0:
                tear(g, tables, memory)


def _show_units(memory, shown):
    """Counts and status of every unit at the end of a cycle."""
    state, units, sets = memory.state, memory.units, memory.sets
    number = state[NUMBER]
    patience = 2 if state[FREE] else 1
    for u in range(units.shape[1]):
        g = units[SET, u]
        flags = 0 if units[ENABLED, u] else DISABLED_BIT
        if g >= 0 and sets[g, WHOLE_AT] == number:
            is_same = units[RUN, u] > 0
            for c in range(CHANNEL_COUNT):
                count = memory.staged[c * units.shape[1] + u]
                if count != shown.counts[c, u]:
                    is_same = False
                    shown.counts[c, u] = count
            units[RUN, u] = units[RUN, u] + 1 if is_same else 1
            units[SEEN_AT, u] = number
            shown.fault_code[u] = memory.staged_codes[u]
            shown.sequence[u] = memory.staged_sequence[u]
            shown.age[u] = 0
        else:
            if g >= 0 and sets[g, TORN_AT] == number:
                flags |= TORN_BIT
            if units[SEEN_AT, u] < 0:
                flags |= NEVER_BIT
            else:
                age = min(number - units[SEEN_AT, u], 0x7FFF_FFFF)
                shown.age[u] = age
                if age >= patience:
                    flags |= LATE_BIT
                if age >= state[STALE_CYCLES]:
                    flags |= STALE_BIT
        if shown.fault_code[u] != 0:
            flags |= FAULT_BIT
        if units[FROZEN_AFTER, u] > 0 and units[RUN, u] >= max(units[FROZEN_AFTER, u], 2):
            flags |= FROZEN_BIT
        if g >= 0 and sets[g, TWICE]:
            flags |= DUPLICATE_BIT
        shown.status[u] = flags
        shown.valid[u] = flags & INVALID_BITS == 0


def _is_tick(stamp, memory):
    """Whether a free-running cycle ends before a frame of this time stamp."""
    state = memory.state
    period = state[PERIOD]
    if state[TICK] == 0:
        # Half a period off the first frame, so that no tick cuts a burst that comes each period.
        state[TICK] = stamp + period + period // 2
    elif stamp < state[TICK] - 2 * period:
        state[TICK] = stamp + period // 2
    elif stamp >= state[TICK]:
        if state[BUSY] or state[IDLE] <= state[STALE_CYCLES]:
            state[TICK] += period
            return True
        periods = (stamp - state[TICK]) // period + 1
        state[TICK] += periods * period
        state[NUMBER] += periods
    return False


def _take_sync(bus, row, words, data, tables, memory):
    """Handle a SYNC; False: it ends the open cycle, to be closed first."""
    state = memory.state
    header = words[row, 1]
    length = (header >> 32) & 0xFF
    if length > 1 or (header >> 40) & FD_FDF:
        memory.totals[SHORT] += 1
        return True
    counter = np.int64(data[row, PAYLOAD]) if length else np.int64(-1)
    stamp = state[LAST_STAMP]
    number = sync_number(bus, counter, stamp, memory)
    is_new = number > state[SYNCED]
    if is_new and state[OPEN]:
        return False
    memory.totals[SYNC] += 1
    memory.syncs[bus, SYNC_NUMBER] = number
    memory.syncs[bus, SYNC_STAMP] = stamp
    if is_new:
        open_cycle(number, stamp, tables, memory)
    return True


def _take_data(f, row, words, data, tables, memory):
    """Handle a frame of the table; True: it was the last that the open cycle waited for."""
    state, sources, frames = memory.state, memory.sources, tables.frames
    header = words[row, 1]
    is_fd = ((header >> 40) & FD_FDF) != 0
    if (header >> 32) & 0xFF != frames[f, SIZE] or is_fd != (frames[f, IS_FD] != 0):
        drop(memory, f, SHORT)
        return False
    if frames[f, CRC + MASK] and (
        frame_crc(data, row, frames, f) != read_bits(data, row, frames, f, CRC)
    ):
        drop(memory, f, CRC_FAILED)
        return False
    sequence = np.int64(-1)
    if frames[f, SEQUENCE + MASK]:
        sequence = np.int64(read_bits(data, row, frames, f, SEQUENCE))
        if frames[f, ECHOES]:
            is_taken = accept_echo(f, sequence, row, data, tables, memory)
        else:
            is_taken = accept_count(f, sequence, row, data, tables, memory)
    else:
        is_taken = accept_plain(f, memory)
    if not is_taken:
        return False
    stamp = state[LAST_STAMP]
    if state[STAMP] < 0:
        state[STAMP] = stamp
    state[BUSY] = 1
    sources[f, DROPPED] = 0
    sources[f, TAKEN_AT] = state[NUMBER]
    for k in range(np.int64(frames[f, SIZE])):
        memory.last[f, k] = data[row, PAYLOAD + k]
    count(memory, f, DATA)
    stage(f, sequence, stamp, row, data, tables, memory)
    if sources[f, WAITED_FOR]:
        sources[f, WAITED_FOR] = 0
        state[WAITING] -= 1
        return state[WAITING] == 0
    return False


def _feed(row, words, data, tables, memory, shown):
    """Frames from `row` on; stops when a cycle closes, and returns the row to go on from."""
    state, totals = memory.state, memory.totals
    state[CLOSED_BY] = BY_NOTHING
    while row < words.shape[0]:
        header = words[row, 1]
        can_id, bus = header & 0xFFFF_FFFF, (header >> 56) & 0xFF
        if can_id & CAN_ERR:
            totals[ERROR] += 1
            # Class CRTL with RX_OVERFLOW in its second byte (linux/can/error.h).
            if can_id & 4 and (header >> 32) & 0xFF > 1 and data[row, PAYLOAD + 1] & 1:
                totals[OVERFLOW] += 1
        elif can_id & CAN_RTR:
            totals[REMOTE] += 1
        elif bus >= tables.standard.shape[0]:
            totals[FOREIGN] += 1
        elif (header >> 48) & ECHO and can_id != memory.syncs[bus, SYNC_IDENTIFIER]:
            totals[ECHOED] += 1
        else:
            if 0 <= words[row, 0] < STAMP_MAX:
                state[LAST_STAMP] = words[row, 0]
            if state[FREE] and not state[OWN_CLOCK] and is_tick(state[LAST_STAMP], memory):
                close_cycle(BY_DEADLINE, tables, memory, shown)
                return row
            f = find(bus, can_id, tables)
            if f >= 0:
                f = page_of(f, row, data, tables.frames)
            if can_id == memory.syncs[bus, SYNC_IDENTIFIER]:
                if not take_sync(bus, row, words, data, tables, memory):
                    close_cycle(BY_SYNC, tables, memory, shown)
                    return row
            elif f >= 0:
                if take_data(f, row, words, data, tables, memory):
                    close_cycle(BY_COMPLETE, tables, memory, shown)
                    return row + 1
            elif FIRST_HEARTBEAT <= can_id <= LAST_HEARTBEAT:
                totals[HEARTBEAT] += 1
            elif can_id == CONFIGURATION_ID:
                totals[CONFIGURATION] += 1
            else:
                totals[FOREIGN] += 1
        row += 1
    return row


_tables = numba.typeof(
    Tables(
        frames=np.zeros((0, 0), np.uint32),
        signals=np.zeros((0, 0), np.int32),
        units=np.zeros((0, 0), np.int32),
        standard=np.zeros((0, 0), np.int32),
        extended=np.zeros((0, 0), np.int64),
        groups=np.zeros((0, 0), np.int32),
        parts=np.zeros(0, np.int32),
    )
)
_memory = numba.typeof(
    Memory(
        state=np.zeros(0, np.int64),
        syncs=np.zeros((0, 0), np.int64),
        sources=np.zeros((0, 0), np.int64),
        last=np.zeros((0, 0), np.uint8),
        sets=np.zeros((0, 0), np.int64),
        units=np.zeros((0, 0), np.int64),
        totals=np.zeros(0, np.int64),
        tallies=np.zeros((0, 0), np.int64),
        gathered=np.zeros(0, np.int16),
        gathered_codes=np.zeros(0, np.uint8),
        staged=np.zeros(0, np.int16),
        staged_codes=np.zeros(0, np.uint8),
        staged_sequence=np.zeros(0, np.uint8),
    )
)
_shown = numba.typeof(
    Shown(
        counts=np.zeros((0, 0), np.int16),
        valid=np.zeros(0, np.bool_),
        status=np.zeros(0, np.uint16),
        age=np.zeros(0, np.int32),
        sequence=np.zeros(0, np.uint8),
        fault_code=np.zeros(0, np.uint8),
    )
)
_int = types.int64
_words, _data = types.int64[:, ::1], types.uint8[:, ::1]
_words_in = types.Array(types.int64, 2, "C", readonly=True)
_data_in = types.Array(types.uint8, 2, "C", readonly=True)
_table, _units = types.uint32[:, ::1], types.int32[:, ::1]
_signals = types.int32[:, ::1]
_counts, _codes = types.int16[::1], types.uint8[::1]
_counts_in = types.Array(types.int16, 2, "A", readonly=True)
_codes_in = types.Array(types.uint8, 1, "A", readonly=True)


def _compiled(kernel, *signature):
    # Without numba's run-time memory nothing can allocate, and no array's references are counted
    # at each use of a tuple, which costs several times the work itself. Kernels go into each other,
    # since a call between them would hand over the insides of all arrays.
    flags = {"error_model": "numpy", "nogil": True, "cache": True}
    return njit(*signature, forceinline=True, _nrt=False, **flags)(kernel)


crc16 = _compiled(_crc16, _int(_int, _data_in, _int, _int, _int))
frame_crc = _compiled(_frame_crc, _int(_data_in, _int, _table, _int))
low_first = _compiled(_low_first)
high_first = _compiled(_high_first)
read_bits = _compiled(_read_bits)
write_bits = _compiled(_write_bits)
unpack_frame = _compiled(
    _unpack_frame,
    types.void(_data_in, _int, _int, _table, _signals, _units, _counts, _codes),
)
pack = _compiled(
    _pack,
    types.void(_int, _int, _int, _int, _counts_in, _codes_in, _table, _signals, _words, _data),
)
count = _compiled(_count)
drop = _compiled(_drop)
find = _compiled(_find)
page_of = _compiled(_page_of)
sync_number = _compiled(_sync_number)
open_cycle = _compiled(_open_cycle)
is_other_payload = _compiled(_is_other_payload)
repeat = _compiled(_repeat)
lose = _compiled(_lose)
accept_echo = _compiled(_accept_echo)
accept_count = _compiled(_accept_count)
accept_plain = _compiled(_accept_plain)
tear = _compiled(_tear)
clear_codes = _compiled(_clear_codes)
stage = _compiled(_stage)
close_sources = _compiled(_close_sources)
show_units = _compiled(_show_units)
close_cycle = _compiled(_close_cycle, types.void(_int, _tables, _memory, _shown))
is_tick = _compiled(_is_tick)
take_sync = _compiled(_take_sync)
take_data = _compiled(_take_data)
feed = _compiled(_feed, _int(_int, _words_in, _data_in, _tables, _memory, _shown))
