"""MCAP files, written in complete chunks and read as far as they are intact; the only file that
imports mcap.

The writer ends a chunk on request, so that a crash loses only the time since then. foxglove-sdk is
faster, but ends chunks by their size alone.
"""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from bus.errors import LogError
from skin.errors import LibraryError
from skin.io.messages.definitions import Field, definitions, schema
from skin.io.messages.topics import FIXED, type_of
from topology.files import open_regular

__all__ = ["Container", "Message", "RecordedFile", "require"]

PROFILE = "ros2"
LARGEST_CHUNK = 1 << 28
"""Maximum bytes of an unpacked chunk that is read [assumed: seconds of the largest skins]."""
CHUNK = 1 << 20
"""Maximum bytes of a written chunk: the loss on a full disk."""
SET_BACK_NS = 10_000_000_000
"""Stamps that step back by less are logged at the time of the newest, so that a file without an
index can be read in order; a larger step is a clock that was set."""


def require(where: str) -> None:
    """Raise if the library is missing.

    Raises
    ------
    LibraryError
        It is not installed.
    """
    if find_spec("mcap") is None:
        raise LibraryError(f"{where}: must have mcap; not installed: pip install 'f3t-skin[log]'")


class _File:
    """A new file that grows by complete pieces: incomplete ones are truncated."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        self._waiting = bytearray()
        self.size = 0
        """Of what is in the file."""

    def write(self, data: bytes) -> int:
        """Buffer bytes; `flush` writes them."""
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Offset of the next byte."""
        return self.size + len(self._waiting)

    def flush(self) -> None:
        """Write the buffered bytes."""
        view, done = memoryview(self._waiting), 0
        try:
            while done < len(view):
                done += os.write(self._file, view[done:])
        except OSError:
            os.ftruncate(self._file, self.size)
            raise
        finally:
            view.release()
        self.size += done
        self._waiting.clear()

    def sync(self) -> None:
        """Sync the file to the disk."""
        os.fsync(self._file)

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


class Container:
    """An MCAP file that is being written.

    Parameters
    ----------
    path : Path
        A new file.
    library : str
        Name of the writing program.

    Attributes
    ----------
    count : int
        Messages written.

    Raises
    ------
    OSError
        By any method: the file cannot be written. It is complete up to the last `flush`.
    """

    def __init__(self, path: Path, library: str) -> None:
        from mcap.writer import Writer

        self._file = _File(path)
        self._writer: Any = Writer(self._file, chunk_size=CHUNK)  # type: ignore[arg-type]
        self._writer.start(PROFILE, library)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self.count = self._newest_ns = 0
        for topic in FIXED.values():
            self._channel(topic)
        self.flush()

    @property
    def size(self) -> int:
        """Size of the file in bytes."""
        return self._file.size

    def attach(self, name: str, data: bytes, media_type: str, stamp_ns: int | None = None) -> None:
        """Attach a file, with its stamp; now if none is given."""
        now_ns = time.time_ns() if stamp_ns is None else stamp_ns
        self._writer.add_attachment(now_ns, now_ns, name, media_type, data)

    def add(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Append a message: topic, stamp, and CDR."""
        channel = self._channel(topic)
        back_ns = self._newest_ns - stamp_ns
        self._newest_ns = log_ns = self._newest_ns if 0 < back_ns < SET_BACK_NS else stamp_ns
        self._writer.add_message(channel, log_ns, data, stamp_ns)
        self.count += 1

    def _channel(self, topic: str) -> int:
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(
                topic, "cdr", self._schema(type_of(topic))
            )
        return self._channels[topic]

    def _schema(self, name: str) -> int:
        if name not in self._schemas:
            text = schema(name).encode()
            self._schemas[name] = self._writer.register_schema(name, "ros2msg", text)
        return self._schemas[name]

    def flush(self) -> None:
        """Complete the file up to here, so that a crash of this process loses nothing before."""
        self._writer.flush()

    def finish(self) -> None:
        """End the file and sync it; with an index, if there is room for one."""
        self._writer.finish()
        self._file.flush()
        self._file.sync()

    def close(self) -> None:
        """Close the file without ending it."""
        self._file.close()


class Message(NamedTuple):
    """A message that was read."""

    topic: str
    stamp_ns: int
    data: bytes


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
    definitions : dict of str to dict
        Of the messages of each topic read so far, as of
        `skin.io.messages.definitions.definitions`.

    Raises
    ------
    LibraryError
        The library of the file format is not installed.
    bus.LogError
        There is no such file, or it is not an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        require(str(path))
        self.path = path
        self.damage: list[str] = []
        self.attached: dict[str, bytes] = {}
        self.definitions: dict[str, dict[str, tuple[Field, ...]]] = {}
        for record in self._records():
            kind = type(record).__name__
            if kind == "Attachment":
                self.attached[record.name] = record.data
            elif kind in ("Chunk", "Message"):
                break

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Messages of these topics, from the first one on."""
        from mcap.stream_reader import breakup_chunk

        self.damage = []
        channels, schemas = dict(FIXED), {}
        for record in self._records():
            parts: list[Any] = [record]
            if type(record).__name__ == "Chunk":
                try:
                    if record.uncompressed_size > LARGEST_CHUNK:
                        raise ValueError(f"a chunk of {record.uncompressed_size} bytes")
                    parts = breakup_chunk(record, validate_crc=True)
                except Exception as error:  # a damaged file may raise anything
                    seconds = 1e-9 * (record.message_end_time - record.message_start_time)
                    self._damaged(f"must be whole; got a chunk of {seconds:.3g} s that is "
                                  f"damaged ({_reason(error)}), left out")  # fmt: skip
                    continue
            for part in parts:
                kind = type(part).__name__
                if kind == "Schema":
                    schemas[part.id] = part
                elif kind == "Channel":
                    channels[part.id] = part.topic
                    if (one := schemas.get(part.schema_id)) is not None:
                        text = one.data.decode(errors="replace")
                        self.definitions[part.topic] = definitions(one.name, text)
                elif kind == "Message":
                    topic = channels.get(part.channel_id, "")
                    if topic in topics:
                        yield Message(topic, part.log_time, part.data)

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
    return text or {"EndOfFile": "the end of the file"}.get(
        type(error).__name__, type(error).__name__
    )
