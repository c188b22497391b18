"""PythonCanReader: formats that are read by python-can."""

from __future__ import annotations

import io
import re
import sqlite3
import struct
from collections.abc import Generator, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, BinaryIO

import can
from can.io.generic import MessageReader
from can.util import dlc2len

from bus.errors import LogError
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, ECHO, FD_BRS, FD_ESI, FD_FDF, FrameBatch
from bus.logs.channels import LEFT_OUT
from bus.logs.reader import LogReader

__all__ = ["FORMATS", "PythonCanReader"]

CSV_HEAD = b"timestamp,arbitration_id,extended,remote,error,dlc,data"
FORMATS: dict[str, tuple[type[MessageReader], re.Pattern[bytes], str]] = {
    ".asc": (can.ASCReader, re.compile(rb"\s*(date|base|//)", re.I), "'date', 'base' or '//'"),
    ".csv": (can.CSVReader, re.compile(re.escape(CSV_HEAD)), f"{CSV_HEAD.decode()!r}"),
    ".db": (can.SqliteReader, re.compile(rb"SQLite format 3\0"), "'SQLite format 3'"),
    ".trc": (can.TRCReader, re.compile(rb"\s*;"), "';'"),
}
"""Reader and first bytes of each format; python-can's readers accept any text as an empty log."""

_HEAD_BYTES = 4096
_ASC_BASE = re.compile(r"\s*base\s+(hex|dec)(\s+timestamps\s+(?P<stamps>\w+))?", re.I)
_COMMENT = re.compile(r"\s*(;|//|$)")
_RECORD = struct.Struct("<qIBBBB64s")
_BUS_ERROR = 0x80
_LONGEST_LINE = 1 << 20
_ERROR_LENGTH = 8


class PythonCanReader(LogReader):
    """Reads ASC, TRC, CSV and SQLite logs.

    Stamps have the precision of python-can's floats, and are rounded to 1 µs. Those of ASC count
    from the start of the measurement. Lines without a frame that are no comment are counted as
    skipped. CSV and SQLite have no FD flag; a frame of more than 8 bytes is CAN FD.
    """

    def _fill(self, batch: FrameBatch) -> Generator[None]:
        suffix = self.format_suffix
        reader, beginning, expected = FORMATS[suffix]
        self._source: Any = None
        with self._open() as file:
            head = memoryview(bytearray(_HEAD_BYTES))
            head = bytes(head[: self._read_into(file, head)])
            if head and not beginning.match(head):
                raise LogError(f"{self.path}:1: must begin with {expected}; got {head[:40]!r}")
            if suffix == ".db":
                yield from self._take(batch, _rows(self.path), None)
                return
            file.seek(0)
            lines = _Lines(file, self.path)
            text: Any = lines  # python-can reads it like a text file
            with reader(text) as messages:
                self._source = messages
                yield from self._take(batch, iter(messages), lines)

    def _take(
        self, batch: FrameBatch, messages: Iterator[can.Message], lines: _Lines | None
    ) -> Generator[None]:
        """Fill the batch from messages; `lines` are their source."""
        number = 0
        while True:
            number += 1
            try:
                message = next(messages, None)
                if lines is not None:
                    lines.taken += message is not None
                if message is None:
                    break
                fields = self._fields(message)
                if fields is not None:
                    _RECORD.pack_into(batch.records.data, 80 * batch.count, *fields)
                    batch.count += 1
            except LogError:
                raise
            except Exception as error:  # a parser may raise anything on invalid input
                place, what = (f":{lines.number}", "line") if lines else (f": row {number}", "row")
                got = f"{lines.text.strip()[:80]!r} ({error})" if lines else str(error)
                raise LogError(
                    f"{self.path}{place}: must be a {what} of a {self.format_suffix} log; got {got}"
                ) from error
            if not batch.room:
                yield
        if lines is not None and lines.without_frame:
            self.skipped["line"] = lines.without_frame

    def _fields(self, message: can.Message) -> tuple[Any, ...] | None:
        """Fields of a record, or None for an unwanted bus."""
        channel: Any = message.channel
        name = "" if channel is None else f"can{channel}"
        if isinstance(self._source, can.TRCReader):
            # TRC numbers buses from 1, and its reader does not change that; or has none.
            has_bus = self._source.file_version == can.TRCFileVersion.V1_3 or (
                "B" in self._source.columns
            )
            name = f"can{(channel or 0) - 1}" if has_bus else ""
        bus = self._channels.index(name)
        if bus == LEFT_OUT:
            self._skip(f"frame of {name}")
            return None
        can_id, length, flags, data = message.arbitration_id, message.dlc, 0, bytes(message.data)
        limit = 0x1FFF_FFFF if message.is_extended_id or message.is_error_frame else 0x7FF
        if not 0 <= can_id <= limit:
            raise ValueError(f"identifier {can_id:#x} above {limit:#x}")
        if message.is_error_frame:
            can_id = CAN_ERR | (can_id or _BUS_ERROR)
            length = _ERROR_LENGTH
        else:
            if message.is_fd or length > 8:
                flags = FD_FDF | FD_BRS * message.bitrate_switch
                flags |= FD_ESI * message.error_state_indicator
            if message.is_extended_id:
                can_id |= CAN_EFF
            if message.is_remote_frame and not flags:
                can_id |= CAN_RTR
            elif len(data) != length:
                # The reader of TRC returns the length code of a CAN FD frame as its length.
                if not (message.is_fd and length < 16 and len(data) == dlc2len(length)):
                    raise ValueError(f"{len(data)} data bytes where {length} are reported")
                length = len(data)
        if length > 64:
            raise ValueError(f"{length} data bytes")
        stamp_ns = 1000 * round(1e6 * message.timestamp)
        origin = 0 if message.is_rx else ECHO
        return stamp_ns, can_id, length, flags, origin, bus, data


