"""Stray fields of neighbours learned while a skin is in use, in a process of its own.

The cycles of a second are written into shared memory as they come, and handed over: to a process of
its own (`skin.calibrate.learner`), since a thread would share the interpreter's lock with the
cycles. Where that process is slower than the skin, cycles are left out.
"""

from __future__ import annotations

import base64
import os
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.calibrate.learn import StrayEstimate
from skin.calibrate.learner import window_dtype
from skin.errors import SkinError
from skin.physics.stencil import STENCIL_FILE
from skin.sinks import WorkerSink
from skin.worker import RingBuffer, Worker
from topology.files import whole_file
from topology.packed import packed

if TYPE_CHECKING:
    from skin.pipeline import Pipeline
    from skin.state import State

__all__ = ["Learning"]

LEARNER = "skin.calibrate.learner"
WAITING = 4
"""Seconds of cycles that wait for the process, at most, in addition to the one that is being
filled."""
ANSWER_S = 600.0
"""That an answer may take [assumed: what waits of the largest skin, on a slow machine]."""
STENCIL, REPORT = "stencil", "report"
"""What the process is asked for; it learns from all that waits before it answers the first."""


class Learning(WorkerSink):
    """Learns the stray fields of a skin from its cycles; a sink, that of ``skin.open(learn=True)``.

    Parameters
    ----------
    pipeline : Pipeline
        Of the cycles; its decoder has the zeros and what is followed.

    Raises
    ------
    SkinError
        More units than can be learned, or no ambient field is followed.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        super().__init__("learn", pipeline)
        decoder, topology = pipeline.decoder, pipeline.decoder.topology
        StrayEstimate.check_size(topology)
        if decoder.ambient is None:
            raise SkinError(
                "learn: must be with ambient=True, and with what is tangential in want; got a skin "
                "that does not follow the ambient field"
            )
        self._ambient, self._begun = decoder.ambient, decoder.ambient.begun
        self._ring = RingBuffer(window_dtype(topology), WAITING + 1)
        self._counts = self._status = self._background = np.empty(0)
        self._cycles = self._ring.dtype["status"].shape[0]
        self._filled = self._skipped = self._handed = 0
        self._lock, self._last = RLock(), dict[str, dict[str, Any]]()
        self._open: Worker | None = Worker(LEARNER, self._ring, {"topology": packed(topology)})
        self._worker = self._open

    @property
    def lost(self) -> int:
        """As `left_out`."""
        return self.left_out()

    def left_out(self) -> int:
        """Seconds of cycles that the process had no room for; one that has begun counts."""
        return -(-self._skipped // self._cycles)

    def described_loss(self) -> str:
        """The same in words."""
        return f"{self.left_out()} seconds of cycles"

    def state(self, _: State) -> None:
        """Take the counts and flags of a cycle; see `Sink.state`."""
        if self._ambient.begun != self._begun:  # what is followed has another origin
            self._begun, self._filled = self._ambient.begun, 0
        t = self._filled
        if t == 0 and not self._begin():
            self._skipped += 1
            return
        self._counts[t], self._status[t] = self.pipeline.counts, self.pipeline.status
        self._background[t] = self._ambient.background
        if t + 1 < self._cycles:
            self._filled = t + 1
            return
        self._filled = 0  # first: an interrupt loses a window here, and hands none over twice
        self._ring.publish()
        self._handed += 1

    def _begin(self) -> bool:
        """Claim room for a window, if there is some."""
        self.look()
        window = self._ring.claim()
        if window is None:
            return False
        window["begun"] = self._begun
        self._counts, self._status = window["counts"][0], window["status"][0]
        self._background = window["background"][0]
        return True

    def report(self) -> dict[str, Any]:
        """What was learned so far: ``pressed``, by name, readings of each unit while it was pressed
        next to an untouched one; ``sigma_ut``, mean one sigma of a lateral axis by what is not
        known; ``left_out``. Waits for the second that is being learned from: not for the thread of
        the cycles.

        Raises
        ------
        SkinError
            The process has ended.
        """
        return self._told(REPORT) | {"left_out": self.left_out()}

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the stencil as it is known now, for `skin.open(stencil=FILE)`, once all that waits
        was learned from; there whole or not at all.

        Raises
        ------
        SkinError
            Nothing was pressed next to an untouched unit since the skin was untouched for a second,
            or the process has failed or ended.
        """
        found = self._told(STENCIL)
        if "failed" in found:
            raise SkinError(f"learn: must learn from every second; got {found['failed']}")
        if "missing" in found:
            raise SkinError(f"{file}: must be learned from a skin in use; got no "
                            f"{found['missing']}")  # fmt: skip
        with whole_file(Path(file), over=STENCIL_FILE) as out:
            out.write(base64.b64decode(found["stencil"]))

    def stop(self) -> None:
        """Learn from what waits, and end; a second time is fine. What was learned can be reported
        and saved afterwards."""
        with self._lock:
            worker, self._open = self._open, None
            if worker is None:
                return
            if not self._handed:
                self._last = {STENCIL: {"missing": "second without a touch"},
                              REPORT: {"pressed": {}, "sigma_ut": None}}  # fmt: skip
                worker.close(0.0)
                return
            interrupted = {"error": "learn: must learn until it is closed; got an interrupt"}
            self._last = {STENCIL: interrupted, REPORT: interrupted}
            try:
                for command in (STENCIL, REPORT):
                    self._last[command] = _answer(worker, command)
            finally:
                worker.close()

    def close(self) -> None:
        """See no more, and stop."""
        self.pipeline.detach(self)
        self.stop()

    def _told(self, command: str) -> dict[str, Any]:
        with self._lock:
            worker = self._open
            found = self._last[command] if worker is None else _answer(worker, command)
        if "error" in found:
            raise SkinError(found["error"])
        return found


def _answer(worker: Worker, command: str) -> dict[str, Any]:
    """What the process says, or the ``error`` that it has ended."""
    try:
        return worker.ask(command, ANSWER_S)
    except SkinError as error:
        return {"error": str(error)}
