"""Readers of logs by suffix, and the writer."""

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
from bus.logs.reader import LogReader, existing
from bus.logs.writer import LogWriter
from topology.files import check_path, named, sync

__all__ = ["READERS", "open_writer", "read", "read_all", "write"]

READERS = {
    ".asc": "bus.logs.pythoncan:PythonCanReader",
    ".blf": "bus.logs.blf:BlfReader",
    ".csv": "bus.logs.pythoncan:PythonCanReader",
    ".db": "bus.logs.pythoncan:PythonCanReader",
    ".log": "bus.logs.candump:CandumpReader",
    ".trc": "bus.logs.pythoncan:PythonCanReader",
}
"""Module and class for each suffix, imported on first use."""
_NEVER_PACKED = {".db"}
_WRITTEN = (".log", ".log.gz")


def read(path: str | os.PathLike[str], **options: Any) -> LogReader:
    """Frames of a log, batch by batch.

    Parameters
    ----------
    path : path
        The suffix sets the format.
    **options
        See `LogReader`: buses, batch, strict.

    Returns
    -------
    LogReader
        Iterate over it; each `FrameBatch` is overwritten by the next one.

    Raises
    ------
    LogError
        No such file, or no reader for its suffix.
    """
    packed = (f"{suffix}.gz" for suffix in READERS if suffix not in _NEVER_PACKED)
    suffix = _suffix(path, [*READERS, *packed])
    existing(path)  # before a reader is imported, which may be compiled
    module, name = READERS[suffix.removesuffix(".gz")].split(":")
    reader: LogReader = getattr(import_module(module), name)(path, **options)
    return reader


def read_all(path: str | os.PathLike[str], **options: Any) -> np.ndarray:
    """Return all frames of a log at once, shape (frames,), FRAME_DTYPE.

    Raises
    ------
    LogError
        See `read`; with strict=False the frames up to the damage are returned instead.
    """
    parts = [batch.frames.copy() for batch in read(path, **options)]
    return np.concatenate(parts) if parts else np.zeros(0, FRAME_DTYPE)


def open_writer(path: str | os.PathLike[str], **options: Any) -> LogWriter:
    """Open a log that is written as frames come.

    Parameters
    ----------
    path : path
        Ends in .log or .log.gz.
    **options
        See `LogWriter`.

    Raises
    ------
    LogError
        Another suffix.
    """
    _suffix(path, _WRITTEN)
    with named(Path(path)):
        return LogWriter(path, **options)


def write(
    path: str | os.PathLike[str],
    frames: np.ndarray | FrameBatch | Iterable[FrameBatch | np.ndarray],
    **options: Any,
) -> int:
    """Write a whole log; a file of that name is replaced once the new one is complete.

    Parameters
    ----------
    path : path
        Ends in .log or .log.gz.
    frames : FrameBatch, ndarray of shape (m,) and FRAME_DTYPE, or many of them
        Such as a `LogReader`.
    **options
        See `open_writer`.

    Returns
    -------
    int
        Frames written.
    """
    target = Path(path)
    draft = target.with_name(f".part.{target.name}")
    parts = [frames] if isinstance(frames, np.ndarray | FrameBatch) else frames
    try:
        with named(target):
            with open_writer(draft, **options) as writer:
                for part in parts:
                    writer.write(part)
            sync(draft)
            os.replace(draft, target)
    finally:
        draft.unlink(missing_ok=True)
    return writer.count


def _suffix(path: str | os.PathLike[str], valid: Iterable[str]) -> str:
    """A path's suffix, in lower case, which must be a valid one."""
    check_path("log", path, LogError)
    suffixes, valid = [suffix.lower() for suffix in Path(path).suffixes], sorted(valid)
    given = "".join(suffixes[-2:] if suffixes[-1:] == [".gz"] else suffixes[-1:])
    if given not in valid:
        near = difflib.get_close_matches(given, valid, 1)
        hint = f"; nearest: {near[0]!r}" if near else ""
        raise LogError(f"{path}: must end in one of {', '.join(valid)}; got {given!r}{hint}")
    return given
