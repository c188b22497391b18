"""BlfReader: logs in Vector's binary format, parsed by compiled code."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Generator
from datetime import UTC, datetime, timedelta
from typing import Any, BinaryIO

import numpy as np

from bus.errors import LogError
from bus.frame import FrameBatch, as_bytes, as_words
from bus.logs import blf_kernels as kernels
from bus.logs.reader import LogReader

try:
    from isal import isal_zlib as _isal  # the extra `blf`: inflates 1.5 times as fast
except ImportError:
    _isal = None

inflating: Any = _isal or zlib

__all__ = ["BlfReader"]

_FILE_HEAD = struct.Struct("<4sLBBBBBBBBQQLL8H8H")
"""Signature, length of the head, application and versions, length of the file, uncompressed
length, objects, objects read, date of the beginning, date of the end."""
_OBJECT_HEAD = struct.Struct("<4sHHLL")
"""Signature, length of the head, its version, length, type."""
_CONTAINER_HEAD = struct.Struct("<H6xL4x")
"""Compression, uncompressed length: what follows the head of a container."""
_PLAIN, _DEFLATED = 0, 2
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_LARGEST_FILE_HEAD = 1 << 16
_LARGEST_OBJECT = 1 << 26
_MOST_PADDING = 3
_DATA_LOST = 125
"""Type of the object where an interval begins whose frames the logger lost."""
_END = "the end of the file"


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
        self._place = 0  # in the file, of the object that is read
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
        """Read the file's objects, and those in its containers, which may go on in the next one."""
        self._read_head(file)
        # Of the contents of containers: the object that has begun, its place, the container's.
        rest, inside, container = b"", 0, 0
        while self._find_object(file):
            head = self._read_up_to(file, _OBJECT_HEAD.size - 4)
            if len(head) < _OBJECT_HEAD.size - 4:
                raise self._damage("a whole object", self._end)
            _, _, _, size, kind = _OBJECT_HEAD.unpack(head := b"LOBJ" + head)
            if kind != kernels.LOG_CONTAINER:
                data = head + self._body(file, size, "an object")
                skip, self._state["skip"] = self._state["skip"].copy(), 0
                if (yield from self._parse(data, batch)):
                    raise self._damage("a whole object", self._end)
                self._state["skip"] = skip
                continue
            container = self._place
            packed = self._body(file, size, "a container", _CONTAINER_HEAD.size)
            is_whole = len(packed) == size - _OBJECT_HEAD.size
            contents = rest + self._inflate(packed, is_whole)
            rest = yield from self._parse(contents, batch, inside)
            inside += len(contents) - len(rest)
            if not is_whole:
                raise self._damage(f"a container of {size} bytes", self._end)
        if self._state["skip"][0] or not _is_padding(rest):
            self._place = container
            raise self._damage("a whole object", "the end of the last container", inside)
        self._place = file.tell()
        if self._stated_bytes > self._place or self._end != _END:
            raise self._damage(f"more, up to byte {self._stated_bytes}", self._end)

    def _read_head(self, file: BinaryIO) -> None:
        """Read the file's head."""
        head = self._read_up_to(file, _FILE_HEAD.size)
        if not head.startswith(b"LOGG"):
            raise self._damage("'LOGG'", _shown(head) if head else self._end)
        if len(head) < _FILE_HEAD.size:
            raise self._damage(f"a head of {_FILE_HEAD.size} bytes", self._end)
        fields = _FILE_HEAD.unpack(head)
        length, self._stated_bytes, self._stated_objects = fields[1], fields[10], fields[12]
        if not _FILE_HEAD.size <= length <= _LARGEST_FILE_HEAD:
            expected = f"a length of {_FILE_HEAD.size} to {_LARGEST_FILE_HEAD}"
            raise self._damage(expected, f"{length}")
        self._state["start_ns"] = _to_ns(*fields[14:22])
        if len(head) + len(self._read_up_to(file, length - len(head))) < length:
            raise self._damage(f"a head of {length} bytes", self._end)

    def _find_object(self, file: BinaryIO) -> bool:
        """Read up to the signature of the next object; False at the end."""
        self._place = file.tell()
        found = self._read_up_to(file, 4)
        for padding in range(kernels.MOST_PADDING):
            if found == b"LOBJ":
                self._place = file.tell() - 4
                return True
            if len(found) < 4:
                if _is_padding(bytes(padding) + found):
                    return False
                raise self._damage("a whole object", self._end)
            found = found[1:] + self._read_up_to(file, 1)
        raise self._damage(kernels.EXPECTED[kernels.SIGNATURE], _shown(found))

    def _body(self, file: BinaryIO, size: int, what: str, least: int = 0) -> bytes:
        """Read what follows the head of an object; only a container may be cut."""
        least += _OBJECT_HEAD.size
        if not least <= size <= _LARGEST_OBJECT:
            raise self._damage(f"{what} of {least} to {_LARGEST_OBJECT} bytes", f"{size}")
        body = self._read_up_to(file, size - _OBJECT_HEAD.size)
        lacking = size - _OBJECT_HEAD.size - len(body)
        if lacking and (least == _OBJECT_HEAD.size or len(body) < least - _OBJECT_HEAD.size):
            raise self._damage(f"{what} of {size} bytes", self._end)
        return body

    def _inflate(self, packed: bytes, is_whole: bool) -> bytes:
        """Contents of a container, as far as they are certain."""
        method, _ = _CONTAINER_HEAD.unpack_from(packed)
        packed = packed[_CONTAINER_HEAD.size :]
        if method == _PLAIN:
            return packed
        if method != _DEFLATED:
            raise self._damage(f"compression {_PLAIN} or {_DEFLATED}", f"{method}")
        inflater = inflating.decompressobj()
        try:
            inside: bytes = inflater.decompress(packed, _LARGEST_OBJECT)
        except inflating.error as error:
            # Nothing is certain, since the checksum comes last.
            raise self._damage("a container with whole contents", str(error)) from None
        if is_whole and not inflater.eof:
            expected = f"contents of at most {_LARGEST_OBJECT} bytes, with their end"
            raise self._damage(expected, f"{len(inside)} bytes without one")
        return inside

    def _parse(
        self, data: bytes, batch: FrameBatch, inside: int | None = None
    ) -> Generator[None, None, bytes]:
        """Parse objects; returns what is left, the beginning of one."""
        state = self._state
        blob = np.frombuffer(data, np.uint8) if data else np.zeros(0, np.uint8)
        state["position"] = 0
        while True:
            state["count"] = batch.count
            status = kernels.parse(
                blob, blob.size, self._buses, self._left_out, self._types, *self._views, state
            )
            batch.count = int(state["count"][0])
            position = int(state["position"][0])
            if status == kernels.FULL:
                yield
            elif status == kernels.NEW_CHANNEL:
                channel = int(state["channel"][0])
                try:
                    self._buses[channel] = self._channels.index(_name(channel))
                except ValueError as error:
                    raise LogError(f"{self.path}: {error}; got {_name(channel)!r}") from error
            elif status == kernels.MORE:
                return data[position:]
            else:
                place = None if inside is None else inside + position
                raise self._damage(kernels.EXPECTED[status], _shown(data[position:]), place)

    def _read_up_to(self, file: BinaryIO, size: int) -> bytes:
        """Read `size` bytes, fewer only at the end, with the reason in `_end`."""
        parts = [b""]
        try:
            # One read at a time, so that damage loses nothing before it.
            while size and (more := file.read1(size)):  # type: ignore[attr-defined]
                parts.append(more)
                size -= len(more)
        except (OSError, EOFError, zlib.error) as error:
            self._end = str(error)
        return b"".join(parts)

    def _damage(self, expected: str, got: str, inside: int | None = None) -> LogError:
        """The error at a place of the file, with the amount that was read."""
        place = self._place
        where = f"byte {place}" if inside is None else f"byte {place}: byte {inside} of contents"
        read = f"{self._state['objects'][0]} "
        read += f"of {self._stated_objects} objects" if self._stated_objects else "objects"
        if self.path.suffix.lower() != ".gz":
            size = os.path.getsize(self.path)
            read += f", up to the last {size - place} of {size} bytes"
        return LogError(f"{self.path}: {where}: must be {expected}; got {got} (read: {read})")


def _is_padding(rest: bytes) -> bool:
    """Whether no object begins in what is left."""
    return len(rest) <= _MOST_PADDING and not (rest and b"LOBJ".startswith(rest))


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
    since = (date - _EPOCH) // timedelta(microseconds=1) * 1000
    return since if abs(since) < 1 << 63 else 0


def _shown(data: bytes) -> str:
    return repr(data[:16])
