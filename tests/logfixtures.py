"""Frames of all kinds as hypothesis draws them, as python-can's messages, and BLF files by hand."""

import struct
import zlib

import can
import numpy as np
from hypothesis import strategies as st

from bus import FRAME_DTYPE
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, ECHO, FD_BRS, FD_ESI, FD_FDF

BUSES = 3
CHANNELS = {f"can{i}": i for i in range(BUSES)}
IDENTIFIER = 0x1FFFFFFF
BUS_ERROR = 0x80
LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)

identifiers = st.one_of(
    st.integers(0, 0x7FF), st.integers(0, IDENTIFIER).map(lambda number: number | CAN_EFF)
)
microseconds = st.integers(0, 4_000_000_000_000_000)


@st.composite
def frame(draw, errors=True):
    """One frame as a tuple in the order of FRAME_DTYPE."""
    kind = draw(st.sampled_from(["data", "remote", "fd"] + errors * ["error"]))
    can_id, flags = draw(identifiers), 0
    length = draw(st.sampled_from(LENGTHS if kind == "fd" else range(9)))
    origin = draw(st.sampled_from([0, ECHO]))
    data = draw(st.binary(min_size=length, max_size=length))
    if kind == "fd":
        flags = FD_FDF | draw(st.sampled_from([0, FD_BRS, FD_ESI, FD_BRS | FD_ESI]))
    elif kind == "remote":
        can_id, data = can_id | CAN_RTR, b""
    elif kind == "error":
        can_id, length, origin = CAN_ERR | draw(st.integers(1, IDENTIFIER)), 8, 0
        data = draw(st.binary(min_size=8, max_size=8))
    stamp = 1000 * draw(microseconds)
    return stamp, can_id, length, flags, origin, draw(st.integers(0, BUSES - 1)), data


def frames(errors=True):
    """Strategy of many frames, as records, in the order of their stamps."""
    return st.lists(frame(errors), max_size=20).map(lambda rows: records(*sorted(rows)))


def records(*rows):
    """Make records of tuples in the order of FRAME_DTYPE."""
    made = np.zeros(len(rows), FRAME_DTYPE)
    for record, row in zip(made, rows, strict=True):
        *head, data = row
        for name, value in zip(FRAME_DTYPE.names, head, strict=False):
            record[name] = value
        record["data"][: len(data)] = np.frombuffer(data, np.uint8)
    return made


def rows(found):
    """Show records as tuples, the data as far as it counts."""
    return [
        (*row[:6], b"" if row[1] & CAN_RTR else bytes(row[6][: row[2]])) for row in found.tolist()
    ]


def messages(found):
    """Records as python-can's messages."""
    return [
        can.Message(
            timestamp=stamp / 1e9,
            arbitration_id=can_id & IDENTIFIER,
            is_extended_id=bool(can_id & CAN_EFF),
            is_remote_frame=bool(can_id & CAN_RTR),
            is_error_frame=bool(can_id & CAN_ERR),
            is_fd=bool(flags & FD_FDF),
            bitrate_switch=bool(flags & FD_BRS),
            error_state_indicator=bool(flags & FD_ESI),
            is_rx=not origin,
            channel=f"can{bus}",
            dlc=length,
            data=None if can_id & CAN_RTR else data,
        )
        for stamp, can_id, length, flags, origin, bus, data in rows(found)
    ]


def from_messages(read):
    """python-can's messages as records."""
    return records(
        *(
            (
                1000 * round(1e6 * message.timestamp),
                message.arbitration_id
                | CAN_ERR * message.is_error_frame
                | CAN_EFF * (message.is_extended_id and not message.is_error_frame)
                | CAN_RTR * message.is_remote_frame,
                message.dlc,
                FD_FDF * message.is_fd
                | FD_BRS * message.bitrate_switch
                | FD_ESI * message.error_state_indicator,
                0 if message.is_rx else ECHO,
                int(str(message.channel or 0).removeprefix("can")),
                bytes(message.data),
            )
            for message in read
        )
    )


def write_by_pythoncan(path, found):
    """Write records by python-can's writer for the path's suffix."""
    with can.Logger(path) as writer:
        for message in messages(found):
            writer(message)


def blf_object(kind, contents, *, stamp=0, resolution=2, version=1, size=None, head=None):
    """Make one object; `size` and `head` lie about its own and its header's length."""
    times = struct.pack("<LHHQ", resolution, 0, 0, stamp) + bytes(8 * (version == 2))
    length = 16 + len(times)
    total = length + len(contents) if size is None else size
    start = struct.pack("<4sHHLL", b"LOBJ", length if head is None else head, version, total, kind)
    return start + times + contents


def blf_container(contents, *, packed=True, method=None, size=None):
    """Make a container with its padding."""
    body = zlib.compress(contents) if packed else contents
    method = 2 * packed if method is None else method
    total = 32 + len(body) if size is None else size
    head = struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, total, 10, method, len(contents))
    return head + body + bytes(total % 4)


