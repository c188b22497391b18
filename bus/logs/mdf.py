"""MdfReader: MDF 4 files with bus logging, through asammdf (the extra `mdf`).

A damaged file may crash asammdf's C code, and with it the process, or keep it busy for ever. So it
runs in a process of its own with a bound of computing, ``python -m bus.logs.mdf FILE PIECE
SECONDS``, which sends the frames in pieces, as blocks: a byte for the kind, the count of bytes as a
little-endian u64, then an array in `numpy.lib.format`, or a UTF-8 text. A piece is an array of
frames and one of their bus channels, -1 without one, and `_FROM_ZERO` more in a file that counts
from 0; the text is empty at the end of the file, or an error. Nothing is ever unpickled.
"""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
from collections.abc import Generator, Iterator
from datetime import UTC, datetime, timedelta
from importlib import import_module
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np

from bus.errors import LogError
from bus.frame import (
    CAN_EFF,
    CAN_ERR,
    CAN_RTR,
    ECHO,
    FD_BRS,
    FD_ESI,
    FD_FDF,
    FD_LENGTHS,
    FRAME_DTYPE,
    FrameBatch,
)
from bus.logs.channels import LEFT_OUT
from bus.logs.reader import LogReader

__all__ = ["MdfReader"]

_BEGINNINGS = (b"MDF     ", b"UnFinMF ")
_KINDS = ("CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame")
_PIECE = 65536
_FROM_ZERO = 1 << 32
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_IDENTIFIER, _STANDARD = 0x1FFF_FFFF, 0x7FF
_BUS_ERROR = 0x80
_CLASSIC_BYTES, _FD_BYTES, _ERROR_BYTES = 8, 64, 8
_HEAD = struct.Struct("<cQ")
_ARRAY, _TEXT = b"a", b"t"
_SECONDS, _BYTES_PER_SECOND = 15.0, 1 << 20
"""Computing that a file takes at most: so much, and 1 s for each so many bytes [assumed: ten times
what whole files take]."""
_LARGEST = 2 * _PIECE * FRAME_DTYPE.itemsize
"""Upper bound of the bytes of a block."""


