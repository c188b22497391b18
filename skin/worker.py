"""A process beside the live loop, and the ring buffer in shared memory that feeds it.

What must not disturb a cycle (learning, recording, the live view) is done by a process of its own:
a thread would share the interpreter's lock. The loop copies a record into the ring and goes on; it
never waits. Requests and answers go over a socket, one line of JSON each. Where the loop's process
ends, however it ends, the socket closes and the worker ends as well; the ring has no name, so that
nothing is left behind.
"""

from __future__ import annotations

import json
import mmap
import os
import select
import socket
import subprocess
import sys
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from skin.errors import SkinError

__all__ = ["RingBuffer", "Worker", "WorkerEnd"]

LINE = 64
"""Bytes of a cache line: the counter of each side has one of its own."""
LONGEST_S = 60.0
"""That an answer may take [assumed: a worker imports and compiles before its first]."""
SHORT = 8192
"""Bytes of a command that a socket takes whole, where it takes anything [derived: it is writable
with three quarters of its buffer free]."""
ENDS_S = 10.0
"""That a worker has to end, once asked to [assumed]."""
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")
"""Of linear algebra, where the user has not set another number: more are made before a worker steps
back, and would not."""


class RingBuffer:
    """Records of one kind from one process to another: one writes, one reads, neither waits.

    Parameters
    ----------
    dtype : dtype
        Of a record; without objects.
    slots : int
        Records that may wait for the reader.
    fd : int, optional
        Of the memory, as the other process has it; new memory if not given.

    Raises
    ------
    SkinError
        The system has no memory for it.
    """

    def __init__(self, dtype: np.dtype[Any], slots: int, fd: int | None = None) -> None:
        self.dtype, self.slots = np.dtype(dtype), slots
        size = 2 * LINE + slots * self.dtype.itemsize
        try:
            self.fd = os.memfd_create("f3t-skin ring") if fd is None else fd
            if fd is None:
                os.ftruncate(self.fd, size)
            memory = mmap.mmap(self.fd, size)
        except OSError as error:
            raise SkinError(f"ring buffer: must be {size} bytes of memory; got {error}") from error
        self._written = np.frombuffer(memory, np.int64, 1)
        self._read, self._calls = np.frombuffer(memory, np.int64, 2, offset=LINE)[:, np.newaxis]
        self._records = np.frombuffer(memory, self.dtype, slots, offset=2 * LINE)
        self._barrier = Lock()

    def close(self) -> None:
        """Close the descriptor, once the other process has it; closing twice is fine. The memory
        stays while either side uses it."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1

    @property
    def waiting(self) -> int:
        """Records that were written and not yet read."""
        return int(self._written[0] - self._read[0])

    @property
    def calls(self) -> int:
        """How often the reader has called for the writer, who looks as often as it likes."""
        return int(self._calls[0])

    def call(self) -> None:
        """Call for the writer; what for is between the two."""
        self._calls[0] += 1

    @property
    def counters(self) -> tuple[np.ndarray, np.ndarray]:
        """How many records were written, and how many read, each of shape (1,), int64: for a kernel
        that writes; see `bus.compiled.intrinsics.publish`."""
        return self._written, self._read

    @property
    def records(self) -> np.ndarray:
        """All records, shape (slots,): for a writer that fills field by field; see `claim_slot`."""
        return self._records

    def claim(self) -> np.ndarray | None:
        """The next free record, shape (1,), to be filled; None where the reader is that far behind.
        The reader sees it after `publish`."""
        at = self.claim_slot()
        return None if at is None else self._records[at : at + 1]

    def claim_slot(self) -> int | None:
        """The number of that record among all."""
        written = int(self._written[0])
        if written - int(self._read[0]) >= self.slots:
            return None
        return written % self.slots

    def publish(self) -> None:
        """Hand the claimed record to the reader."""
        with self._barrier:  # what was filled is in memory before it counts
            self._written[0] += 1

    def unread(self) -> np.ndarray:
        """Records that wait, oldest first, shape (m,), as views: up to the end of the memory; those
        that lie at its beginning again come with the next call, after `release`."""
        with self._barrier:
            written, read = int(self._written[0]), int(self._read[0])
        first = read % self.slots
        return self._records[first : first + min(written - read, self.slots - first)]

    def release(self, count: int) -> None:
        """Give the oldest `count` records back to the writer."""
        with self._barrier:
            self._read[0] += count


class Worker:
    """The loop's end of a worker.

    Parameters
    ----------
    module : str
        Run as ``python -m module``; it begins with `WorkerEnd()`.
    ring : RingBuffer
        Its descriptor is closed here, since the worker has it now.
    request : dict
        What the worker is asked to do, as JSON.
    niceness : int
        By how much the worker steps back behind the loop.
    """

    def __init__(
        self, module: str, ring: RingBuffer, request: dict[str, Any], niceness: int = 5
    ) -> None:
        *_, room, name = module.split(".")
        self._name, self._lock = room if name == "process" else name, Lock()
        self._socket, theirs = socket.socketpair()
        self._lines = self._socket.makefile("r", encoding="utf-8")
        root = str(Path(__file__).parents[1])
        paths = filter(None, (root, os.environ.get("PYTHONPATH")))
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, str(theirs.fileno()), str(ring.fd)],
                pass_fds=(theirs.fileno(), ring.fd),
                env=ONE_THREAD | os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is the loop's: it ends the worker when it ends
            )
        ring.close()
        self._send(
            {"dtype": described(ring.dtype), "slots": ring.slots, "nice": niceness,
             "request": request}
        )  # fmt: skip

    @property
    def process_id(self) -> int:
        """Of the worker's process."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the worker runs."""
        return self._process.poll() is None

    @property
    def status(self) -> int | None:
        """Exit status of the worker, None while it runs; minus the signal that ended it."""
        return self._process.poll()

    def ask(self, command: str, timeout_s: float = LONGEST_S, **values: Any) -> dict[str, Any]:
        """Send a command and wait for the answer.

        Raises
        ------
        SkinError
            The worker has ended, does not answer, or answers with an ``error``.
        """
        with self._lock:
            try:
                self._send({"command": command} | values)
                self._socket.settimeout(timeout_s)
                line = self._lines.readline()
            except (BrokenPipeError, ConnectionResetError):
                line = ""
            except BaseException as error:  # an interrupt, too
                self._process.kill()  # a late answer would be taken for that of the next command
                if not isinstance(error, OSError):
                    raise
                raise SkinError(f"{self._name}: must answer {command!r}; got {error}") from error
        if not line:
            raise SkinError(f"{self._name}: must answer {command!r}; got the end of its process, "
                            f"status {self._process.wait(ENDS_S)}")  # fmt: skip
        answer = json.loads(line)
        if "error" in answer:
            raise SkinError(answer["error"])
        return answer

    def tell(self, command: str, **values: Any) -> bool:
        """Send a command that has no answer; never waits. False where the worker does not take it:
        it has ended, or is far behind."""
        line = _line({"command": command} | values)
        with self._lock:
            try:
                if len(line) > SHORT or not select.select([], [self._socket], [], 0)[1]:
                    return False
                self._socket.sendall(line)
            except (OSError, ValueError):
                return False
        return True

    def close(self, timeout_s: float = ENDS_S) -> None:
        """End the worker, once it has read what waits; closing twice is fine."""
        with self._lock:
            self._lines.close()
            self._socket.close()
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _send(self, message: dict[str, Any]) -> None:
        self._socket.sendall(_line(message))


