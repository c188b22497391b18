"""Recorded CAN logs in and out, as batches of frames."""

from __future__ import annotations

import difflib
import os
from pathlib import Path
from typing import Any

import numpy as np

from bus.errors import LogError
from bus.frame import FRAME_DTYPE
from bus.logs.channels import buses_of
from bus.logs.reader import LogReader

__all__ = ["LogReader", "buses_of", "read", "read_all"]


def read(path: str | os.PathLike[str], **options: Any) -> LogReader:
    """Frames of a log, batch by batch.

    Parameters
    ----------
    path : path
        Format by suffix: .log (candump), .blf, .asc, .trc, .csv or .db, each also as .gz
        but .db.
    **options
        As of `LogReader`: buses, batch, strict.

    Returns
    -------
    LogReader
        To be iterated; each `FrameBatch` is overwritten by the next one.

    Raises
    ------
    LogError
        No such file, or no format of that suffix.
    """
    suffixes = [suffix.lower() for suffix in Path(path).suffixes[-2:]]
    if suffixes[-1:] == [".gz"]:
        suffixes.pop()
    suffix = suffixes[-1] if suffixes else ""
    known = (".asc", ".blf", ".csv", ".db", ".log", ".trc")
    if suffix == ".log":
        from bus.logs.candump import CandumpReader

        return CandumpReader(path, **options)
    if suffix == ".blf":
        from bus.logs.blf import BlfReader

        return BlfReader(path, **options)
    if suffix in known:
        from bus.logs.pythoncan import PythonCanReader

        return PythonCanReader(path, **options)
    near = difflib.get_close_matches(suffix, known, 1)
    hint = f"; nearest: {near[0]!r}" if near else ""
    raise LogError(f"{path}: must end in one of {', '.join(known)}; got {suffix!r}{hint}")


def read_all(path: str | os.PathLike[str], **options: Any) -> np.ndarray:
    """Return all frames of a log at once, shape (frames,), FRAME_DTYPE."""
    parts = [batch.frames.copy() for batch in read(path, **options)]
    return np.concatenate(parts) if parts else np.zeros(0, FRAME_DTYPE)
