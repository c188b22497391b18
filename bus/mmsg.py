"""Many frames a system call: `recvmmsg`, `sendmmsg` and `ppoll`, compiled, without the GIL.

The system calls are symbols of the C library, which only machine code can call: the functions that
make them are compiled where they stand and have no form in Python. What can be run as Python is
kept apart from them (`_settle`, `_stage`): plain functions that turn what the kernel wrote into
records, and records into what the kernel reads. No ctypes, whose addresses would keep numba from
caching.

Frames are rows of FRAME_DTYPE, 80 bytes, seen as words of int64, shape (m, 10). The kernel writes
its `struct canfd_frame` from the second word of a row on. A call moves up to BATCH frames; its
arrays (`Buffers`) are rows of one message each:

- `headers`, shape (BATCH, 8), int64: `struct mmsghdr` of a 64-bit Linux, little endian;
- `vectors`, shape (BATCH, 2), int64: `struct iovec`;
- `control`, shape (BATCH, 8), int64: time stamp and drop counter, as control messages;
- `report`, shape (REPORT_SIZE,), int64: what a call has to say beside the number of frames.
"""

from __future__ import annotations

import numpy as np
from numba import carray, njit, types

from bus.frame import CAN_ERR, ECHO, FD_BRS, FD_ESI, FD_FDF, FRAME_DTYPE

BATCH = 256
WORDS = FRAME_DTYPE.itemsize // 8
CLASSIC_SIZE, FD_SIZE = 16, 72
"""`struct can_frame` and `struct canfd_frame`: the size of a message tells the kind of frame."""

# Places of `report`.
DROPS = 0  # the socket's drop counter, modulo 2^32; kept until it changes
ERRNO = 1  # why a call ended early, 0: it did not
ERRORS = 2  # error frames among those received
REPORT_SIZE = 3

# Words of a header.
_VECTOR, _VECTOR_COUNT, _CONTROL, _CONTROL_SIZE, _FLAGS, _SIZE = 2, 3, 4, 5, 6, 7
_CONTROL_BYTES = 64
# Control messages as level | type << 32, level SOL_SOCKET.
_TIME_STAMP = 1 | 35 << 32
_DROPPED = 1 | 40 << 32
_MSG_CONFIRM = 0x800  # on a frame that this very socket has sent
_MSG_DONTWAIT = 0x40
_POLLIN = 1
_EINTR, _EAGAIN = 4, 11
_LOW = 0xFFFF_FFFF


