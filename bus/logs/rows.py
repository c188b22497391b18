"""RowReader: text formats with a frame a line, and tables of python-can's.

A line is a frame only as a whole. python-can's readers also take a line that is cut, short of bytes
or joined to the next one, do not say which frames of ASC are CAN FD, and end at a line of another
kind.
"""

from __future__ import annotations

import re
import sqlite3
import struct
import zlib
from base64 import b64decode
from collections.abc import Generator, Iterator
from contextlib import closing
from datetime import UTC, datetime, timedelta
from typing import Any, BinaryIO, ClassVar

from bus.errors import ChannelError, LogError
from bus.frame import (
    CAN_EFF,
    CAN_ERR,
    CAN_RTR,
    ECHO,
    FD_BRS,
    FD_ESI,
    FD_FDF,
    FD_LENGTHS,
    FrameBatch,
)
from bus.logs.channels import LEFT_OUT
from bus.logs.reader import LogReader

__all__ = ["FORMATS", "RowReader"]

CSV_HEAD = "timestamp,arbitration_id,extended,remote,error,dlc,data"
_HEAD_BYTES = 4096
_LONGEST_LINE = 1 << 20
_RECORD = struct.Struct("<qIBBBB64s")
_BUS_ERROR, _ERROR_BYTES = 0x80, 8
_CLASSIC_BYTES, _FD_BYTES = 8, 64
_CONTROL = re.compile(r"[\0-\x08\x0e-\x1f\x7f]")
_BYTE = re.compile(r"[\dA-Fa-f]{2}")

Row = tuple[int, int, int, int, int, str, bytes]
"""Stamp, identifier, length, flags, origin, number of the channel ("": none), data of a frame."""


def _frame(
    stamp_ns: int, number: int, kind: int, length: int, data: bytes, flags: int = 0,
    channel: str = "", is_sent: bool = False,
) -> Row:  # fmt: skip
    """A frame; `kind` has the upper bits of its identifier."""
    if kind & CAN_ERR:
        return stamp_ns, CAN_ERR | (number or _BUS_ERROR), _ERROR_BYTES, 0, 0, channel, data
    if not 0 <= number <= (limit := 0x1FFF_FFFF if kind & CAN_EFF else 0x7FF):
        raise ValueError(f"identifier {number:#x} above {limit:#x}")
    if length > _CLASSIC_BYTES:
        flags |= FD_FDF
    if length > _FD_BYTES or (len(data) != length and not kind & CAN_RTR):
        raise ValueError(f"{len(data)} data bytes where {length} are reported")
    return stamp_ns, number | kind, length, flags, ECHO * is_sent, channel, data


class _Asc:
    """Lines of Vector's ASC."""

    BEGINS, EXPECTED = re.compile(rb"\s*(date|base|//)", re.I), "'date', 'base' or '//'"
    COMMENT = re.compile(
        r"\s*(//|$|date|base|(no\s+)?internal\s+events|previous|(begin|end)\s+trigger)", re.I
    )
    _BASE = re.compile(r"\s*base\s+(hex|dec)(?:\s+timestamps\s+(\w+))?", re.I)
    _STAMPED = re.compile(r"\s*(\d+)\.(\d{1,9})\s+(.*)\n")
    _ERROR = re.compile(r"(?:CANFD\s+)?(\d+)\s+(?:[RT]x\s+)?ErrorFrame\b", re.I)
    _EVENT = re.compile(
        # A request to send is an event; its frame follows, as Tx.
        r"(?:\d+\s+\w+|CANFD\s+\d+)\s+TxRq\s|CANFD\s+\d+\s+(?![RT]x\b)[a-z]"
        r"|(?!CANFD\b|\d+\s+(?:[\da-f]+x?(?:\s|$)|\S+\s+[RT]x\s))(?:\d+\s+)?[a-z][!-~]*(?:\s|$)",
        re.I,
    )
    _REMOTE, _FD = 0x10, 0x1000

    def __init__(self) -> None:
        self._base = 16

    def __call__(self, line: str) -> Row | None:
        if base := self._BASE.match(line):
            if (base[2] or "").lower() == "relative":
                raise LogError(f"must be a log with absolute time stamps; got {line.strip()!r}")
            self._base = 10 if base[1].lower() == "dec" else 16
        if self.COMMENT.match(line):
            return None
        found = self._STAMPED.match(line)
        if found is None:
            raise ValueError("neither a frame nor an event, with its end")
        stamp_ns, text = int(found[1]) * 10**9 + int(found[2].ljust(9, "0")), found[3]
        if error := self._ERROR.match(text):
            return _frame(stamp_ns, 0, CAN_ERR, 0, b"", channel=error[1])
        return None if self._EVENT.match(text) else self._data(stamp_ns, text.split())

    def _data(self, stamp_ns: int, words: list[str]) -> Row:
        """The frame of words behind a stamp."""
        in_fd, flags = words[0].upper() == "CANFD", 0
        if in_fd:
            _, channel, way, number, *words = words
            brs, esi, code, count, *words = words[not words[0].isdigit() :]  # behind a name
        else:
            channel, number, way, sort, *words = words
            code, *words = words or ["0"] * (sort == "r")
            count = {"d": str(min(int(code, self._base), _CLASSIC_BYTES)), "r": "0"}[sort]
        kind, dlc = CAN_EFF * (number[-1] in "xX"), int(code, self._base)
        length, data, more = min(dlc, _CLASSIC_BYTES), words[: int(count)], words[int(count) :]
        # A line of an FD channel; the flags of the frame, third behind its data, have the rest.
        bits = int(more[2], 16) if in_fd else self._REMOTE * (sort == "r")
        if bits & self._FD:
            length = FD_LENGTHS[dlc]
            flags = FD_FDF + FD_BRS * (brs == "1") + FD_ESI * (esi == "1")
        elif bits & self._REMOTE and not data:
            kind |= CAN_RTR
        # Words come next, or a duration, 0 or of many digits: no byte, no stamp of another line.
        is_longer = more and self._is_byte(more[0]) and (self._base == 16 or not in_fd)
        if is_longer or not all(map(self._is_byte, data)) or way not in ("Rx", "Tx") or (
            re.search(r"\d\.\d", " ".join(more))
        ):  # fmt: skip
            raise ValueError("not one whole frame")
        content = bytes(int(byte, self._base) for byte in data)
        return _frame(stamp_ns, int(number.rstrip("xX"), self._base), kind, length, content, flags,
                      channel, way == "Tx")  # fmt: skip

    def _is_byte(self, word: str) -> bool:
        return bool(_BYTE.fullmatch(word)) if self._base == 16 else word.isdecimal()


