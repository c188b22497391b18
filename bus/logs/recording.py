"""Recordings: frames of the buses of a skin, written as they come, from any thread."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import numpy as np

from bus.errors import LogError
from bus.logs.channels import names_of
from bus.logs.writer import LogWriter
from topology import Topology
from topology.files import NO_KIND, check_over, check_path, named

__all__ = ["Recording"]


class Recording:
    """A log of the buses of a topology, with channels that `bus.logs.buses_of` maps back.

    A crash of the process leaves a valid log up to there.

    Parameters
    ----------
    path : path
        Ends in .log or .log.gz; must be a new file.
    topology : Topology

    Raises
    ------
    LogError
        No writer for the suffix, or the file cannot be written.
    FileExistsError
        The file exists.
    """

    def __init__(self, path: str | os.PathLike[str], topology: Topology) -> None:
        check_path("log", path, LogError)
        check_over(Path(path), NO_KIND)
        self._writer = LogWriter(path, channels=names_of(topology))
        self._lock = threading.Lock()
        self._is_closed = False

    def write(self, frames: np.ndarray) -> None:
        """Append frames, shape (m,), FRAME_DTYPE; those without a stamp get the current time."""
        records = np.array(frames)
        records["stamp_ns"][records["stamp_ns"] == 0] = time.time_ns()
        with self._lock:
            if not self._is_closed:
                self._writer.write(records)

    def close(self) -> None:
        """Write the rest and close the file; later frames are dropped."""
        with self._lock:
            self._is_closed = True
            with named(self._writer.path):
                self._writer.close()
