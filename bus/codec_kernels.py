"""Compiled code of packing and unpacking: CRC, bit fields, whole frames.

`data` is that of `bus.frame.FrameViews`, tables are those of `bus.table.Tables`. n units, c
channels.
"""

from __future__ import annotations

import numpy as np
from numba import typeof, types

from bus.compiled.jit import compiled, jitable
from bus.frame import FD_BRS, FD_FDF, PAYLOAD, FrameViews
from bus.table import BYTE_AT, EXPECTED, EXTENDED, SHIFT_MASK, SIGNAL, SWAPPED, Tables

__all__ = ["TABLES", "crc16_python", "frame_crc_python", "pack", "unpack_frame"]


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


@jitable
def crc16_python(crc, data, row, begin, end):
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


@jitable
def frame_crc_python(data, row, expected):
    """CRC of a frame: its identifier's low 16 bits, low byte first, then all but the crc itself."""
    begin, place = PAYLOAD, np.int64(expected["crc_place"])
    end = begin + np.int64(expected["size"])
    crc = np.int64(0xFFFF)
    for k in range(2):
        byte = (np.int64(expected["identifier"]) >> (8 * k)) & 0xFF
        crc = ((crc << 8) & 0xFFFF) ^ np.int64(CRC_TABLES[0, (crc >> 8) ^ byte])
    crc = crc16_python(crc, data, row, begin, place)
    return crc16_python(crc, data, row, place + 2, end)


@jitable
def little_endian(data, row, byte):
    """Four bytes of a record as one number, in one load: the compiler merges the shifts."""
    return (
        np.uint32(data[row, byte])
        | (np.uint32(data[row, byte + np.uintp(1)]) << np.uint32(8))
        | (np.uint32(data[row, byte + np.uintp(2)]) << np.uint32(16))
        | (np.uint32(data[row, byte + np.uintp(3)]) << np.uint32(24))
    )


@jitable
def big_endian(data, row, byte):
    """The same four bytes in the other order."""
    return (
        (np.uint32(data[row, byte]) << np.uint32(24))
        | (np.uint32(data[row, byte + np.uintp(1)]) << np.uint32(16))
        | (np.uint32(data[row, byte + np.uintp(2)]) << np.uint32(8))
        | np.uint32(data[row, byte + np.uintp(3)])
    )


@jitable
def read_bits(data, row, field):
    """The unsigned integer in a field."""
    row = np.uintp(row)
    where = np.uint32(field["where"])
    byte = np.uintp(where >> np.uint32(BYTE_AT))
    is_swapped = where & np.uint32(SWAPPED)
    word = big_endian(data, row, byte) if is_swapped else little_endian(data, row, byte)
    return np.int32((word >> (where & np.uint32(SHIFT_MASK))) & np.uint32(field["mask"]))


@jitable
def write_bits(value, data, row, field):
    """Set the bits of a field, which are 0, to the low bits of `value`."""
    where = np.int64(field["where"])
    word = (np.int64(value) & np.int64(field["mask"])) << (where & SHIFT_MASK)
    for i in range(4):
        place = 3 - i if where & SWAPPED else i
        data[row, (where >> BYTE_AT) + place] |= np.uint8((word >> (8 * i)) & 0xFF)


@jitable
def unpack_frame_python(data, row, f, tables, counts, codes):
    """Channels of one frame into `counts` (c * n,); fault codes, where not 0, into `codes` (n,)."""
    row, f = np.uintp(row), np.uintp(f)
    expected, units = tables.frames[f], tables.units
    if expected["status"]["mask"]:
        board = min(read_bits(data, row, expected["status"]), 255)
        if board != 0:
            for slot in range(units.shape[1]):
                if units[f, slot] >= 0:
                    codes[units[f, slot]] = board
    for k in range(np.uintp(expected["first_channel"]), np.uintp(expected["first_status"])):
        signal = tables.signals[k]
        value = read_bits(data, row, signal["field"])
        counts[np.uintp(signal["place"])] = (value ^ signal["flip"]) - signal["bias"]
    for k in range(np.uintp(expected["first_status"]), np.uintp(expected["end_status"])):
        signal = tables.signals[k]
        value = read_bits(data, row, signal["field"])
        if value != 0:
            codes[np.uintp(signal["unit"])] = min(value, 255)


def pack_python(first, end, sequence, stamp, counts, codes, tables, views):
    """Frames first … end - 1 of the tables into rows 0 … of the views.

    Parameters
    ----------
    first, end, sequence, stamp : int
        `stamp` in ns.
    counts : ndarray, shape (c, n), int16
    codes : ndarray, shape (n,), uint8
        Fault codes.
    tables : Tables
    views : FrameViews
        Written to.
    """
    words, data = views.words, views.data
    for f in range(first, end):
        row, expected = f - first, tables.frames[f]
        words[row, 0] = stamp
        for k in range(4):
            data[row, 8 + k] = (expected["identifier"] >> (8 * k)) & 0xFF
        data[row, 12] = expected["size"]
        data[row, 13] = (FD_FDF | FD_BRS) if expected["is_fd"] else 0
        data[row, 14] = 0
        data[row, 15] = expected["bus"]
        for k in range(PAYLOAD, data.shape[1]):
            data[row, k] = 0
        if expected["pages"]:
            data[row, PAYLOAD] = expected["page"]
        write_bits(sequence, data, row, expected["sequence"])
        for k in range(expected["first_channel"], expected["first_status"]):
            signal = tables.signals[k]
            most = np.int64(signal["field"]["mask"])
            count = np.int64(counts[signal["target"], signal["unit"]])
            value = min(max(count + signal["bias"], 0), most)
            write_bits(value ^ signal["flip"], data, row, signal["field"])
        for k in range(expected["first_status"], expected["end_status"]):
            signal = tables.signals[k]
            code = min(np.int64(codes[signal["unit"]]), np.int64(signal["field"]["mask"]))
            write_bits(code, data, row, signal["field"])
        if expected["crc"]["mask"]:
            write_bits(frame_crc_python(data, row, expected), data, row, expected["crc"])


TABLES = typeof(
    Tables(
        frames=np.zeros(0, EXPECTED),
        signals=np.zeros(0, SIGNAL),
        units=np.zeros((0, 0), np.int32),
        standard=np.zeros((0, 0), np.int32),
        extended=np.zeros(0, EXTENDED),
        groups=np.zeros((0, 0), np.int32),
        parts=np.zeros(0, np.int32),
    )
)
"""numba's type of `Tables`."""
_int = types.int64
_data_in = types.Array(types.uint8, 2, "C", readonly=True)
_views = typeof(FrameViews(np.zeros((0, 0), np.int64), np.zeros((0, 0), np.uint8)))
_counts, _codes = types.int16[::1], types.uint8[::1]
_counts_in = types.Array(types.int16, 2, "A", readonly=True)
_codes_in = types.Array(types.uint8, 1, "A", readonly=True)

# Without numba's run-time memory nothing can allocate, and references of arrays in a tuple are not
# counted, which would cost several times the work itself. Functions that kernels call are inlined,
# since a call would pass all fields of all arrays.
unpack_frame = compiled(
    unpack_frame_python,
    [types.void(_data_in, _int, _int, TABLES, _counts, _codes)],
)
pack = compiled(
    pack_python,
    [types.void(_int, _int, _int, _int, _counts_in, _codes_in, TABLES, _views)],
)
