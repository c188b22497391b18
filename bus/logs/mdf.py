"""MdfReader: MDF 4 files with bus logging, through asammdf (the extra `mdf`).

A file that is damaged may crash asammdf's C code, and with it the process. So it reads in a process
of its own, ``python -m bus.logs.mdf FILE PIECE``, which hands the frames over piece by piece.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Generator, Iterator
from datetime import UTC, datetime, timedelta
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from signal import Signals
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
    FRAME_DTYPE,
    FrameBatch,
)
from bus.logs.channels import LEFT_OUT
from bus.logs.reader import LogReader

__all__ = ["MdfReader"]

_BEGINNINGS = (b"MDF     ", b"UnFinMF ")
_KINDS = ("CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame")
_PIECE = 65536
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_IDENTIFIER, _STANDARD = 0x1FFF_FFFF, 0x7FF
_BUS_ERROR = 0x80
_CLASSIC_BYTES, _FD_BYTES, _ERROR_BYTES = 8, 64, 8


class MdfReader(LogReader):
    """Reads the frames of all buses from MDF 4 files that follow ASAM's bus logging.

    The frames of all groups come in the order of their stamps, which are as exact as the file's
    floats. Bus channel 1 is can1. In memory are some ten thousand frames and the stamps of all.
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
        """Frames and their bus channels, piece by piece, from the process that reads."""
        reading = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, str(self.path), str(_PIECE)],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )  # fmt: skip
        assert reading.stdout is not None
        with reading:
            try:
                while (told := _told(reading.stdout)) is not None:
                    if not isinstance(told, str):
                        yield told
                    elif told:
                        raise LogError(f"{self.path}: must be a whole MDF 4 file; got: {told}")
                    else:
                        return
                why = _ended(reading.wait())
                raise LogError(f"{self.path}: must be a whole MDF 4 file; got: {why}")
            finally:
                reading.kill()

    def _assign(self, records: np.ndarray, channels: np.ndarray) -> np.ndarray:
        """Give each frame its bus; return those of buses that count."""
        found, first, inverse = np.unique(channels, return_index=True, return_inverse=True)
        buses = np.zeros(found.size, np.int64)
        for k in np.argsort(first):
            name = f"can{found[k]}"
            buses[k] = self._channels.index(name)
            if buses[k] == LEFT_OUT:
                self._skip(f"frame of {name}", int((inverse == k).sum()))
        bus = buses[inverse]
        records["bus"] = np.maximum(bus, 0)
        return records[bus != LEFT_OUT]


def _told(pipe: IO[bytes]) -> Any:
    """What the process that reads says next; None where it has ended in the midst of it."""
    try:
        return pickle.load(pipe)
    except (EOFError, pickle.UnpicklingError):
        return None


def _ended(status: int) -> str:
    """How the process that reads has ended, in words."""
    how = f"signal {Signals(-status).name}" if status < 0 else f"status {status}"
    return f"the end of the process that reads it, {how}"


def _pieces(file: Any, size: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the frames of all groups and their channels, merged by time, piece by piece."""
    groups = []
    for index, group in enumerate(file.groups):
        names = {channel.name for channel in group.channels}
        kind = next((kind for kind in _KINDS if kind in names), None)
        if kind is not None and group.channel_group.cycles_nr:
            groups.append(_Group(file, index, kind))
    if not groups:
        return
    # A stamp that steps back must not change the order within a group.
    stamps = [np.maximum.accumulate(group.stamps) for group in groups]
    source = np.repeat(np.arange(len(groups)), [stamp.size for stamp in stamps])
    source = source[np.argsort(np.concatenate(stamps), kind="stable")]
    begin = file.header.start_time.astimezone(UTC) - _EPOCH
    for first in range(0, source.size, size):
        piece = source[first : first + size]
        records, channels = np.zeros(piece.size, FRAME_DTYPE), np.zeros(piece.size, np.int64)
        for g in np.unique(piece):
            mine = piece == g
            records[mine], channels[mine] = groups[g].read(int(mine.sum()))
        records["stamp_ns"] += 1000 * (begin // timedelta(microseconds=1))
        yield records, channels


class _Group:
    """Frames of one kind and channel group, read from the first to the last."""

    def __init__(self, file: Any, index: int, kind: str) -> None:
        self.stamps = np.asarray(file.get_master(index), float)
        self._file, self._index, self._kind = file, index, kind
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
            if rows[full].dtype.kind == "S":  # the direction, in words
                return (np.char.lower(rows[full]) == b"tx").astype(np.int64)
            return rows[full].astype(np.int64)

        number = column("ID") & _IDENTIFIER
        extended = (column("IDE") > 0) | (column("ID") & CAN_EFF > 0) | (number > _STANDARD)
        can_id = number | np.where(extended, CAN_EFF, 0)
        length = column("DataLength")
        if self._kind == "CAN_RemoteFrame":
            can_id |= CAN_RTR
            length = np.minimum(column("DLC"), _CLASSIC_BYTES)
        elif self._kind == "CAN_ErrorFrame":
            can_id = CAN_ERR | np.where(number > 0, number, _BUS_ERROR)
            length = np.full(count, _ERROR_BYTES)
        else:
            kind = FD_FDF + FD_BRS * (column("BRS") > 0) + FD_ESI * (column("ESI") > 0)
            records["flags"] = np.where((column("EDL") > 0) | (length > _CLASSIC_BYTES), kind, 0)
        if length.max() > _FD_BYTES:
            raise ValueError(f"a frame of {length.max()} bytes")
        if f"{self._kind}.DataBytes" in rows.dtype.names and self._kind != "CAN_RemoteFrame":
            data = rows[f"{self._kind}.DataBytes"].reshape(count, -1)[:, :_FD_BYTES]
            there = np.arange(data.shape[1]) < length[:, np.newaxis]
            records["data"][:, : data.shape[1]] = np.where(there, data, 0)
        records["id"], records["length"] = can_id, length
        records["origin"] = np.where(column("Dir") > 0, ECHO, 0)
        return records, column("BusChannel")


def main() -> None:
    """Hand the frames of a file over: pairs of arrays, then an empty text, or what went wrong."""
    path, size = Path(sys.argv[1]), int(sys.argv[2])
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # whatever a library prints is no part of what is handed over
        try:
            with import_module("asammdf").MDF(path) as file:
                for pair in _pieces(file, size):
                    pickle.dump(pair, out, pickle.HIGHEST_PROTOCOL)
            told = ""
        except BrokenPipeError:  # nobody reads on
            os._exit(0)
        except Exception as error:  # anything may come of reading a file that is damaged
            told = repr(error)
        pickle.dump(told, out)


if __name__ == "__main__":
    main()
