"""Recordings: what the buses of a skin carry, written as it comes, by whichever thread."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import numpy as np

from bus.frame import FrameBatch
from bus.logs.channels import is_numbered, names_of, numbers_of
from bus.logs.writer import LogWriter
from bus.transport import Transport, TransportCounters
from topology import Topology
from topology.files import NO_KIND, check_over, named

__all__ = ["LoggedTransport", "Recording"]


class Recording:
    """A log of the buses of a topology, named as `bus.logs.buses_of` finds them again.

    What stands in it when a process ends is kept: it is a log up to there.

    Parameters
    ----------
    path : path
        Ends in .log, .log.gz or .blf; a new file: no recording is written over.
    topology : Topology

    Raises
    ------
    LogError
        No writer for the suffix, or the file cannot be written.
    FileExistsError
        There is such a file already.
    """

    def __init__(self, path: str | os.PathLike[str], topology: Topology) -> None:
        from bus.logs import open_writer

        numbered = is_numbered(path)
        check_over(Path(path), NO_KIND)
        self._buses = np.array(numbers_of(topology) if numbered else range(len(topology.buses)))
        named = {} if numbered else {"channels": names_of(topology)}
        self._writer: LogWriter = open_writer(path, **named)
        self._lock = threading.Lock()
        self._is_closed = False

    def write(self, frames: np.ndarray) -> None:
        """Append frames, shape (m,), FRAME_DTYPE; those without a stamp get the time it is."""
        records = np.array(frames)
        records["bus"] = self._buses[records["bus"]]
        records["stamp_ns"][records["stamp_ns"] == 0] = time.time_ns()
        with self._lock:
            if not self._is_closed:
                self._writer.write(records)

    def close(self) -> None:
        """Write what is left and close the file; frames that come later are left out."""
        with self._lock:
            self._is_closed = True
            with named(self._writer.path):
                self._writer.close()


class LoggedTransport(Transport):
    """A transport that records the frames of another as it hands them on.

    Parameters
    ----------
    inner : Transport
        Where frames come from and go to; closed with this one.
    recording : Recording
    """

    def __init__(self, inner: Transport, recording: Recording) -> None:
        super().__init__(inner.index)
        self.inner, self._recording = inner, recording
        self.changes, self.clock = inner.changes, inner.clock
        self.keeps_stamps = inner.keeps_stamps

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
        """Send frames, in order; those that were taken are recorded."""
        taken = self.inner.send(records)
        sent = np.array(records[:taken])
        sent["bus"] = self.index
        self._recording.write(sent)
        return taken

    def close(self) -> None:
        """Close the inner transport."""
        self.inner.close()
