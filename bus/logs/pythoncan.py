"""PythonCanReader: ASC, TRC, CSV and SQLite by python-can."""

from __future__ import annotations

import gzip
import re
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np

from bus.errors import LogError
from bus.frame import CAN_ERR, ECHO, FD_FDF, FRAME_DTYPE, FrameBatch
from bus.logs.channels import LEFT_OUT
from bus.logs.reader import LogReader
from bus.pythoncan import from_message

__all__ = ["PythonCanReader"]

_LONGEST_FAULT = 1000
_BUS_ERROR = 0x80
_CLASSIC_BYTES, _FD_BYTES, _ERROR_BYTES = 8, 64, 8
_BEGINNINGS: dict[str, tuple[re.Pattern[bytes], str]] = {
    ".asc": (re.compile(rb"\s*(date|base|//)", re.I), "'date', 'base' or '//'"),
    ".csv": (re.compile(rb"timestamp,arbitration_id,"), "'timestamp,arbitration_id,'"),
    ".db": (re.compile(rb"SQLite format 3\0"), "'SQLite format 3'"),
    ".trc": (re.compile(rb"\s*;"), "';'"),
}
_RELATIVE = re.compile(rb"^\s*base\s+(hex|dec)\s+timestamps\s+relative", re.I | re.M)
_HEAD_BYTES = 4096


class PythonCanReader(LogReader):
    """Reads what python-can reads.

    Stamps of ASC count from the start of the measurement; all have the precision of floats. Events
    and lines that python-can does not know are left out. CSV and SQLite have no FD flag: a frame of
    more than 8 bytes is CAN FD.
    """

    def _fill(self, batch: FrameBatch) -> Generator[None]:
        suffix = self.format_suffix
        with self._open() as file:
            view = memoryview(bytearray(_HEAD_BYTES))
            head = bytes(view[: self._read_into(file, view)])
        pattern, expected = _BEGINNINGS[suffix]
        if head and not pattern.match(head):
            raise LogError(f"{self.path}:1: must begin with {expected}; got {head[:40]!r}")
        if suffix == ".asc" and (found := _RELATIVE.search(head)):
            raise LogError(
                f"{self.path}: must be a log with absolute time stamps; got {found[0].decode()!r}"
            )
        for name, frame in self._frames(suffix):
            bus = self._channels.index(name)
            if bus == LEFT_OUT:
                self._skip(f"frame of {name}")
                continue
            frame["bus"] = bus
            batch.extend(frame)
            if not batch.room:
                yield

    def _frames(self, suffix: str) -> Generator[tuple[str, np.ndarray]]:
        """Channel and frame, always the same array of shape (1,), of each message."""
        frame = np.zeros(1, FRAME_DTYPE)
        view = memoryview(frame.view(np.uint8).data)
        # python-can counts the channels of ASC from 0, those of TRC from 1
        first = 0 if suffix == ".asc" else 1
        try:
            with _messages(self.path, suffix) as messages:
                for message in messages:
                    if len(message.data) > _FD_BYTES:
                        raise ValueError(f"a frame of {len(message.data)} bytes")
                    frame[:] = 0
                    from_message(message, view, 0, 0)
                    frame["stamp_ns"] = 1000 * round(1e6 * message.timestamp)
                    frame["origin"] = 0 if message.is_rx else ECHO
                    if message.is_error_frame:
                        frame["id"] = CAN_ERR | (int(frame["id"][0]) & ~CAN_ERR or _BUS_ERROR)
                        frame["length"] = _ERROR_BYTES
                    elif len(message.data) > _CLASSIC_BYTES:
                        frame["flags"] |= FD_FDF
                    channel = message.channel
                    yield "" if channel is None else f"can{channel - first}", frame
        except Exception as error:  # a damaged file may raise anything
            fault = repr(error)[:_LONGEST_FAULT]
            raise LogError(f"{self.path}: must be a whole {suffix} log; got: {fault}") from error


def _messages(path: Path, suffix: str) -> Any:
    """python-can's reader of a file."""
    import can

    class AscReader(can.ASCReader):
        """Knows the classic frames of a CAN FD channel by the flags behind their data, and loses
        no frame that directly follows the head."""

        def _extract_header(self) -> None:
            super()._extract_header()
            self.file.seek(0)

        def _process_fd_can_frame(self, line: str, msg_kwargs: dict[str, Any]) -> can.Message:
            message = super()._process_fd_can_frame(line, msg_kwargs)
            if not message.is_error_frame:
                words = line.split()
                size_at = 6 if words[3].isdigit() else 7  # there may be a symbolic name
                flags = int(words[size_at + int(words[size_at]) + 3], 16)
                message.is_fd = bool(flags & 0x1000)
                message.is_remote_frame = bool(flags & 0x10) and not message.is_fd
            return message

    readers = {".asc": AscReader, ".csv": can.CSVReader, ".db": can.SqliteReader,
               ".trc": can.TRCReader}  # fmt: skip
    packed = path.suffix.lower() == ".gz"
    return readers[suffix](gzip.open(path, "rt", encoding="utf-8") if packed else path)
