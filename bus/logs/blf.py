"""BlfReader: logs in Vector's binary format, parsed by compiled code."""

from __future__ import annotations

import os
import struct
import zlib
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from bus.errors import LogError
from bus.frame import FrameBatch, as_bytes, as_words
from bus.logs import blf_kernels as kernels
from bus.logs.reader import LogReader
from bus.processors import processors

try:
    from isal import isal_zlib as _isal  # the extra `blf`: inflates 1.5 times as fast
except ImportError:
    _isal = None

inflating: Any = _isal or zlib

__all__ = ["CONTAINER_HEAD", "DEFLATED", "EPOCH", "FILE_HEAD", "BlfReader"]

FILE_HEAD = struct.Struct("<4sLBBBBBBBBQQLL8H8H")
"""Signature, length of the head, application and versions, length of the file, uncompressed
length, objects, objects read, date of the beginning, date of the end."""
CONTAINER_HEAD = struct.Struct("<4sHHLLH6xL4x")
"""Signature, length of the head, its version, length, type; compression, uncompressed length."""
PLAIN, DEFLATED = 0, 2
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

_CHUNK_BYTES = 1 << 16
_LARGEST_FILE_HEAD = 1 << 16
_LARGEST_CONTAINER = 1 << 26
_MOST_PADDING = 3
_DATA_LOST = 125
"""Type of the object where an interval begins whose frames the logger lost."""
_MOST_THREADS = 4
_END = "the end of the file"

Fault = tuple[str, str] | None
"""Expected and actual content."""