class _Trc:
    """Lines of PEAK's TRC."""

    BEGINS, EXPECTED = re.compile(rb"\s*;"), "';'"
    COMMENT = re.compile(r"\s*(;|$)")
    # Before version 2 the direction stands in the place of the type.
    _COLUMNS: ClassVar = {"1.0": "NOILD", "1.1": "NOdILD", "1.2": "NOBdILD", "1.3": "NOBdIRLD"}
    _HEAD = re.compile(r"\s*;\$(\w+)=(.*?)\s*$")
    _BEGIN = datetime(1899, 12, 30, tzinfo=UTC) - datetime(1970, 1, 1, tzinfo=UTC)
    _EVENTS = ("Warng", "Error", "ST", "ER", "EC", "EV")
    _FLAGS: ClassVar = {"Rx": 0, "Tx": 0, "DT": 0, "RR": 0, "FD": FD_FDF, "FB": FD_FDF | FD_BRS,
              "FE": FD_FDF | FD_BRS | FD_ESI, "BI": FD_FDF | FD_ESI}  # fmt: skip

    def __init__(self) -> None:
        self._columns, self._start_ns = list(self._COLUMNS["1.0"]), 0

    def __call__(self, line: str) -> Row | None:
        if head := self._HEAD.match(line):
            self._take(*head.groups())
        if self.COMMENT.match(line):
            return None
        words = line.split(maxsplit=len(self._columns) - 1)
        cells = {"D": "", "B": "", "d": "Rx"} | dict(zip(self._columns, words, strict=False))
        kind, number = cells.get("T", cells["d"]), cells["I"]
        if kind in self._EVENTS or number == "FFFFFFFF":
            return None
        flags, length = self._FLAGS[kind], int(cells["l"] if "l" in cells else cells["L"])
        is_remote = kind == "RR" or cells["D"].strip() == "RTR"
        data = [] if is_remote else cells["D"].split()
        if not (re.fullmatch(r"\d+\)?", cells["N"]) and re.fullmatch("[0-9A-Fa-f]{1,8}", number)
                and cells["d"] in ("Rx", "Tx") and all(map(_BYTE.fullmatch, data))):  # fmt: skip
            raise ValueError("not one whole frame")
        return _frame(
            self._start_ns + 1000 * round(1000 * float(cells["O"])), int(number, 16),
            CAN_EFF * (len(number) > 4) | CAN_RTR * is_remote,
            FD_LENGTHS[length] if flags and "l" not in cells else length,
            bytes.fromhex("".join(data)), flags, cells["B"], cells["d"] == "Tx",
        )  # fmt: skip

    def _take(self, name: str, value: str) -> None:
        """Take a line of the head."""
        if name == "FILEVERSION" and value not in (*self._COLUMNS, "2.0", "2.1"):
            raise LogError(f"must be of version 1.0 to 1.3, 2.0 or 2.1; got {value!r}")
        if name == "STARTTIME":
            begin = self._BEGIN + timedelta(days=float(value))
            self._start_ns = 1000 * (begin // timedelta(microseconds=1))
        elif name in ("FILEVERSION", "COLUMNS"):
            self._columns = list(self._COLUMNS.get(value) or value.split(","))


class _Csv:
    """Lines of python-can's CSV."""

    BEGINS, EXPECTED = re.compile(CSV_HEAD.encode()), repr(CSV_HEAD)
    COMMENT = re.compile(rf"{CSV_HEAD}|\s*$")

    def __call__(self, line: str) -> Row | None:
        if self.COMMENT.match(line):
            return None
        stamp, number, *bits, length, data = line.strip().split(",")
        cells = float(stamp), int(number, 16), *map(["0", "1"].index, bits), int(length)
        return _Table()((*cells, b64decode(data, validate=True)))


class _Table:
    """Rows of a table of python-can's logger."""

    BEGINS, EXPECTED = re.compile(rb"SQLite format 3\0"), "'SQLite format 3'"

    def __call__(self, row: Any) -> Row:
        stamp_s, number, extended, remote, error, length, data = row
        if not isinstance(data, bytes | None):
            raise ValueError(f"data: must be bytes; got {type(data).__name__}")
        kind = CAN_EFF * bool(extended) | CAN_RTR * bool(remote) | CAN_ERR * bool(error)
        return _frame(1000 * round(1e6 * stamp_s), number, kind, length, data or b"")


FORMATS: dict[str, Any] = {".asc": _Asc, ".csv": _Csv, ".db": _Table, ".trc": _Trc}
"""What reads the rows of each format."""


class RowReader(LogReader):
    """Reads ASC, TRC, CSV and SQLite logs.

    Stamps of ASC count from the start of the measurement; those of the others have the precision of
    floats, and are rounded to 1 µs. Events are counted as skipped. CSV and SQLite have no FD flag:
    a frame of more than 8 bytes is CAN FD.
    """

    def _fill(self, batch: FrameBatch) -> Generator[None]:
        suffix = self.format_suffix
        take = FORMATS[suffix]()
        what, mark = ("row", ": row ") if suffix == ".db" else ("line", ":")
        with self._open() as file:
            head = memoryview(bytearray(_HEAD_BYTES))
            head = bytes(head[: self._read_into(file, head)])
            if head and not take.BEGINS.match(head):
                raise LogError(f"{self.path}:1: must begin with {take.EXPECTED}; got {head[:40]!r}")
            file.seek(0)
            for number, row in enumerate(self._table() if what == "row" else self._lines(file), 1):
                place = f"{self.path}{mark}{number}"
                try:
                    if what == "line" and _CONTROL.search(row):
                        raise ValueError("bytes that no text has")
                    frame = take(row)
                    if frame is not None:
                        self._add(batch, frame)
                    elif not take.COMMENT.match(row):
                        self._skip("line")
                except ChannelError:
                    raise
                except LogError as error:
                    raise LogError(f"{place}: {error}") from None
                except Exception as error:  # anything may be wrong with a row
                    got = f"{str(row).strip()[:80]!r} ({error})"
                    self._leave_out(f"{place}: must be a {what} of a {suffix} log; got {got}")
                if not batch.room:
                    yield

    def _add(self, batch: FrameBatch, row: Row) -> None:
        """Add a frame, if it is of a wanted bus."""
        stamp_ns, can_id, length, flags, origin, channel, data = row
        name = f"can{int(channel) - 1}" if channel else ""
        bus = self._channels.index(name)
        if bus == LEFT_OUT:
            self._skip(f"frame of {name}")
            return
        _RECORD.pack_into(batch.records.data, _RECORD.size * batch.count, stamp_ns, can_id, length,
                          flags, origin, bus, data)  # fmt: skip
        batch.count += 1

    def _lines(self, file: BinaryIO) -> Iterator[str]:
        """Lines with their ends, which the last one may lack; endless ones in pieces."""
        try:
            while line := file.readline(_LONGEST_LINE):
                yield line.decode("utf-8", "replace")
        except (OSError, EOFError, zlib.error) as error:
            raise LogError(f"{self.path}: must be readable to its end; got: {error}") from error

    def _table(self) -> Iterator[Any]:
        """Rows of python-can's table. Its own reader executes views, which may be endless,
        allocates as many bytes as an integer in place of data says, and opens the file for
        writing."""
        number = 1
        try:
            place = f"{self.path.absolute().as_uri()}?mode=ro"
            with closing(sqlite3.connect(place, uri=True)) as database:
                found = database.execute("SELECT type FROM sqlite_master WHERE name = 'messages'")
                if (kind := found.fetchone()) != ("table",):
                    raise ValueError(
                        f"messages: must be a table; got {kind[0] if kind else 'none'}"
                    )
                for row in database.execute(
                    "SELECT ts, arbitration_id, extended, remote, error, dlc, data FROM messages"
                ):
                    yield row
                    number += 1
        except (sqlite3.Error, ValueError) as error:
            raise LogError(
                f"{self.path}: row {number}: must be a row of a .db log; got {error}"
            ) from error
