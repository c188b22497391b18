"""MCAP files, written in complete chunks and read as far as they are intact; the only file that
imports mcap.

The writer ends a chunk on request, so that a crash loses only the time since then. foxglove-sdk is
faster, but ends chunks by their size alone.
"""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from bus.errors import LogError
from skin.io.messages.definitions import CONTACT, TOPICS, definition, require, type_of
from topology.files import open_regular

__all__ = ["Container", "RecordedFile", "require_libraries"]

FIXED = dict(enumerate((topic for topic in TOPICS if topic != CONTACT), start=1))
"""Topics by the number of their channel, so that a reader knows them even where the part of the
file that declares them is damaged."""
LARGEST_CHUNK = 1 << 28
"""Maximum bytes of an unpacked chunk that is read [assumed: seconds of the largest skins]."""


def require_libraries(where: str) -> None:
    """Raise LibraryError if a library of recordings is missing."""
    require(where, "log", "mcap", "rosbags")


class Container:
    """An MCAP file that is being written.

    Parameters
    ----------
    path : Path
        A new file.

    Attributes
    ----------
    count : int
        Messages written.

    Raises
    ------
    OSError
        By any method: the file cannot be written. What was written before can be read.
    """

    def __init__(self, path: Path) -> None:
        from mcap.writer import Writer

        self._file = path.open("xb")
        self._writer: Any = Writer(self._file)
        self._writer.start("ros2", "f3t-skin")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self.count = 0
        for topic in FIXED.values():
            self._channel(topic)
        self.flush()

    @property
    def size(self) -> int:
        """Size of the file in bytes."""
        return self._file.tell()

    def attach(self, name: str, data: bytes) -> None:
        """Attach a file."""
        now_ns = time.time_ns()
        kind = "application/json" if name.endswith(".json") else "application/octet-stream"
        self._writer.add_attachment(now_ns, now_ns, name, kind, data)

    def add(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Append a message: topic, stamp, and CDR."""
        self._writer.add_message(self._channel(topic), stamp_ns, data, stamp_ns)
        self.count += 1

    def _channel(self, topic: str) -> int:
        if topic not in self._channels:
            name = type_of(topic)
            if name not in self._schemas:
                text = definition(name).encode()
                self._schemas[name] = self._writer.register_schema(name, "ros2msg", text)
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[name])
        return self._channels[topic]

    def flush(self) -> None:
        """Complete the file up to here, so that a crash of this process loses nothing before."""
        self._writer.flush()

    def finish(self) -> None:
        """End the file and sync it; with an index, if there is room for one."""
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())


class RecordedFile:
    """An MCAP file that is read from its beginning, message by message as written.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    attached : dict of str to bytes
        Attachments before the first message.
    damage : list of str
        Parts that could not be read so far, and why.

    Raises
    ------
    LibraryError
        A library of recordings is not installed.
    bus.LogError
        There is no such file, or it is not an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        require_libraries(str(path))
        self.path = path
        self.damage: list[str] = []
        self.attached: dict[str, bytes] = {}
        for record in self._records():
            kind = type(record).__name__
            if kind == "Attachment":
                self.attached[record.name] = record.data
            elif kind in ("Chunk", "Message"):
                break

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, bytes]]:
        """Topic and bytes of the messages of these topics, from the first one on.

        Raises
        ------
        bus.LogError
            Their definition is another one than that of this version.
        """
        self.damage = []
        channels = dict(FIXED)
        for part in self._parts():
            kind = type(part).__name__
            if kind == "Schema":
                self._check_definition(part, topics)
            elif kind == "Channel":
                channels[part.id] = part.topic
            elif kind == "Message" and (topic := channels.get(part.channel_id, "")) in topics:
                yield topic, part.data

    def _check_definition(self, schema: Any, topics: Collection[str]) -> None:
        name = schema.name
        if name in map(type_of, topics) and schema.data != definition(name).encode():
            raise LogError(
                f"{self.path}: {name}: must be defined as in this version of f3t-skin; got another "
                "definition: replay it with the version that recorded it"
            )

    def _parts(self) -> Iterator[Any]:
        """Records of the file, those of intact chunks one by one."""
        from mcap.stream_reader import breakup_chunk

        for record in self._records():
            if type(record).__name__ != "Chunk":
                yield record
                continue
            try:
                if record.uncompressed_size > LARGEST_CHUNK:
                    raise ValueError(f"a chunk of {record.uncompressed_size} bytes")
                parts = breakup_chunk(record, validate_crc=True)
            except Exception as error:  # a damaged file may raise anything
                seconds = 1e-9 * (record.message_end_time - record.message_start_time)
                self._damaged(f"must be whole; got a chunk of {seconds:.3g} s that is damaged "
                              f"({_reason(error)}), left out")  # fmt: skip
                continue
            yield from parts

    def _records(self) -> Iterator[Any]:
        """Records of the file, chunks packed, to its end or to where it is damaged."""
        from mcap.stream_reader import StreamReader

        try:
            file = open_regular(self.path)
        except OSError as error:
            raise LogError(f"{self.path}: must be a readable file; got: {error.strerror}") from None
        with file:
            size = os.fstat(file.fileno()).st_size
            reader: Any = StreamReader(file, emit_chunks=True, record_size_limit=size)
            records, whole = iter(reader.records), 0
            while True:
                try:
                    record = next(records)
                except StopIteration:
                    return
                except Exception as error:  # a damaged file may raise anything
                    if whole == 0:
                        raise LogError(
                            f"{self.path}: must be an MCAP file; got {_reason(error)}"
                        ) from None
                    self._damaged(f"must go on to its footer; got no more that is whole after "
                                  f"{whole} of {size} bytes ({_reason(error)})")  # fmt: skip
                    return
                whole = file.tell()
                yield record

    def _damaged(self, what: str) -> None:
        self.damage.append(f"{self.path}: {what}")


def _reason(error: Exception) -> str:
    text = str(error).partition("\n")[0]
    kind = type(error).__name__
    return text or ("the end of the file" if kind == "EndOfFile" else kind)
