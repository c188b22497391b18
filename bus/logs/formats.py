"""Readers and writers of logs, by suffix."""

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

__all__ = ["READERS", "WRITERS", "open_writer", "read", "read_all", "write"]

READERS = {
    ".asc": "bus.logs.rows:RowReader",
    ".blf": "bus.logs.blf:BlfReader",
    ".csv": "bus.logs.rows:RowReader",
    ".db": "bus.logs.rows:RowReader",
    ".log": "bus.logs.candump:CandumpReader",
    ".mf4": "bus.logs.mdf:MdfReader",
    ".trc": "bus.logs.rows:RowReader",
}
WRITERS = {
    ".blf": "bus.logs.blf_writer:BlfWriter",
    ".log": "bus.logs.candump_writer:CandumpWriter",
}
"""Module and class for each suffix, imported on first use."""
_NEVER_PACKED = {".db", ".mf4"}
_PACKED_WRITERS = {".log"}


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
    place = _place(path, READERS, set(READERS) - _NEVER_PACKED)
    existing(path)  # before a reader is imported, which may be compiled
    return _class(place)(path, **options)


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
        The suffix sets the format.
    **options
        See `CandumpWriter`.

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
        The suffix sets the format.
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


def _place(path: str | os.PathLike[str], classes: dict[str, str], packed: set[str]) -> str:
    """Module and class for a path's suffix."""
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