def blf_file(*parts, date=(2024, 2, 4, 29, 12, 30, 15, 250), length=None, objects=0):
    """Make a file of whole objects; `length` is what its head tells."""
    body = b"".join(parts)
    told = 144 + len(body) if length is None else length
    head = struct.pack(
        "<4sL8BQQLL8H8H", b"LOGG", 144, 5, 0, 0, 0, 2, 6, 8, 1, told, 0, objects, 0, *date, *date
    )
    return head.ljust(144, b"\0") + body


def can_message(can_id=0x123, data=b"\x01\x02\x03", *, channel=1, flags=0, kind=1, **fields):
    """Make a CAN_MESSAGE or CAN_MESSAGE2."""
    contents = struct.pack("<HBBL8s", channel, flags, len(data), can_id, data)
    return blf_object(kind, contents + bytes(8 * (kind == 86)), **fields)


BAD_LINES = [
    b"(1.0) can0 123#11\n" + line + b"\n"
    for line in (
        b"no candump", b"(", b"(1", b"(1)", b"(.5)", b"(1.", b"(1.2", b"(1.2)",
        b"(1.1234567890) can0 1",
        b"(9999999999.0) can0 123#", b"(1.2) ", b"(1.2) can0", b"(1.2) " + b"x" * 64 + b" 123#",
        b"(1.2) can0 ", b"(1.2) can0 12#", b"(1.2) can0 1234#", b"(1.2) can0 123456789#",
        b"(1.2) can0 800#", b"(1.2) can0 40000000#", b"(1.2) can0 123", b"(1.2) can0 123x11",
        b"(1.2) can0 123##", b"(1.2) can0 123#1", b"(1.2) can0 123#1x",
        b"(1.2) can0 123#112233445566778899",
        b"(1.2) can0 123##4" + b"00" * 65, b"(1.2) can0 123#R9", b"(1.2) can0 123#11 X",
        b"(1.2) can0 123#11 R R", b"(1.2) can0 123#11_9", b"(1.2) can0 123#11\rx", b"\r\r",
        b"(1.2) can0 45123#81:00:12345678#1122", b"(1.2) can0 123   [2]  11 22",
        b"(0000000001.2) can0 123   8", b"(0000000001.2) can0 123   [9]  11",
        b"(0000000001.2) can0 123   [A]  11", b"(0000000001.2) can0 123   [1x]  11",
        b"(0000000001.2) can0 123   [65]  11", b"(0000000001.2) can0 123   [x]  11",
        b"(0000000001.2) can0 123   {12}  11", b"(0000000001.2) can0 123   [2]  11",
        b"(0000000001.2) can0 123   [2]  1122", b"(0000000001.2) can0 123   [2]  11`22",
        b"(0000000001.2) can0 123   [1]  11 22", b"(0000000001.2) can0 123   [1]  31   'a",
        b"(0000000001.2) can0 123   [1]  31   'ab'", b"(0000000001.2) can0 RX 123 [1]  31",
        b"(0000000001.2) can0 RT - -  123 [1]  31", b"(0000000001.2) can0 RX x -  123 [1]  31",
        b"(0000000001.2) can0 RX - x  123 [1]  31", b"(0000000001.2) can0 RX - -  123#31",
        b"(0000000001.2) can0 123   [1]  31   ERRORFRAME", b"\xff\xfe(",
    )
]  # fmt: skip
"""Logs whose second line is wrong."""

CANDUMP_FRAMES = [  # identifier, length, flags, data
    (0x123, 3, 0, b"\x11\x22\x33"),
    (0, 0, 0, b""),
    (0x7FF, 8, 0, b"12345678"),
    (0x1ABCDEF | CAN_EFF, 1, 0, b"\xff"),
    (0x123 | CAN_RTR, 0, 0, b""),
    (0x1FFFFFFF | CAN_EFF | CAN_RTR, 8, 0, b""),
    (CAN_ERR | 0x88, 8, 0, bytes(range(8))),
    (0x124, 0, FD_FDF, b""),
    (0x124, 12, FD_FDF | FD_BRS, bytes(range(12))),
    (0x1ABCDEF | CAN_EFF, 64, FD_FDF | FD_ESI, bytes(range(64))),
    (0x125, 8, FD_FDF | FD_BRS | FD_ESI, bytes(8)),
]
"""What was sent while candump wrote the logs `kinds-*`."""
CANDUMP_WAYS = {
    "L": ("-L",),
    "L-x": ("-L", "-x"),
    "shown": ("-t", "a"),
    "shown-x": ("-t", "a", "-x"),
    "shown-a": ("-t", "a", "-a"),
}
"""How candump was told to write them."""


def check_candump(found, way):
    """Check that the log of one way was read as the frames that were sent."""
    assert len(found) == len(CANDUMP_FRAMES)
    assert (np.diff(found["stamp_ns"]) > 0).all()
    known = FD_FDF if way in ("shown", "shown-a") else FD_FDF | FD_BRS | FD_ESI
    origin = ECHO if way.endswith("-x") else 0
    for row, (can_id, length, flags, data) in zip(rows(found), CANDUMP_FRAMES, strict=True):
        assert row[1:] == (can_id, length, flags & known, origin, 0, data)