class Buffers:
    """The arrays of one direction of a socket, set up once; not for two threads at a time."""

    def __init__(self) -> None:
        self.headers = np.zeros((BATCH, 8), np.int64)
        self.vectors = np.zeros((BATCH, 2), np.int64)
        self.control = np.zeros((BATCH, _CONTROL_BYTES // 8), np.int64)
        self.staged = np.zeros((BATCH, FD_SIZE // 8), np.int64)
        self.report = np.zeros(REPORT_SIZE, np.int64)
        rows = np.arange(BATCH)
        self.headers[:, _VECTOR] = self.vectors.ctypes.data + self.vectors.strides[0] * rows
        self.headers[:, _VECTOR_COUNT] = 1


def _settle(count, first, index, words, headers, control, report):
    """Complete `count` records that the kernel has written, from row `first` on."""
    # The bus index goes to the top byte of a signed word.
    bus = ((index ^ 0x80) - 0x80) << 56
    for i in range(count):
        row = first + i
        stamp, place, end = 0, 0, headers[i, _CONTROL_SIZE] // 8
        while place + 2 < end and control[i, place] > 16:
            kind = control[i, place + 1]
            if kind == _TIME_STAMP:
                stamp = control[i, place + 2] * 1_000_000_000 + control[i, place + 3]
            elif kind == _DROPPED:
                report[DROPS] = control[i, place + 2] & _LOW
            place += (control[i, place] + 7) // 8
        header = words[row, 1]
        identifier, length, flags = header & _LOW, (header >> 32) & 0xFF, 0
        if headers[i, _SIZE] & _LOW == FD_SIZE:
            length = min(length, 64)
            flags = (header >> 40) & (FD_BRS | FD_ESI) | FD_FDF
        else:
            length = min(length, 8)
        origin = ECHO if headers[i, _FLAGS] & _MSG_CONFIRM else 0
        if identifier & CAN_ERR:
            report[ERRORS] += 1
        words[row, 0] = stamp
        words[row, 1] = identifier | length << 32 | flags << 40 | origin << 48 | bus


def _stage(count, first, words, staged, headers, vectors):
    """Lay out `count` records, from row `first` on, as the messages of one call.

    Origin and bus go, since the kernel has other uses for their bytes; so do the undefined bytes
    past the length, which an FD frame could carry to the bus.
    """
    for i in range(count):
        header = words[first + i, 1]
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
        vectors[i, 0] = staged.ctypes.data + FD_SIZE * i
        vectors[i, 1] = FD_SIZE if is_fd else CLASSIC_SIZE
        headers[i, _CONTROL_SIZE] = 0


_int, _pointer, _unsigned = types.int32, types.intp, types.uint32
_recvmmsg = types.ExternalFunction("recvmmsg", _int(_int, _pointer, _unsigned, _int, _pointer))
_sendmmsg = types.ExternalFunction("sendmmsg", _int(_int, _pointer, _unsigned, _int))
_ppoll = types.ExternalFunction("ppoll", _int(_pointer, types.uint64, _pointer, _pointer))
_errno_place = types.ExternalFunction("__errno_location", types.CPointer(_int)())

_long, _void = types.int64, types.void
_rows, _flat = types.int64[:, ::1], types.int64[::1]
_rows_in = types.Array(types.int64, 2, "C", readonly=True)


def _compiled(*signature):
    return njit(*signature, error_model="numpy", nogil=True, cache=True)


settle = _compiled(_void(_long, _long, _long, _rows, _rows, _rows, _flat))(_settle)
stage = _compiled(_void(_long, _long, _rows_in, _rows, _rows, _rows))(_stage)


@_compiled(_long(_flat, _long))
def wait(polled, timeout_ns):
    """Wait until a descriptor has something to read.

    Parameters
    ----------
    polled : ndarray, shape (2 + m,), int64
        From `pollfds`.
    timeout_ns : int

    Returns
    -------
    int
        Number of descriptors that have; 0 after the time-out, or when a signal came.
    """
    polled[0], polled[1] = timeout_ns // 1_000_000_000, timeout_ns % 1_000_000_000
    limit = polled.ctypes.data
    return max(_ppoll(limit + 16, polled.size - 2, limit, 0), 0)


@_compiled(_long(_long, _flat, _long, _long, _long, _long, _rows, _rows, _rows, _rows, _flat))
def receive(fd, polled, timeout_ns, first, room, index, words, headers, vectors, control, report):
    """Receive what waits, at most `room` frames, into rows from `first` on.

    Waits up to `timeout_ns` for the first frame, or until another descriptor of `polled` has
    something to read. An error of the socket ends the call and is left in `report`, beside the
    frames that had come before it.

    Returns
    -------
    int
        Number of frames.
    """
    report[ERRNO] = report[ERRORS] = 0
    total = 0
    while total < room:
        wanted = min(room - total, BATCH)
        base = words.ctypes.data + words.strides[0] * (first + total) + 8
        for i in range(wanted):
            vectors[i, 0] = base + words.strides[0] * i
            vectors[i, 1] = FD_SIZE
            headers[i, _CONTROL] = control.ctypes.data + _CONTROL_BYTES * i
            headers[i, _CONTROL_SIZE] = _CONTROL_BYTES
        got = _recvmmsg(fd, headers.ctypes.data, wanted, _MSG_DONTWAIT, 0)
        if got < 0:
            errno = carray(_errno_place(), 1)[0]
            if errno == _EINTR:
                continue
            if errno != _EAGAIN:
                report[ERRNO] = errno
            elif total == 0 and timeout_ns > 0:
                wait(polled, timeout_ns)
                timeout_ns = 0
                continue
            break
        settle(got, first + total, index, words, headers, control, report)
        total += got
        if got < wanted:
            break
    return total


@_compiled(_long(_long, _long, _long, _rows_in, _rows, _rows, _rows, _flat))
def send(fd, first, count, words, staged, headers, vectors, report):
    """Send up to BATCH of `count` records, from row `first` on, without waiting.

    Returns
    -------
    int
        Number of frames taken; where it is less than asked for, `report` has the reason, once the
        first frame of a call is refused.
    """
    report[ERRNO] = 0
    count = min(count, BATCH)
    stage(count, first, words, staged, headers, vectors)
    taken = _sendmmsg(fd, headers.ctypes.data, count, _MSG_DONTWAIT)
    if taken < 0:
        report[ERRNO] = carray(_errno_place(), 1)[0]
        return 0
    return taken


def as_words(records: np.ndarray) -> np.ndarray:
    """View of contiguous FRAME_DTYPE records as int64, shape (m, 10)."""
    return records.view(np.int64).reshape(-1, WORDS)


def pollfds(*descriptors: int) -> np.ndarray:
    """Room for a `struct timespec`, then a `struct pollfd` for each of m descriptors.

    Returns
    -------
    ndarray, shape (2 + m,), int64
    """
    return np.array([0, 0] + [fd | _POLLIN << 32 for fd in descriptors], np.int64)
