"""Readers of logs by suffix."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

from bus.errors import LogError
from bus.logs.reader import LogReader, existing
from topology.files import check_path

__all__ = ["READERS", "read", "suffix_of"]

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
    suffix = suffix_of(path, [*READERS, *packed])
    existing(path)  # before a reader is imported, which may be compiled
    module, name = READERS[suffix.removesuffix(".gz")].split(":")
    reader: LogReader = getattr(import_module(module), name)(path, **options)
    return reader


def suffix_of(path: str | os.PathLike[str], valid: Iterable[str]) -> str:
    """A path's suffix, in lower case.

    Raises
    ------
    LogError
        It is not a valid one; the message names them, and the nearest.
    """
    check_path("log", path, LogError)
    suffixes, valid = [suffix.lower() for suffix in Path(path).suffixes], sorted(valid)
    given = "".join(suffixes[-2:] if suffixes[-1:] == [".gz"] else suffixes[-1:])
    if given not in valid:
        near = difflib.get_close_matches(given, valid, 1)
        hint = f"; nearest: {near[0]!r}" if near else ""
        raise LogError(f"{path}: must end in one of {', '.join(valid)}; got {given!r}{hint}")
    return given
