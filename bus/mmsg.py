"""Many frames per system call: `recvmmsg`, `sendmmsg` and `ppoll`, compiled, without the GIL.

The system calls are symbols of the C library, which only machine code can call: the functions that
call them have no Python version. Code that can run in Python is separate (`finish_records_python`,
`stage_python`): it converts the kernel's structures into records, and back. ctypes is not used,
since its addresses would prevent caching by numba.

Frames are rows of FRAME_DTYPE, seen as words of int64, shape (m, 10) (`bus.frame.as_words`). The
kernel writes its `struct canfd_frame` from the second word of a row on. A call moves up to BATCH
frames, through the `Buffers` of its direction.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numba import typeof, types

from bus.compiled.jit import compiled, jitable
from bus.frame import CAN_ERR, ECHO, FD_BRS, FD_ESI, FD_FDF

BATCH = 256
CLASSIC_SIZE, FD_SIZE = 16, 72
"""`struct can_frame` and `struct canfd_frame`: the size of a message gives the kind of frame."""

MESSAGE = np.dtype(
    [
        (name, np.int64)
        for name in (
            "name", "name_size", "vectors", "vector_count", "control", "control_size", "flags",
            "size",
        )
    ]
)  # fmt: skip
"""`struct mmsghdr` of a 64-bit Linux, little endian: addresses, and sizes with their padding."""
VECTOR = np.dtype([("base", np.int64), ("size", np.int64)])
"""`struct iovec`."""
REPORT = np.dtype(
    [
        ("drops", np.int64),  # the socket's drop counter, modulo 2^32; kept until it changes
        ("errno", np.int64),  # reason of an early end, 0: none
        ("errors", np.int64),  # error frames among those received
    ]
)
"""Results of a call in addition to the number of frames."""
CLOCK = np.dtype(
    [
        ("origin", np.int64),  # of the map from hardware stamps to the kernel's, `bus.clock`
        ("offset", np.int64),
        ("drift", np.float64),
        ("is_mapped", np.int64),  # whether there is a map
        ("count", np.int64),  # pairs of stamps in this segment
        ("stamp", np.int64),  # stamps of the pair with the least delay by the map
        ("late", np.int64),
    ]
)
"""Map of the interface's own clock, and its current segment."""
_CONTROL_BYTES = 128
# Control messages as level | type << 32, level SOL_SOCKET.
_TIME_STAMP = 1 | 35 << 32
_DROPPED = 1 | 40 << 32
_HARDWARE = 1 | 37 << 32
_MSG_CONFIRM = 0x800  # on a frame sent by this socket
_MSG_DONTWAIT = 0x40
_POLLIN = 1
_EINTR, _EAGAIN = 4, 11
_LOW = 0xFFFF_FFFF


class Buffers(NamedTuple):
    """The arrays of one direction of a socket, one row a message; for one thread at a time."""

    messages: np.ndarray
    """Shape (BATCH,), MESSAGE."""
    vectors: np.ndarray
    """Shape (BATCH,), VECTOR: of one each."""
    control: np.ndarray
    """Shape (BATCH, 16), int64: time stamps and drop counter, as control messages."""
    staged: np.ndarray
    """Shape (BATCH, 9), int64: frames to be sent."""
    report: np.ndarray
    """Shape (1,), REPORT."""
    clock: np.ndarray
    """Shape (1,), CLOCK."""