class MdfReader(LogReader):
    """Reads the frames of all buses from MDF 4 files that follow ASAM's bus logging.

    The frames of all groups come in the order of their stamps, which have the precision of the
    file's floats. Bus channel 1 is can0, as of loggers, but 0 is in a file that has a channel 0, as
    of python-can. Memory holds some ten thousand frames, and the stamps and channels of all.
    """

    def _fill(self, batch: FrameBatch) -> Generator[None]:
        with self.path.open("rb") as file:
            beginning = file.read(len(_BEGINNINGS[0]))
        if beginning not in _BEGINNINGS:
            raise LogError(f"{self.path}: byte 0: must be 'MDF     '; got {beginning!r}")
        if find_spec("asammdf") is None:
            raise LogError(
                f"{self.path}: must have asammdf; not installed: pip install 'f3t-skin[mdf]'"
            )
        for pair in self._pairs():
            records, taken = self._assign(*pair), 0
            while taken < records.size:
                taken += batch.extend(records[taken:])
                if not batch.room:
                    yield

    def _pairs(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Frames and their bus channels, in pieces, from the reading process."""
        seconds = _SECONDS + self.path.stat().st_size / _BYTES_PER_SECOND
        reading = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, str(self.path), str(_PIECE), str(seconds)],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )  # fmt: skip
        assert reading.stdout is not None
        with reading:
            try:
                why = yield from _given(reading.stdout)
                if why is None:
                    why = _ended(reading.wait())
                if why:
                    raise LogError(f"{self.path}: must be a whole MDF 4 file; got: {why}")
            finally:
                reading.kill()

    def _assign(self, records: np.ndarray, channels: np.ndarray) -> np.ndarray:
        """Assign buses to frames; returns those of wanted buses."""
        if (is_from_zero := channels >= _FROM_ZERO).any():
            self._channels.first, channels = 0, channels - _FROM_ZERO * is_from_zero
        found, first, inverse = np.unique(channels, return_index=True, return_inverse=True)
        buses = np.zeros(found.size, np.int64)
        for k in np.argsort(first):
            name = f"can{found[k] - (self._channels.first or 0)}" if found[k] >= 0 else ""
            buses[k] = self._channels.index(name)
            if buses[k] == LEFT_OUT:
                self._skip(f"frame of {name}", int((inverse == k).sum()))
        bus = buses[inverse]
        records["bus"] = np.maximum(bus, 0)
        return records[bus != LEFT_OUT]


def _given(pipe: IO[bytes]) -> Generator[tuple[np.ndarray, np.ndarray], None, str | None]:
    """Yield the pieces from the reading process; returns its error, "" for none, None where it
    ended early."""
    while True:
        try:
            first = _received(pipe)
            if first is None or isinstance(first, str):
                return first
            second = _received(pipe)
            if second is None:
                return None
        except ValueError as error:
            return f"from the process that reads it, {error}"
        if isinstance(second, str) or not (
            (first.dtype, second.dtype) == (FRAME_DTYPE, np.int64)
            and first.shape == second.shape == (first.size,)
        ):
            return "from the process that reads it, arrays that are no frames"
        yield first, second


def _received(pipe: IO[bytes]) -> np.ndarray | str | None:
    """The next block of the reading process; None where it ended within one.

    Raises
    ------
    ValueError
        It is not a block.
    """
    head = pipe.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    kind, size = _HEAD.unpack(head)
    if kind not in (_ARRAY, _TEXT) or size > _LARGEST:
        raise ValueError("bytes that are no frames")
    data = pipe.read(size)
    if len(data) < size:
        return None
    if kind == _TEXT:
        return data.decode(errors="replace")
    return np.lib.format.read_array(BytesIO(data), allow_pickle=False)


def _hand_over(out: IO[bytes], block: np.ndarray | str) -> None:
    """Write a block."""
    data = BytesIO()
    if isinstance(block, str):
        data.write(block.encode(errors="backslashreplace")[:_LARGEST])
    else:
        np.lib.format.write_array(data, block, allow_pickle=False)
    out.write(_HEAD.pack(_TEXT if isinstance(block, str) else _ARRAY, data.tell()))
    out.write(data.getbuffer())


def _ended(status: int) -> str:
    """How the reading process ended, as text."""
    if status == -signal.SIGPROF:
        return "more computing than whole files take"
    how = f"signal {signal.Signals(-status).name}" if status < 0 else f"status {status}"
    return f"the end of the process that reads it, {how}"


def _pieces(file: Any, size: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the frames of all groups and their channels, merged by time, piece by piece."""
    groups = []
    for index, group in enumerate(file.groups):
        names = {channel.name for channel in group.channels}
        if "" in names:
            raise ValueError("a channel without a name")
        kind = next((kind for kind in _KINDS if kind in names), None)
        if kind is not None and group.channel_group.cycles_nr:
            groups.append(_Group(file, index, kind))
    if not groups:
        return
    # A stamp that steps back must not change the order within a group.
    stamps = [np.maximum.accumulate(group.stamps) for group in groups]
    source = np.repeat(np.arange(len(groups)), [stamp.size for stamp in stamps])
    source = source[np.argsort(np.concatenate(stamps), kind="stable")]
    from_zero = any(group.has_channel_0 for group in groups)
    begin = file.header.start_time.astimezone(UTC) - _EPOCH
    for first in range(0, source.size, size):
        piece = source[first : first + size]
        records, channels = np.zeros(piece.size, FRAME_DTYPE), np.zeros(piece.size, np.int64)
        for g in np.unique(piece):
            mine = piece == g
            records[mine], channels[mine] = groups[g].read(int(mine.sum()))
        channels[channels >= 0] += _FROM_ZERO * from_zero
        records["stamp_ns"] += 1000 * (begin // timedelta(microseconds=1))
        yield records, channels
    said = sum(group.said for group in groups)
    if source.size != said:
        raise ValueError(f"{source.size} frames, where its groups have {said}")


class _Group:
    """Frames of one kind and channel group, read from the first to the last."""

    def __init__(self, file: Any, index: int, kind: str) -> None:
        self.stamps = np.asarray(file.get_master(index), float)
        self.said = int(file.groups[index].channel_group.cycles_nr)
        self._file, self._index, self._kind = file, index, kind
        name = f"{kind}.BusChannel"
        self.has_channel = any(channel.name == name for channel in file.groups[index].channels)
        numbers = file.get(name, group=index, raw=True).samples if self.has_channel else ()
        self.has_channel_0 = not np.all(numbers)
        self._next = 0

    def read(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Read the next frames.

        Returns
        -------
        records : ndarray, shape (count,), FRAME_DTYPE
            Their stamps count from the beginning of the file.
        channels : ndarray, shape (count,)
        """
        records = np.zeros(count, FRAME_DTYPE)
        records["stamp_ns"] = np.round(1e9 * self.stamps[self._next : self._next + count])
        rows = self._file.get(
            self._kind, group=self._index, raw=True, record_offset=self._next, record_count=count
        ).samples
        self._next += count

        def column(name: str) -> np.ndarray:
            """Numbers, 0 where the file has no such column."""
            full = f"{self._kind}.{name}"
            if full not in rows.dtype.names:
                return np.zeros(count, np.int64)
            if rows[full].dtype.kind == "S":  # the direction, as text
                return (np.char.lower(rows[full]) == b"tx").astype(np.int64)
            return rows[full].astype(np.int64)

        names = {name.removeprefix(f"{self._kind}.") for name in rows.dtype.names}
        has_data = self._kind == "CAN_DataFrame"
        if self._kind != "CAN_ErrorFrame" and not (
            "ID" in names
            and names & {"DataLength", "DLC"}
            and ("DataBytes" in names or not has_data)
        ):
            raise ValueError(f"{self._kind} of {', '.join(sorted(names))} alone")
        number = column("ID") & _IDENTIFIER
        extended = (column("IDE") > 0) | (column("ID") & CAN_EFF > 0) | (number > _STANDARD)
        can_id = number | np.where(extended, CAN_EFF, 0)
        data = rows[f"{self._kind}.DataBytes"] if "DataBytes" in names else records["data"][:, :0]
        data = data.reshape(count, -1)[:, :_FD_BYTES]
        length, is_fd = column("DataLength"), column("EDL") > 0
        if "DataLength" not in names:
            code = column("DLC") & 15
            is_long = is_fd if "EDL" in names else data.shape[1] > _CLASSIC_BYTES
            length = np.where(is_long, np.array(FD_LENGTHS)[code], np.minimum(code, _CLASSIC_BYTES))
        if self._kind == "CAN_RemoteFrame":
            can_id |= CAN_RTR
            length = np.minimum(column("DLC"), _CLASSIC_BYTES)
        elif self._kind == "CAN_ErrorFrame":
            can_id = CAN_ERR | np.where(number > 0, number, _BUS_ERROR)
            length = np.full(count, _ERROR_BYTES)
        else:
            kind = FD_FDF + FD_BRS * (column("BRS") > 0) + FD_ESI * (column("ESI") > 0)
            records["flags"] = np.where(is_fd | (length > _CLASSIC_BYTES), kind, 0)
        if length.max() > (data.shape[1] if has_data else _FD_BYTES):
            raise ValueError(f"a frame of {length.max()} bytes in {data.shape[1]}")
        there = np.arange(data.shape[1]) < length[:, np.newaxis]
        records["data"][:, : data.shape[1]] = np.where(there, data, 0)
        records["id"], records["length"] = can_id, length
        records["origin"] = np.where(column("Dir") > 0, ECHO, 0)
        return records, column("BusChannel") if self.has_channel else np.full(count, -1)


def main() -> None:
    """Send the frames of a file."""
    path, size, seconds = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    signal.setitimer(signal.ITIMER_PROF, seconds)  # its signal ends the process
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # output of libraries goes to stderr
        try:
            with import_module("asammdf").MDF(path) as file:
                for pair in _pieces(file, size):
                    for block in pair:
                        _hand_over(out, block)
            why = ""
        except BrokenPipeError:  # the reader has closed
            os._exit(0)
        except Exception as error:  # a damaged file may raise anything
            why = repr(error)
        _hand_over(out, why)


if __name__ == "__main__":
    main()