class WorkerEnd:
    """The worker's end, made from the arguments of its process.

    Attributes
    ----------
    ring : RingBuffer
    request : dict
        As given to `Worker`.
    ended : bool
        The loop has closed its end, or its process is gone: read what waits, and end.
    """

    def __init__(self, arguments: list[str] | None = None) -> None:
        at, memory = (int(text) for text in (sys.argv[1:] if arguments is None else arguments))
        self._socket = socket.socket(fileno=at)
        self._rest = b""
        self.ended = False
        first = self.command(None)
        if first is None:
            raise SystemExit(0)  # the loop ended before it had asked for anything
        os.nice(first["nice"])
        dtype = np.dtype([(name, kind, tuple(shape)) for name, kind, shape in first["dtype"]])
        self.ring = RingBuffer(dtype, first["slots"], memory)
        self.request: dict[str, Any] = first["request"]

    def command(self, timeout_s: float | None = 0.0) -> dict[str, Any] | None:
        """The next command, or None if none came in time; None as time waits for it."""
        while b"\n" not in self._rest and not self.ended:
            if not select.select([self._socket], [], [], timeout_s)[0]:
                return None
            try:
                got = self._socket.recv(1 << 16)
            except ConnectionResetError:
                got = b""
            self._rest += got
            self.ended = not got
        line, found, self._rest = self._rest.partition(b"\n")
        return json.loads(line) if found else None

    def answer(self, **values: Any) -> None:
        """Answer the command; ``error`` is raised on the other side."""
        try:
            self._socket.sendall(_line(values))
        except OSError:
            self.ended = True


def _line(message: dict[str, Any]) -> bytes:
    return json.dumps(message, allow_nan=False).encode() + b"\n"


def described(dtype: np.dtype[Any]) -> list[tuple[str, str, tuple[int, ...]]]:
    """Names, kinds and shapes of the fields of a record, as `numpy.dtype` takes them.

    Examples
    --------
    >>> described(np.dtype([("stamp_ns", np.int64), ("force", np.float32, (3, 2))]))
    [('stamp_ns', '<i8', ()), ('force', '<f4', (3, 2))]
    """
    fields = []
    for name in dtype.names or ():
        field = dtype[name]
        if field.names or field.hasobject:
            raise SkinError(f"record: {name}: must be an array of numbers; got {field}")
        fields.append((name, field.base.str, field.shape))
    if np.dtype(fields) != dtype:
        raise SkinError("record: must have its fields side by side; got gaps between them")
    return fields
