"""Recorded CAN logs in and out, as batches of frames.

Reading: candump (.log) and BLF (.blf) by compiled code; ASC, TRC, CSV and SQLite (.db) through
python-can; MF4 through asammdf. Writing: candump and BLF. Every text format and BLF is also read
with .gz behind its suffix, and candump written so.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from bus.errors import LogError
from bus.frame import FRAME_DTYPE, FrameBatch
from bus.logs.channels import buses_of
from bus.logs.reader import LogReader, existing
from bus.logs.recording import LoggedTransport, Recording
from bus.logs.writer import LogWriter
from topology.files import check_path, named, sync

__all__ = ["LogReader", "LogWriter", "LoggedTransport", "Recording", "buses_of", "open_writer",
           "read", "read_all", "write"]  # fmt: skip

READERS = {
    ".asc": "bus.logs.pythoncan:PythonCanReader",
    ".blf": "bus.logs.blf:BlfReader",
    ".csv": "bus.logs.pythoncan:PythonCanReader",
    ".db": "bus.logs.pythoncan:PythonCanReader",
    ".log": "bus.logs.candump:CandumpReader",
    ".mf4": "bus.logs.mdf:MdfReader",
    ".trc": "bus.logs.pythoncan:PythonCanReader",
}
WRITERS = {
    ".blf": "bus.logs.blf_writer:BlfWriter",
    ".log": "bus.logs.candump_writer:CandumpWriter",
}
"""Module and class for each suffix, imported on use."""
_NEVER_PACKED = {".db", ".mf4"}
_PACKED_WRITERS = {".log"}


def read(path: str | os.PathLike[str], **options: Any) -> LogReader:
    """Frames of a log, batch by batch.

    Parameters
    ----------
    path : path
        The suffix tells the format.
    **options
        As of `LogReader`: buses, batch, strict.

    Returns
    -------
    LogReader
        To be iterated; each `FrameBatch` is overwritten by the next one.

    Raises
    ------
    LogError
        No such file, or no reader for its suffix.
    """
    place = _place(path, READERS, set(READERS) - _NEVER_PACKED)
    existing(path)  # before a reader is imported, which may have to be compiled
    return _class(place)(path, **options)


def read_all(path: str | os.PathLike[str], **options: Any) -> np.ndarray:
    """Return all frames of a log at once, shape (frames,), FRAME_DTYPE.

    Raises
    ------
    LogError
        As of `read`; with strict=False the frames up to a damage are returned instead.
    """
    parts = [batch.frames.copy() for batch in read(path, **options)]
    return np.concatenate(parts) if parts else np.zeros(0, FRAME_DTYPE)


def open_writer(path: str | os.PathLike[str], **options: Any) -> LogWriter:
    """Open a log that grows as frames come.

    Parameters
    ----------
    path : path
        The suffix tells the format.
    **options
        As of `CandumpWriter` or `BlfWriter`.

    Raises
    ------
    LogError
        No writer for the suffix.
    """
    writer = _class(_place(path, WRITERS, _PACKED_WRITERS))
    with named(Path(path)):
        return writer(path, **options)


def write(
    path: str | os.PathLike[str],
    frames: np.ndarray | FrameBatch | Iterable[FrameBatch | np.ndarray],
    **options: Any,
) -> int:
    """Write a whole log; a file of that name is replaced once the new one is complete.

    Parameters
    ----------
    path : path
        The suffix tells the format.
    frames : FrameBatch, ndarray of shape (m,) and FRAME_DTYPE, or many of them
        A `LogReader` is one such.
    **options
        As of `open_writer`.

    Returns
    -------
    int
        Frames written.
    """
    target = Path(path)
    beside = target.with_name(f".part.{target.name}")
    parts = [frames] if isinstance(frames, np.ndarray | FrameBatch) else frames
    try:
        with named(target):
            with open_writer(beside, **options) as writer:
                for part in parts:
                    writer.write(part)
            sync(beside)
            os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)
    return writer.count


def _place(path: str | os.PathLike[str], classes: dict[str, str], packed: set[str]) -> str:
    """Return module and class for a path's suffix."""
    check_path("log", path, LogError)
    suffixes = [suffix.lower() for suffix in Path(path).suffixes]
    valid = sorted([*classes, *(f"{suffix}.gz" for suffix in packed)])
    given = "".join(suffixes[-2:] if suffixes[-1:] == [".gz"] else suffixes[-1:])
    if given not in valid:
        near = difflib.get_close_matches(given, valid, 1)
        hint = f"; nearest: {near[0]!r}" if near else ""
        raise LogError(f"{path}: must end in one of {', '.join(valid)}; got {given!r}{hint}")
    return classes[given.removesuffix(".gz")]


def _class(place: str) -> type[Any]:
    module, name = place.split(":")
    return getattr(import_module(module), name)