def new_buffers() -> Buffers:
    """Buffers whose messages point to their vectors."""
    into = Buffers(
        messages=np.zeros(BATCH, MESSAGE),
        vectors=np.zeros(BATCH, VECTOR),
        control=np.zeros((BATCH, _CONTROL_BYTES // 8), np.int64),
        staged=np.zeros((BATCH, FD_SIZE // 8), np.int64),
        report=np.zeros(1, REPORT),
        clock=np.zeros(1, CLOCK),
    )
    vectors = into.vectors
    into.messages["vectors"] = vectors.ctypes.data + vectors.itemsize * np.arange(BATCH)
    into.messages["vector_count"] = 1
    return into


@jitable
def by_hardware(hardware, stamp, clock):
    """The stamp of a frame by the interface's own clock, once it is mapped; the pair of stamps
    updates the segment."""
    ahead = np.int64(round(clock["drift"] * (hardware - clock["origin"])))
    mapped = hardware + clock["offset"] + ahead
    ahead = np.int64(round(clock["drift"] * (clock["stamp"] - clock["origin"])))
    best = clock["stamp"] + clock["offset"] + ahead
    if clock["count"] == 0 or stamp - mapped < clock["late"] - best:
        clock["stamp"], clock["late"] = hardware, stamp
    clock["count"] += 1
    # a frame is never received before its stamp: a clock was set
    return min(mapped, stamp) if clock["is_mapped"] else stamp


@jitable
def finish_records_python(count, first, index, words, buffers):
    """Complete `count` records written by the kernel, from row `first` on."""
    # The bus index goes to the top byte of a signed word.
    bus = ((index ^ 0x80) - 0x80) << 56
    control, report = buffers.control, buffers.report[0]
    for i in range(count):
        row, message = first + i, buffers.messages[i]
        stamp, hardware, place, end = 0, 0, 0, message["control_size"] // 8
        while place + 2 < end and control[i, place] > 16:
            kind = control[i, place + 1]
            if kind == _TIME_STAMP:
                stamp = control[i, place + 2] * 1_000_000_000 + control[i, place + 3]
            elif kind == _DROPPED:
                report["drops"] = control[i, place + 2] & _LOW
            elif kind == _HARDWARE:  # of three stamps the last; 0 where there is none
                hardware = control[i, place + 6] * 1_000_000_000 + control[i, place + 7]
            place += (control[i, place] + 7) // 8
        header = words[row, 1]
        identifier, length, flags = header & _LOW, (header >> 32) & 0xFF, 0
        if message["size"] & _LOW == FD_SIZE:
            length = min(length, 64)
            flags = (header >> 40) & (FD_BRS | FD_ESI) | FD_FDF
        else:
            length = min(length, 8)
        origin = ECHO if message["flags"] & _MSG_CONFIRM else 0
        if identifier & CAN_ERR:
            report["errors"] += 1
        words[row, 0] = by_hardware(hardware, stamp, buffers.clock[0]) if hardware else stamp
        words[row, 1] = identifier | length << 32 | flags << 40 | origin << 48 | bus


@jitable
def stage_python(count, first, words, buffers):
    """Write `count` records, from row `first` on, into the messages of one call.

    Origin and bus are removed, since the kernel uses their bytes otherwise; so are the undefined
    bytes past the length, which an FD frame would carry to the bus.
    """
    staged = buffers.staged
    for i in range(count):
        header, vector = words[first + i, 1], buffers.vectors[i]
        is_fd = (header >> 40) & FD_FDF != 0
        length = (header >> 32) & 0xFF
        staged[i, 0] = header & (0xFFFF_FFFF_FFFF if is_fd else 0xFF_FFFF_FFFF)
        for k in range(8):
            valid = length - 8 * k
            word = words[first + i, k + 2]
            if valid <= 0:
                word = 0
            elif valid < 8:
                word &= (1 << 8 * valid) - 1
            staged[i, k + 1] = word
        vector["base"] = staged.ctypes.data + FD_SIZE * i
        vector["size"] = FD_SIZE if is_fd else CLASSIC_SIZE
        buffers.messages[i]["control_size"] = 0


carray: Any = getattr(numba, "carray")  # noqa: B009, missing in numba's stubs
_int, _pointer, _unsigned = types.int32, types.intp, types.uint32
_recvmmsg = types.ExternalFunction("recvmmsg", _int(_int, _pointer, _unsigned, _int, _pointer))
_sendmmsg = types.ExternalFunction("sendmmsg", _int(_int, _pointer, _unsigned, _int))
_ppoll = types.ExternalFunction("ppoll", _int(_pointer, types.uint64, _pointer, _pointer))
_errno_place = types.ExternalFunction("__errno_location", types.CPointer(_int)())


@jitable
def _errno():
    """errno of the last call of this thread."""
    return carray(_errno_place(), 1)[0]


_long = types.int64
_rows, _flat = types.int64[:, ::1], types.int64[::1]
_rows_in = types.Array(types.int64, 2, "C", readonly=True)
_buffers = typeof(new_buffers())


@jitable
def _wait(polled, timeout_ns):
    """Wait until a descriptor is readable.

    Parameters
    ----------
    polled : ndarray, shape (2 + m,), int64
        From `pollfds`.
    timeout_ns : int

    Returns
    -------
    int
        Number of readable descriptors; 0 after the timeout, or on a signal.
    """
    polled[0], polled[1] = timeout_ns // 1_000_000_000, timeout_ns % 1_000_000_000
    limit = polled.ctypes.data
    return max(_ppoll(limit + 16, polled.size - 2, limit, 0), 0)


def _receive(fd, polled, timeout_ns, first, room, index, words, buffers):
    """Receive waiting frames, at most `room`, into rows from `first` on.

    Waits up to `timeout_ns` for the first frame, or until another descriptor of `polled` is
    readable. An error of the socket ends the call; `report` has it, and earlier frames are
    returned.

    Returns
    -------
    int
        Number of frames.
    """
    report, control = buffers.report[0], buffers.control
    report["errno"] = report["errors"] = 0
    total = 0
    while total < room:
        wanted = min(room - total, BATCH)
        base = words.ctypes.data + words.strides[0] * (first + total) + 8
        for i in range(wanted):
            vector, message = buffers.vectors[i], buffers.messages[i]
            vector["base"] = base + words.strides[0] * i
            vector["size"] = FD_SIZE
            message["control"] = control.ctypes.data + _CONTROL_BYTES * i
            message["control_size"] = _CONTROL_BYTES
        got = _recvmmsg(fd, buffers.messages.ctypes.data, wanted, _MSG_DONTWAIT, 0)
        if got < 0:
            errno = _errno()
            if errno == _EINTR:
                continue
            if errno != _EAGAIN:
                report["errno"] = errno
            elif total == 0 and timeout_ns > 0:
                _wait(polled, timeout_ns)
                timeout_ns = 0
                continue
            break
        finish_records_python(got, first + total, index, words, buffers)
        total += got
        if got < wanted:
            break
    return total


def _send(fd, first, count, words, buffers):
    """Send up to BATCH of `count` records, from row `first` on, without waiting.

    Returns
    -------
    int
        Number of accepted frames; if it is less than `count`, `report` has the reason, once the
        first frame of a call is refused.
    """
    report = buffers.report[0]
    report["errno"] = 0
    count = min(count, BATCH)
    stage_python(count, first, words, buffers)
    taken = _sendmmsg(fd, buffers.messages.ctypes.data, count, _MSG_DONTWAIT)
    if taken < 0:
        report["errno"] = _errno()
        return 0
    return taken


_received = _long(_long, _flat, _long, _long, _long, _long, _rows, _buffers)
wait = compiled(_wait, [_long(_flat, _long)])
receive = compiled(_receive, [_received])
send = compiled(_send, [_long(_long, _long, _long, _rows_in, _buffers)])


def pollfds(*descriptors: int) -> np.ndarray:
    """A `struct timespec`, then a `struct pollfd` for each of m descriptors.

    Returns
    -------
    ndarray, shape (2 + m,), int64
    """
    return np.array([0, 0] + [fd | _POLLIN << 32 for fd in descriptors], np.int64)
