"""Recordings: frames of the buses of a skin, written as they come, from any thread."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import numpy as np

from bus.errors import LogError
from bus.frame import FrameBatch
from bus.logs.channels import names_of
from bus.logs.writer import LogWriter
from bus.transport import Transport, TransportCounters
from topology import Topology
from topology.files import NO_KIND, check_over, check_path, named

__all__ = ["LoggedTransport", "Recording"]


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


class LoggedTransport(Transport):
    """A transport that records the frames of another one.

    Parameters
    ----------
    inner : Transport
        Source and destination of frames; closed with this one.
    recording : Recording
    """

    def __init__(self, inner: Transport, recording: Recording) -> None:
        super().__init__(inner.index)
        self.inner, self._recording = inner, recording
        self.changes, self.clock = inner.changes, inner.clock
        self.stamped_by, self.keeps_stamps = inner.stamped_by, inner.keeps_stamps

    @property
    def counters(self) -> TransportCounters:
        """Those of the inner transport."""
        return self.inner.counters

    def fileno(self) -> int:
        """That of the inner transport."""
        return self.inner.fileno()

    def receive(self, batch: FrameBatch, timeout_s: float = 0.0) -> int:
        """Append waiting frames to `batch`; see `Transport.receive`."""
        taken = self.inner.receive(batch, timeout_s)
        self.state = self.inner.state
        if taken:
            self._recording.write(batch.frames[batch.count - taken :])
        return taken

    def send(self, records: np.ndarray) -> int:
        """Send frames, in order; accepted ones are recorded."""
        taken = self.inner.send(records)
        sent = np.array(records[:taken])
        sent["bus"] = self.index
        self._recording.write(sent)
        return taken

    def close(self) -> None:
        """Close the inner transport."""
        self.inner.close()