class BlfReader(LogReader):
    """Reads all frames of CAN and CAN FD, error frames and overload frames of a BLF file.

    Objects may be in containers, compressed or not, or outside. Channel 1 is can0, as in python-can
    and can-utils. Stamps are UTC, or relative to the beginning where the file has no date. Error
    frames get the class and the details of SocketCAN. Other objects are counted in `skipped`.
    """

    def _fill(self, batch: FrameBatch) -> Generator[None]:
        self._state = np.zeros(1, kernels.STATE)
        self._buses = np.full(1 << 16, kernels.UNKNOWN, np.int16)
        self._left_out = np.zeros(1 << 16, np.int64)
        self._types = np.zeros(kernels.TYPES, np.int64)
        self._stated_objects = self._stated_bytes = 0
        self._end = _END
        self._views = as_words(batch.records), as_bytes(batch.records)
        try:
            with self._open() as file:
                yield from self._read(file, batch)
        finally:
            self.lost = int(self._types[_DATA_LOST])
            for kind in np.flatnonzero(self._types):
                self.skipped[f"object of type {kind}"] = int(self._types[kind])
            for channel in np.flatnonzero(self._left_out).tolist():
                self.skipped[f"frame of {_name(channel)}"] = int(self._left_out[channel])

    def _read(self, file: BinaryIO, batch: FrameBatch) -> Generator[None]:
        """Read the file's objects and those in its containers, which are inflated ahead."""
        objects, contents = _Objects(self._read_head(file)), _Objects(0)
        ahead: deque[tuple[int, Callable[[], tuple[bytes, Fault]]]] = deque()
        place, status = 0, kernels.MORE
        count = min(_MOST_THREADS, processors()) if self.threads else 0
        with ThreadPoolExecutor(count, "blf") if count else nullcontext() as pool:
            while True:
                while len(ahead) < max(1, 2 * count) and self._finds_container(file, objects):
                    at, packed = objects.place, self._take(file, objects)
                    inflated = partial(_inflate, *packed)
                    ahead.append((at, pool.submit(inflated).result if pool else inflated))
                if ahead:
                    place, contents_of = ahead.popleft()
                    inside, fault = contents_of()
                    status = yield from self._parse(contents, inside, batch)
                    if status != kernels.MORE:
                        expected, got = kernels.EXPECTED[status], _shown(contents.rest)
                        raise self._damage(place, expected, got, contents.place)
                    if fault:
                        raise self._damage(place, *fault)
                    continue
                data = self._read_some(file, _CHUNK_BYTES)
                status = yield from self._parse(objects, data, batch)
                if status == kernels.MORE and not data:
                    break
                if status not in (kernels.MORE, kernels.CONTAINER):
                    expected, got = kernels.EXPECTED[status], _shown(objects.rest)
                    raise self._damage(objects.place, expected, got)
        if not contents.is_whole:
            got = "the end of the last container"
            raise self._damage(place, "a whole object", got, contents.place)
        if not objects.is_whole:
            raise self._damage(objects.place, "a whole object", self._end)
        length = objects.place + len(objects.rest)
        if self._stated_bytes > length or self._end != _END:
            raise self._damage(length, f"more, up to byte {self._stated_bytes}", self._end)

    def _read_head(self, file: BinaryIO) -> int:
        """Read the file's head; returns its length."""
        head = self._read_up_to(file, FILE_HEAD.size)
        if not head.startswith(b"LOGG"):
            raise self._damage(0, "'LOGG'", _shown(head) if head else self._end)
        if len(head) < FILE_HEAD.size:
            raise self._damage(len(head), f"a head of {FILE_HEAD.size} bytes", self._end)
        _, length, *_, stated_bytes, _, stated_objects, _ = (fields := FILE_HEAD.unpack(head))[:14]
        if not FILE_HEAD.size <= length <= _LARGEST_FILE_HEAD:
            expected = f"a length of {FILE_HEAD.size} to {_LARGEST_FILE_HEAD}"
            raise self._damage(4, expected, f"{length}")
        self._stated_bytes, self._stated_objects = stated_bytes, stated_objects
        self._state["start_ns"][0] = _to_ns(*fields[14:22])
        there = len(head) + len(self._read_up_to(file, length - len(head)))
        if there < length:
            raise self._damage(there, f"a head of {length} bytes", self._end)
        return length

    def _finds_container(self, file: BinaryIO, objects: _Objects) -> bool:
        """Whether a container comes next; if so, `objects` then begin with it."""
        if objects.skip:
            return False
        least = kernels.MOST_PADDING + CONTAINER_HEAD.size
        while len(objects.rest) < least and (more := self._read_some(file, _CHUNK_BYTES)):
            objects.rest += more
        padding = objects.rest.find(b"LOBJ", 0, kernels.MOST_PADDING + 3)
        kind = objects.rest[padding + 12 : padding + 16]
        if padding < 0 or int.from_bytes(kind, "little") != kernels.LOG_CONTAINER:
            return False
        objects.drop(padding)
        return True

    def _take(self, file: BinaryIO, objects: _Objects) -> tuple[int, bytes, Fault]:
        """Take the container at the start of `objects`: compression, contents, fault."""
        head = CONTAINER_HEAD.size
        if len(objects.rest) < head:
            objects.drop(len(objects.rest))
            return PLAIN, b"", (f"a container's head of {head} bytes", self._end)
        *_, length, _, method, _ = CONTAINER_HEAD.unpack_from(objects.rest)
        if not head <= length <= _LARGEST_CONTAINER:
            return PLAIN, b"", (f"a container of {head} to {_LARGEST_CONTAINER} bytes", f"{length}")
        if method not in (PLAIN, DEFLATED):
            return PLAIN, b"", (f"compression {PLAIN} or {DEFLATED}", f"{method}")
        objects.rest += self._read_up_to(file, max(0, length - len(objects.rest)))
        packed, there = objects.rest[head:length], len(objects.rest)
        objects.drop(min(length, there))
        whole = f"a container of {length} bytes"
        return method, packed, None if there >= length else (whole, self._end)

    def _parse(
        self, objects: _Objects, data: bytes, batch: FrameBatch
    ) -> Generator[None, None, int]:
        """Parse objects, remaining ones first; returns why it ended."""
        state, rest = self._state, objects.rest + data if objects.rest else data
        blob = np.frombuffer(rest, np.uint8) if rest else np.zeros(0, np.uint8)
        state["position"][0], state["skip"][0] = 0, objects.skip
        while True:
            state["count"][0] = batch.count
            status = kernels.parse(
                blob, blob.size, self._buses, self._left_out, self._types, *self._views, state
            )
            batch.count = int(state["count"][0])
            if status == kernels.FULL:
                yield
            elif status == kernels.NEW_CHANNEL:
                channel = int(state["channel"][0])
                try:
                    self._buses[channel] = self._channels.index(_name(channel))
                except ValueError as error:
                    raise LogError(f"{self.path}: {error}; got {_name(channel)!r}") from error
            else:
                break
        objects.rest = rest
        objects.drop(int(state["position"][0]))
        objects.skip = int(state["skip"][0])
        return status

    def _read_some(self, file: BinaryIO, size: int) -> bytes:
        """Read at most `size` bytes; none at the end, with the reason in `_end`."""
        if self._end != _END:
            return b""
        try:
            got: bytes = file.read1(size)  # type: ignore[attr-defined]
        except (OSError, EOFError, zlib.error) as error:
            self._end = str(error)
            return b""
        return got

    def _read_up_to(self, file: BinaryIO, size: int) -> bytes:
        """Read `size` bytes, fewer only at the end."""
        parts = [b""]
        while size and (more := self._read_some(file, size)):
            parts.append(more)
            size -= len(more)
        return b"".join(parts)

    def _damage(self, place: int, expected: str, got: str, inside: int | None = None) -> LogError:
        """The error at a place of the file, with the amount that was read."""
        where = f"byte {place}" if inside is None else f"byte {place}: byte {inside} of contents"
        read = f"{self._state['objects'][0]} "
        read += f"of {self._stated_objects} objects" if self._stated_objects else "objects"
        if self.path.suffix.lower() != ".gz":
            size = os.path.getsize(self.path)
            read += f", up to the last {size - place} of {size} bytes"
        return LogError(f"{self.path}: {where}: must be {expected}; got {got} (read: {read})")


