"""PythonCanReader: ASC, TRC, CSV and SQLite by python-can, MF4 by python-can with asammdf.

A damaged file may crash such a library, or keep it busy for ever. So it runs in a process of its
own with a bound of computing, ``python -m bus.logs.pythoncan FILE SECONDS``, which writes `ROW`s to
its standard output, and what is wrong with the file to its standard error.
"""

from __future__ import annotations

import gzip
import os
import re
import signal
import subprocess
import sys
from collections.abc import Generator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from bus.errors import LogError
from bus.frame import CAN_ERR, ECHO, FD_FDF, FRAME_DTYPE, FrameBatch
from bus.logs.channels import LEFT_OUT
from bus.logs.reader import LogReader
from bus.pythoncan import from_message

__all__ = ["PythonCanReader"]

ROW = np.dtype([("channel", np.int64), ("frame", FRAME_DTYPE)])
"""A frame, and the number of its channel as the file counts it; -1 where it names none."""
_ROWS = 1024
"""Rows that are handed over at once."""
_SECONDS, _SECONDS_PER_BYTE = 15.0, 4.0 / (1 << 20)
"""Computing that a file takes at most [assumed: ten times what whole files take]."""
_LONGEST_FAULT = 1000
_BUS_ERROR = 0x80
_CLASSIC_BYTES, _FD_BYTES, _ERROR_BYTES = 8, 64, 8
_BEGINNINGS: dict[str, tuple[re.Pattern[bytes], str]] = {
    ".asc": (re.compile(rb"\s*(date|base|//)", re.I), "'date', 'base' or '//'"),
    ".csv": (re.compile(rb"timestamp,arbitration_id,"), "'timestamp,arbitration_id,'"),
    ".db": (re.compile(rb"SQLite format 3\0"), "'SQLite format 3'"),
    ".mf4": (re.compile(rb"MDF     |UnFinMF "), "'MDF     '"),
    ".trc": (re.compile(rb"\s*;"), "';'"),
}
_RELATIVE = re.compile(rb"^\s*base\s+(hex|dec)\s+timestamps\s+relative", re.I | re.M)
_HEAD_BYTES = 4096


class PythonCanReader(LogReader):
    """Reads what python-can reads.

    Stamps of ASC count from the start of the measurement; all have the precision of floats. Events
    and lines that python-can does not know are left out. CSV and SQLite have no FD flag: a frame of
    more than 8 bytes is CAN FD. Bus channel 1 of MF4 is can0, as of loggers; 0 is in a file whose
    first frame has channel 0, as of python-can.
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
        if suffix == ".mf4" and find_spec("asammdf") is None:
            raise LogError(
                f"{self.path}: must have asammdf; not installed: pip install 'f3t-skin[mdf]'"
            )
        seconds = _SECONDS + self.path.stat().st_size * _SECONDS_PER_BYTE
        with subprocess.Popen(
            [sys.executable, "-P", "-W", "ignore", "-m", __name__, str(self.path), str(seconds)],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        ) as reading:  # fmt: skip
            assert reading.stdout is not None
            assert reading.stderr is not None
            try:
                while data := reading.stdout.read(_ROWS * ROW.itemsize):
                    if whole := len(data) // ROW.itemsize:
                        yield from self._take(np.frombuffer(data, ROW, whole), batch)
                fault = reading.stderr.read().decode(errors="replace")
                if status := reading.wait():
                    fault = fault or _ended(status)
                    raise LogError(f"{self.path}: must be a whole {suffix} log; got: {fault}")
            finally:
                reading.kill()

    def _take(self, rows: np.ndarray, batch: FrameBatch) -> Generator[None]:
        """Assign buses to frames, and add those of wanted ones."""
        channels, first, inverse = np.unique(
            rows["channel"], return_index=True, return_inverse=True
        )
        if self.format_suffix == ".mf4" and not self.channels and rows["channel"][0] == 0:
            self._channels.first = 0
        buses = np.zeros(channels.size, np.int64)
        for k in np.argsort(first):
            number = int(channels[k])
            name = f"can{number - (self._channels.first or 0)}" if number >= 0 else ""
            buses[k] = self._channels.index(name)
            if buses[k] == LEFT_OUT:
                self._skip(f"frame of {name}", int((inverse == k).sum()))
        wanted = buses[inverse] != LEFT_OUT
        frames = rows["frame"][wanted]
        frames["bus"] = buses[inverse][wanted]
        taken = 0
        while taken < frames.size:
            taken += batch.extend(frames[taken:])
            if not batch.room:
                yield


def _ended(status: int) -> str:
    """How the reading process ended, as text."""
    if status == -signal.SIGPROF:
        return "more computing than whole files take"
    how = f"signal {signal.Signals(-status).name}" if status < 0 else f"status {status}"
    return f"the end of the process that reads it, {how}"


def _messages(path: Path) -> Any:
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
               ".mf4": can.MF4Reader, ".trc": can.TRCReader}  # fmt: skip
    suffix = path.suffix.lower()
    if suffix == ".gz":
        return readers[Path(path.stem).suffix.lower()](gzip.open(path, "rt", encoding="utf-8"))
    return readers[suffix](path)


def _write_rows(path: Path, out: BinaryIO) -> None:
    """Write the frames of a file as `ROW`s.

    Raises
    ------
    Exception
        All that a library raises on a damaged file; what comes before it is written.
    """
    rows, frames, count = np.zeros(_ROWS, ROW), np.zeros(_ROWS, FRAME_DTYPE), 0
    view = memoryview(frames.view(np.uint8).data)
    is_asc = ".asc" in path.name.lower()[-len(".asc.gz") :]  # python-can counts its channels from 0
    try:
        for message in _messages(path):
            if len(message.data) > _FD_BYTES:
                raise ValueError(f"a frame of {len(message.data)} bytes")
            from_message(message, view, count, 0)
            frame = frames[count]
            frame["stamp_ns"] = 1000 * round(1e6 * message.timestamp)
            frame["origin"] = 0 if message.is_rx else ECHO
            if message.is_error_frame:
                frame["id"] = CAN_ERR | (int(frame["id"]) & ~CAN_ERR or _BUS_ERROR)
                frame["length"] = _ERROR_BYTES
            elif len(message.data) > _CLASSIC_BYTES:
                frame["flags"] |= FD_FDF
            channel = message.channel
            rows["channel"][count] = -1 if channel is None else channel + is_asc
            count += 1
            if count == _ROWS:
                rows["frame"] = frames
                out.write(rows.tobytes())
                frames[:], count = 0, 0
    finally:
        rows["frame"] = frames
        out.write(rows[:count].tobytes())
        out.flush()


def main() -> None:
    """Send the frames of a file, then what is wrong with it."""
    path, seconds = Path(sys.argv[1]), float(sys.argv[2])
    signal.setitimer(signal.ITIMER_PROF, seconds)  # its signal ends the process
    with os.fdopen(os.dup(1), "wb") as out, os.fdopen(os.dup(2), "w") as fault:
        with open(os.devnull, "w") as nowhere:  # for what libraries print
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
        try:
            _write_rows(path, out)
        except BrokenPipeError:  # the reader has closed
            os._exit(0)
        except Exception as error:  # a damaged file may raise anything
            fault.write(repr(error)[:_LONGEST_FAULT])
            fault.flush()
            os._exit(1)


if __name__ == "__main__":
    main()
