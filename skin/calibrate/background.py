"""Stray fields of neighbours learned while a skin is in use, in a thread beside it.

Every second of cycles in which something was pressed is handed to the thread, which takes the zeros
from the first of them in which nothing was, and from the others what untouched chips read of the
films around (`skin.calibrate.touch`). What the decoder follows, the ambient field and zeros that
drift, is taken off first. Where the thread is slower than the skin, seconds are left out.
"""

from __future__ import annotations

import os
import threading
from pathlib import Path
from queue import Full, Queue
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bus.status import INVALID, Status
from skin.calibrate.learn import StrayEstimate
from skin.calibrate.tare import tare
from skin.calibrate.touch import TouchTest, warmup
from skin.calibrate.untouched import LEAST_CYCLES
from skin.errors import OptionError, ScanError, SkinError
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from skin.decode.decoder import Decoder

__all__ = ["Learning"]

WINDOW_S = 1.0
SPARE = 1.2
"""Cycles of a window over those that a tare needs: some are lost [assumed]."""
WAITING = 4
"""Seconds of cycles that wait for the thread, at most."""
BACKGROUND_ROWS = 4
"""Of what the decoder takes off: Hz, and the field."""


class Window(NamedTuple):
    """Cycles of a second: how often the ambient field had begun anew, counts (t, c, n), flags
    (t, n), and what was followed then (t, 4, n)."""

    begun: int
    counts: np.ndarray
    status: np.ndarray
    background: np.ndarray


class Learning:
    """Learns the stray fields of a skin from its cycles.

    Parameters
    ----------
    decoder : Decoder
        Of the cycles; tells its zeros and what it follows.

    Attributes
    ----------
    left_out : int
        Seconds of cycles that the thread had no time for.

    Raises
    ------
    SkinError
        More units than can be learned, or no ambient field is followed.
    """

    def __init__(self, decoder: Decoder) -> None:
        topology = decoder.topology
        StrayEstimate.check_size(topology)
        if decoder.ambient is None:
            raise SkinError(
                "learn: must be with ambient=True, and with what is tangential in want; got a skin "
                "that does not follow the ambient field"
            )
        self._ambient, self._topology, n = decoder.ambient, topology, topology.n
        self._begun = self._ambient.begun
        cycles = max(round(WINDOW_S * topology.cycle_rate_hz), round(SPARE * LEAST_CYCLES))
        self._counts = np.empty((cycles, len(CHANNELS), n), np.int16)
        self._status = np.empty((cycles, n), np.uint16)
        self._background = np.empty((cycles, BACKGROUND_ROWS, n), np.float32)
        self._filled, self.left_out = 0, 0
        self._queue: Queue[Window | None] = Queue(WAITING)
        self._lock, self._learner = threading.Lock(), _Learner(topology)
        self._failed: Exception | None = None
        self._thread = threading.Thread(target=self._work, name="f3t-skin learning", daemon=True)
        self._thread.start()

    def look(self, counts: np.ndarray, status: np.ndarray) -> None:
        """Take a cycle, as the assembler has it: counts, shape (c, n), and flags, shape (n,)."""
        if self._ambient.begun != self._begun:  # what is followed has another origin
            self._begun, self._filled = self._ambient.begun, 0
        t = self._filled
        self._counts[t], self._status[t] = counts, status
        self._background[t] = self._ambient.background
        self._filled += 1
        if self._filled == len(self._counts):
            self._hand_over()

    def _hand_over(self) -> None:
        seen = (self._counts, self._status, self._background)
        try:
            self._queue.put_nowait(Window(self._begun, *(array.copy() for array in seen)))
        except Full:
            self.left_out += 1
        self._filled = 0

    def _work(self) -> None:
        """The thread: one window after the other; after a failure they are only taken away, so that
        nobody waits for them."""
        while (window := self._queue.get()) is not None:
            try:
                if self._failed is None:
                    with self._lock:
                        self._learner.take(window)
            except Exception as error:  # told by whoever asks for what was learned
                self._failed = error
            finally:
                self._queue.task_done()

    def report(self) -> dict[str, Any]:
        """What was learned so far: ``pressed``, by name, readings of each unit while it was pressed
        beside an untouched one; ``sigma_ut``, mean one sigma of a lateral axis by what is not
        known; ``left_out``."""
        with self._lock:
            test = self._learner.test
            pressed = {} if test is None else {
                name: int(count)
                for name, count in zip(self._topology.unit_names, test.pressed, strict=True)
                if count
            }  # fmt: skip
            sigma_ut = None if test is None else float(test.estimate.sigma_ut().mean())
        return {"pressed": pressed, "sigma_ut": sigma_ut, "left_out": self.left_out}

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the stencil as it is known now, for `skin.open(stencil=FILE)`, once all that waits
        was learned from; there whole or not at all.

        Raises
        ------
        SkinError
            Nothing was pressed beside an untouched unit since the skin was untouched for a second.
        """
        if self._thread.is_alive():
            self._queue.join()
        if self._failed is not None:
            raise SkinError(f"learn: must learn from every second; got {self._failed}")
        with self._lock:
            test = self._learner.test
            if test is None or not test.pressed.any():
                why = f" ({self._learner.why})" if self._learner.why else ""
                touch = "press beside an untouched unit"
                needed = touch if test else f"second without a touch{why}"
                raise SkinError(f"{file}: must be learned from a skin in use; got no {needed}")
            test.estimate.stencil().save(Path(file))

    def warmup(self) -> None:
        """Compile what the thread needs, or load it."""
        warmup(self._topology)

    def close(self) -> None:
        """Learn from what waits, and end; closing twice is fine."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()


class _Learner:
    """What the thread has: nothing, until nothing has touched the skin for a second.

    Zeros are taken anew, on the skin as files have it: it has the chips' own offsets, without which
    the field of neighbours at rest could not be told. Units that were silent then are left out from
    then on. `why` is the last reason against a second.
    """

    def __init__(self, topology: Topology) -> None:
        self.test: TouchTest | None = None
        self.why = ""
        self._topology, self._begun = topology, -1

    def take(self, window: Window) -> None:
        """Learn from a window; where what is followed has another origin than before it begins
        anew."""
        if window.begun != self._begun:
            self.test, self._begun = None, window.begun
        if self.test is not None:
            status = window.status | np.where(self._silent, int(Status.FAULT), 0).astype(np.uint16)
            self.test(window.counts, status, window.background - self._followed)
            return
        good = np.count_nonzero(window.status & int(INVALID) == 0, axis=0)
        self._silent = good < LEAST_CYCLES
        names = [self._topology.unit_names[i] for i in np.flatnonzero(self._silent)]
        try:
            found = tare(self._topology, window.counts, window.status, leave_out=names)
        except (OptionError, ScanError) as error:  # something presses, or moves; nothing answers
            self.why = str(error).partition("\n")[0]
            return
        estimate = StrayEstimate(self._topology)
        tared = estimate.tared(found)
        self._followed = window.background.mean(axis=0)
        self.test = TouchTest(
            found.leaving_out(tared.rest_ut).applied(), estimate, tared, window.counts
        )
