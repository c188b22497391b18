"""All compiled code of the bus: CRC, packing and unpacking of frames.

One file, because numba's cache does not see a change in another one. Each kernel is a plain
function and, at the end of the file, one line that compiles it.

A batch of m frames enters as two views of the same memory (`as_words`, `as_bytes`): `words`, shape
(m, 10), int64, holds the time stamp in column 0 and identifier, length, flags, origin and bus in
column 1; `data`, shape (m, 80), uint8, holds everything byte by byte. The tables are those of
`bus.table.FrameTable`; its columns are named here. n units, f frames.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

from bus.frame import FRAME_DTYPE

PAYLOAD = FRAME_DTYPE.fields["data"][1]
"""Place of the first data byte in a record."""
CHANNEL_COUNT = 6
UNIT_STATUS = CHANNEL_COUNT
"""Target of a signal that is no channel but the unit's own status."""

# A field: three bytes of the record, least significant first, shifted right and masked.
BYTE0, BYTE1, BYTE2, SHIFT, MASK = range(5)
FIELD_WIDTH = 5
# Columns of `signals`; the first five are a field.
SIGN, TARGET, SLOT = range(FIELD_WIDTH, FIELD_WIDTH + 3)
SIGNAL_COLUMNS = FIELD_WIDTH + 3
# Columns of `frames`; the last three are fields of five columns each, mask 0 where there is none.
BUS, IDENTIFIER, SIZE, IS_FD, FIRST_SIGNAL, END_SIGNAL, GROUP, PART, AWAITED, ECHOES, CRC_PLACE = (
    range(11)
)
SEQUENCE = 11
STATUS = SEQUENCE + FIELD_WIDTH
CRC = STATUS + FIELD_WIDTH
FRAME_COLUMNS = CRC + FIELD_WIDTH

FLAG_FD, FLAG_BRS = 4, 1


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
    """View of FRAME_DTYPE records, contiguous, as int64, shape (m, 10)."""
    return records.view(np.int64).reshape(-1, FRAME_DTYPE.itemsize // 8)


def as_bytes(records: np.ndarray) -> np.ndarray:
    """View of FRAME_DTYPE records, contiguous, as uint8, shape (m, 80)."""
    return records.view(np.uint8).reshape(-1, FRAME_DTYPE.itemsize)


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
    begin, place = PAYLOAD, frames[f, CRC_PLACE]
    end = begin + frames[f, SIZE]
    crc = np.int64(0xFFFF)
    for k in range(2):
        byte = (frames[f, IDENTIFIER] >> (8 * k)) & 0xFF
        crc = ((crc << 8) & 0xFFFF) ^ np.int64(CRC_TABLES[0, (crc >> 8) ^ byte])
    crc = crc16(crc, data, row, begin, place)
    return crc16(crc, data, row, place + 2, end)


def _read_bits(data, row, table, t, k):
    """The unsigned integer in the field at table[t, k:k + 5]."""
    word = (
        np.int64(data[row, table[t, k + BYTE0]])
        | np.int64(data[row, table[t, k + BYTE1]]) << 8
        | np.int64(data[row, table[t, k + BYTE2]]) << 16
    )
    return (word >> table[t, k + SHIFT]) & table[t, k + MASK]


def _write_bits(value, data, row, table, t, k):
    """Set the bits of a field, which are 0, to the low bits of `value`."""
    word = (value & table[t, k + MASK]) << table[t, k + SHIFT]
    data[row, table[t, k + BYTE0]] |= word & 0xFF
    data[row, table[t, k + BYTE1]] |= (word >> 8) & 0xFF
    data[row, table[t, k + BYTE2]] |= (word >> 16) & 0xFF


def _unpack_frame(data, row, f, frames, signals, units, counts, codes):
    """Channels of one frame into `counts` (c, n); fault codes, where not 0, into `codes` (n,)."""
    board = min(read_bits(data, row, frames, f, STATUS), 255)
    if board != 0:
        for slot in range(units.shape[1]):
            if units[f, slot] >= 0:
                codes[units[f, slot]] = board
    for k in range(frames[f, FIRST_SIGNAL], frames[f, END_SIGNAL]):
        unit = units[f, signals[k, SLOT]]
        if unit < 0:
            continue
        value = read_bits(data, row, signals, k, 0)
        if signals[k, TARGET] < UNIT_STATUS:
            counts[signals[k, TARGET], unit] = (value ^ signals[k, SIGN]) - signals[k, SIGN]
        elif value != 0:
            codes[unit] = min(value, 255)


def _pack(first, end, sequence, stamp, counts, codes, frames, signals, units, words, data):
    """Frames first … end - 1 of the table into rows 0 … of `words` and `data`."""
    for f in range(first, end):
        row = f - first
        words[row, 0] = stamp
        for k in range(4):
            data[row, 8 + k] = (frames[f, IDENTIFIER] >> (8 * k)) & 0xFF
        data[row, 12] = frames[f, SIZE]
        data[row, 13] = (FLAG_FD | FLAG_BRS) if frames[f, IS_FD] else 0
        data[row, 14] = 0
        data[row, 15] = frames[f, BUS]
        for k in range(PAYLOAD, data.shape[1]):
            data[row, k] = 0
        write_bits(sequence, data, row, frames, f, SEQUENCE)
        for k in range(frames[f, FIRST_SIGNAL], frames[f, END_SIGNAL]):
            unit = units[f, signals[k, SLOT]]
            if unit < 0:
                continue
            target, sign, mask = signals[k, TARGET], signals[k, SIGN], signals[k, MASK]
            value = np.int64(codes[unit] if target == UNIT_STATUS else counts[target, unit])
            low, high = (-sign, sign - 1) if sign else (0, mask)
            write_bits(min(max(value, low), high), data, row, signals, k, 0)
        if frames[f, CRC + MASK]:
            write_bits(frame_crc(data, row, frames, f), data, row, frames, f, CRC)


_FLAGS = {"error_model": "numpy", "nogil": True, "cache": True}
_int = types.int64
_words, _data = types.int64[:, ::1], types.uint8[:, ::1]
_data_in = types.Array(types.uint8, 2, "C", readonly=True)
_table = types.Array(types.int32, 2, "C", readonly=True)
_counts, _codes = types.int16[:, ::1], types.uint8[::1]
_counts_in = types.Array(types.int16, 2, "A", readonly=True)
_codes_in = types.Array(types.uint8, 1, "A", readonly=True)

crc16 = njit(_int(_int, _data_in, _int, _int, _int), **_FLAGS)(_crc16)
frame_crc = njit(_int(_data_in, _int, _table, _int), **_FLAGS)(_frame_crc)
read_bits = njit(_int(_data_in, _int, _table, _int, _int), **_FLAGS)(_read_bits)
write_bits = njit(types.void(_int, _data, _int, _table, _int, _int), **_FLAGS)(_write_bits)
unpack_frame = njit(
    types.void(_data_in, _int, _int, _table, _table, _table, _counts, _codes), **_FLAGS
)(_unpack_frame)
pack = njit(
    types.void(
        _int, _int, _int, _int, _counts_in, _codes_in, _table, _table, _table, _words, _data
    ),
    **_FLAGS,
)(_pack)