def _rows(path: Path) -> Iterator[can.Message]:
    """Messages of a database, as written by python-can's logger. Its own reader executes views,
    which may be endless, allocates as many bytes as an integer in place of data says, and opens the
    file for writing."""
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        found = database.execute("SELECT type FROM sqlite_master WHERE name = 'messages'")
        if (kind := found.fetchone()) != ("table",):
            raise ValueError(f"messages: must be a table; got {kind[0] if kind else 'none'}")
        for stamp, can_id, extended, remote, error, length, data in database.execute(
            "SELECT ts, arbitration_id, extended, remote, error, dlc, data FROM messages"
        ):
            if not isinstance(data, bytes | None):
                raise ValueError(f"data: must be bytes; got {type(data).__name__}")
            yield can.Message(
                timestamp=stamp, arbitration_id=can_id, is_extended_id=bool(extended),
                is_remote_frame=bool(remote), is_error_frame=bool(error), dlc=length, data=data,
            )  # fmt: skip


class _Lines:
    """Lines of a text file for python-can's readers; counts them."""

    def __init__(self, file: BinaryIO, path: object) -> None:
        self._file = io.TextIOWrapper(file, encoding="utf-8", errors="replace")
        self._path = path
        self._insert_blank = False
        self.number = 0
        self.text = ""
        self.taken = 0
        self._candidates = 0

    @property
    def without_frame(self) -> int:
        """Lines that are neither comment nor frame."""
        return self._candidates - self.taken

    def __iter__(self) -> _Lines:
        return self

    def __next__(self) -> str:
        if self._insert_blank:
            self._insert_blank = False
            return "\n"
        self.text = self._file.readline(_LONGEST_LINE)
        if not self.text:
            raise StopIteration
        self.number += 1
        if not self.text.endswith("\n"):
            cut = "more" if len(self.text) == _LONGEST_LINE else "the end of the file"
            raise LogError(
                f"{self._path}:{self.number}: must be a whole line, with its end; got "
                f"{self.text[:80]!r}, then {cut}"
            )
        self._candidates += not _COMMENT.match(self.text)
        base = _ASC_BASE.match(self.text)
        if base:
            if (base["stamps"] or "").lower() == "relative":
                raise LogError(
                    f"{self._path}:{self.number}: must be a log with absolute time stamps; got "
                    f"{self.text.strip()!r}"
                )
            # The ASC reader drops one line after the header, even a frame.
            self._insert_blank = True
        return self.text

    def close(self) -> None:
        self._file.close()