def _inflate(method: int, packed: bytes, fault: Fault) -> tuple[bytes, Fault]:
    """Contents of a container, as far as they are certain, and its fault."""
    if method == PLAIN:
        return packed, fault
    inflater = inflating.decompressobj()
    try:
        inside = inflater.decompress(packed, _LARGEST_CONTAINER)
    except inflating.error as error:
        # Nothing is certain, since the checksum comes last.
        return b"", ("a container with whole contents", str(error))
    if not inflater.eof and not fault:
        expected = f"contents of at most {_LARGEST_CONTAINER} bytes, with their end"
        return b"", (expected, f"{len(inside)} bytes without one")
    return inside, fault


class _Objects:
    """Consecutive objects, of a file or in its containers, that are not yet parsed."""

    def __init__(self, place: int) -> None:
        self.place = place  # of the first byte of `rest`
        self.rest = b""
        self.skip = 0  # remaining bytes of an object that is not a frame

    @property
    def is_whole(self) -> bool:
        """Whether only padding is left."""
        begun = self.rest and b"LOBJ".startswith(self.rest)
        return not self.skip and not begun and len(self.rest) <= _MOST_PADDING

    def drop(self, size: int) -> None:
        self.place += size
        self.rest = self.rest[size:]


def _name(channel: int) -> str:
    return f"can{int(channel) - 1}"


def _to_ns(
    year: int, month: int, _: int, day: int, hour: int, minute: int, second: int, millisecond: int
) -> int:
    """Time since 1970 of a SYSTEMTIME; 0 where it is invalid."""
    try:
        date = datetime(year, month, day, hour, minute, second, 1000 * millisecond, tzinfo=UTC)
    except ValueError:
        return 0
    since = (date - EPOCH) // timedelta(microseconds=1) * 1000
    return since if abs(since) < 1 << 63 else 0


def _shown(data: bytes) -> str:
    return repr(data[:16])
