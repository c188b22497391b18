"""BlfReader: logs in Vector's binary format, parsed by compiled code."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Generator
from datetime import UTC, datetime, timedelta
from typing import BinaryIO

import numpy as np

from bus.errors import LogError
from bus.frame import FrameBatch
from bus.logs import blf_kernels as kernels
from bus.logs.reader import LogReader, as_bytes, as_words

__all__ = ["CONTAINER_HEAD", "DEFLATED", "EPOCH", "FILE_HEAD", "BlfReader"]

FILE_HEAD = struct.Struct("<4sLBBBBBBBBQQLL8H8H")
"""Signature, length of the head, application and versions, length of the file, uncompressed
length, objects, objects read, date of the beginning, date of the end."""
CONTAINER_HEAD = struct.Struct("<4sHHLLH6xL4x")
"""Signature, length of the head, its version, length, type; compression, uncompressed length."""
PLAIN, DEFLATED = 0, 2
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

_CHUNK_BYTES = 1 << 18
_LARGEST_FILE_HEAD = 1 << 16
_LARGEST_CONTAINER = 1 << 26
_MOST_PADDING = 3


class BlfReader(LogReader):
    """Reads all frames of CAN and CAN FD, error frames and overload frames of a BLF file.

    Objects may lie in containers, compressed or not, or outside. Channel 1 is can0, as python-can
    and can-utils have it. Stamps are UTC, or count from the beginning where the file has no date.
    Error frames get the class and the details of SocketCAN. Objects that are no frames are counted
    in `skipped`.
    """

    def _fill(self, batch: FrameBatch) -> Generator[None]:
        self._state = np.zeros(kernels.STATE_SIZE, np.int64)
        self._buses = np.full(1 << 16, kernels.UNKNOWN, np.int64)
        self._left_out = np.zeros(1 << 16, np.int64)
        self._types = np.zeros(kernels.TYPES, np.int64)
        self._told_objects = self._told_bytes = 0
        self._views = as_words(batch.records), as_bytes(batch.records)
        try:
            with self._open() as file:
                yield from self._read(file, batch)
        finally:
            for kind in np.flatnonzero(self._types):
                self.skipped[f"object of type {kind}"] = int(self._types[kind])
            for channel in np.flatnonzero(self._left_out):
                self.skipped[f"frame of {_name(channel)}"] = int(self._left_out[channel])

    def _read(self, file: BinaryIO, batch: FrameBatch) -> Generator[None]:
        """Read the file's objects, and those in its containers."""
        objects, contents = _Objects(self._read_head(file)), _Objects(0)
        data, container = None, 0
        while data != b"":
            data = self._take(file, _CHUNK_BYTES)
            status = yield from self._parse(objects, data, batch)
            while status == kernels.CONTAINER:
                container, inside, cut = objects.place, *self._unpack(file, objects)
                status = yield from self._parse(contents, inside, batch)
                if status == kernels.CONTAINER:
                    expected = "an object other than a container, in a container"
                    raise self._damage(container, expected, "one", contents.place)
                if status != kernels.MORE:
                    expected, got = kernels.EXPECTED[status], _shown(contents.rest)
                    raise self._damage(container, expected, got, contents.place)
                if cut:
                    raise self._damage(container, *cut)
                status = yield from self._parse(objects, b"", batch)
            if status != kernels.MORE:
                expected, got = kernels.EXPECTED[status], _shown(objects.rest)
                raise self._damage(objects.place, expected, got)
        if not contents.is_whole:
            got = "the end of the last container"
            raise self._damage(container, "a whole object", got, contents.place)
        if not objects.is_whole:
            raise self._damage(objects.place, "a whole object", "the end of the file")
        length = objects.place + len(objects.rest)
        if self._told_bytes > length:
            expected = f"the rest of a file of {self._told_bytes} bytes"
            raise self._damage(length, expected, "its end")

    def _read_head(self, file: BinaryIO) -> int:
        """Read what stands before the first object; return its length."""
        head = self._take(file, FILE_HEAD.size)
        if not head.startswith(b"LOGG"):
            raise LogError(f"{self.path}: byte 0: must be 'LOGG'; got {_shown(head)}")
        if len(head) < FILE_HEAD.size:
            raise LogError(
                f"{self.path}: byte {len(head)}: must be a head of {FILE_HEAD.size} bytes; got the "
                "end of the file"
            )
        _, length, *_, told_bytes, _, told_objects, _ = (fields := FILE_HEAD.unpack(head))[:14]
        if not FILE_HEAD.size <= length <= _LARGEST_FILE_HEAD:
            raise LogError(
                f"{self.path}: byte 4: must be a length of {FILE_HEAD.size} to "
                f"{_LARGEST_FILE_HEAD}; got {length}"
            )
        self._told_bytes, self._told_objects = told_bytes, told_objects
        self._state[kernels.START_NS] = _to_ns(*fields[14:22])
        rest = self._take(file, length - FILE_HEAD.size)
        return FILE_HEAD.size + len(rest)

    def _unpack(self, file: BinaryIO, objects: _Objects) -> tuple[bytes, tuple[str, str] | None]:
        """Take the container that `objects` begin with, and inflate it.

        Returns
        -------
        bytes
            What is in it, as far as it is there and right.
        tuple of str, or None
            Where that is not all: what must have been there, and what was.
        """
        head, size = objects.rest, CONTAINER_HEAD.size
        if len(head) < size:
            head += self._take(file, size - len(head))
            if len(head) < size:
                objects.drop(len(head))
                return b"", (f"a container's head of {size} bytes", "the end of the file")
        *_, length, _, method, _ = CONTAINER_HEAD.unpack_from(head)
        if not size <= length <= _LARGEST_CONTAINER:
            return b"", (f"a container of {size} to {_LARGEST_CONTAINER} bytes", str(length))
        if method not in (PLAIN, DEFLATED):
            return b"", (f"compression {PLAIN} or {DEFLATED}", str(method))
        objects.rest = head + self._take(file, max(0, length - len(head)))
        packed, fault = objects.rest[size:length], None
        if len(objects.rest) < length:
            fault = f"a container of {length} bytes", "the end of the file"
        objects.drop(min(length, len(objects.rest)))
        if method == PLAIN:
            return packed, fault
        inflater = zlib.decompressobj()
        try:
            inside = inflater.decompress(packed, _LARGEST_CONTAINER)
        except zlib.error as error:
            # None of it is sure: the checksum comes last.
            return b"", ("a container with whole contents", str(error))
        if not inflater.eof:
            limit = f"a container with whole contents of at most {_LARGEST_CONTAINER} bytes"
            fault = fault or (limit, "contents without end")
        return inside, fault

    def _parse(
        self, objects: _Objects, data: bytes, batch: FrameBatch
    ) -> Generator[None, None, int]:
        """Parse objects, the rest of those before first; return why it ended."""
        state, rest = self._state, objects.rest + data if objects.rest else data
        blob = np.frombuffer(rest, np.uint8) if rest else np.zeros(0, np.uint8)
        state[kernels.POSITION], state[kernels.SKIP] = 0, objects.skip
        while True:
            state[kernels.COUNT] = batch.count
            status = kernels.parse(
                blob, blob.size, self._buses, self._left_out, self._types, *self._views, state
            )
            batch.count = int(state[kernels.COUNT])
            if status == kernels.FULL:
                yield
            elif status == kernels.NEW_CHANNEL:
                channel = int(state[kernels.CHANNEL])
                try:
                    self._buses[channel] = self._channels.index(_name(channel))
                except ValueError as error:
                    raise LogError(f"{self.path}: {error}; got {_name(channel)!r}") from error
            else:
                break
        objects.rest = rest
        objects.drop(int(state[kernels.POSITION]))
        objects.skip = int(state[kernels.SKIP])
        return status

    def _take(self, file: BinaryIO, size: int) -> bytes:
        """Read up to `size` bytes, fewer at the end alone."""
        try:
            return file.read(size)
        except (OSError, EOFError, zlib.error) as error:
            raise LogError(f"{self.path}: must be readable to its end; got: {error}") from error

    def _damage(self, place: int, expected: str, got: str, inside: int | None = None) -> LogError:
        """Say what is wrong at a place of the file, and how much was read."""
        where = f"byte {place}" if inside is None else f"byte {place}: byte {inside} of contents"
        read = f"{self._state[kernels.OBJECTS]} "
        read += f"of {self._told_objects} objects" if self._told_objects else "objects"
        if self.path.suffix.lower() != ".gz":
            size = os.path.getsize(self.path)
            read += f", up to the last {size - place} of {size} bytes"
        return LogError(f"{self.path}: {where}: must be {expected}; got {got} (read: {read})")


class _Objects:
    """Objects one after the other, of a file or in its containers: what is not parsed yet."""

    def __init__(self, place: int) -> None:
        self.place = place  # of the first byte of `rest`
        self.rest = b""
        self.skip = 0  # bytes to come of an object that is no frame

    @property
    def is_whole(self) -> bool:
        """Whether nothing but padding is left."""
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
    """Time since 1970 of a SYSTEMTIME; 0 where it is none."""
    try:
        date = datetime(year, month, day, hour, minute, second, 1000 * millisecond, tzinfo=UTC)
    except ValueError:
        return 0
    since = (date - EPOCH) // timedelta(microseconds=1) * 1000
    return since if abs(since) < 1 << 63 else 0


def _shown(data: bytes) -> str:
    return repr(data[:16]) if data else "the end of the file"
