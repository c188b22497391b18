"""The process that learns the stray fields of neighbours, of `skin.calibrate.background`.

It takes the zeros from the first second in which nothing was pressed, and from the others what
untouched chips read of the films around (`skin.calibrate.touch`). What the loop's decoder follows,
the ambient field and zeros that drift, is taken off first.

``python -m skin.calibrate.learner``, started by `skin.worker.Worker`, answers two commands:
``report``, after the second that it is at, and ``stencil``, after all that waits.
"""

from __future__ import annotations

import base64
import io
from typing import Any, NamedTuple

import numpy as np

from bus.status import INVALID, Status
from skin.calibrate.learn import StrayEstimate
from skin.calibrate.tare import tare
from skin.calibrate.touch import TouchTest, warmup
from skin.calibrate.untouched import LEAST_CYCLES
from skin.errors import OptionError, ScanError
from skin.worker import Service, WorkerEnd, run
from topology import CHANNELS, Topology
from topology.packed import unpacked

__all__ = ["Learner", "LearnerService", "Window", "window_dtype"]

WINDOW_S = 1.0
SPARE = 1.2
"""Cycles of a window over those that a tare needs: some are lost [assumed]."""
BACKGROUND_ROWS = 4
"""Of what the decoder takes off: Hz, and the field."""
LOOKS_S = 0.05
"""Between two looks at the ring where nobody asks for anything [assumed]."""


class Window(NamedTuple):
    """Cycles of a second: how often the ambient field had begun again, counts (t, c, n), flags
    (t, n), and what was followed then (t, 4, n)."""

    begun: int
    counts: np.ndarray
    status: np.ndarray
    background: np.ndarray


def window_dtype(topology: Topology) -> np.dtype[Any]:
    """A `Window` as a record, of a second or as many cycles as a tare needs."""
    n = topology.n
    cycles = max(round(WINDOW_S * topology.cycle_rate_hz), round(SPARE * LEAST_CYCLES))
    return np.dtype([
        ("begun", np.int64),
        ("counts", np.int16, (cycles, len(CHANNELS), n)),
        ("status", np.uint16, (cycles, n)),
        ("background", np.float32, (cycles, BACKGROUND_ROWS, n)),
    ])  # fmt: skip


class Learner:
    """Learns window by window: nothing, until nothing has touched the skin for a second.

    Zeros are taken again, on the skin as files have it: it has the chips' own offsets, without
    which the field of neighbours at rest could not be determined. Units that were silent then are
    left out from then on.

    Attributes
    ----------
    test : TouchTest or None
        None until there are zeros.
    why : str
        The last reason against a second.
    failed : str
        What has ended the learning; windows are only taken away then, so that nobody waits.
    """

    def __init__(self, topology: Topology) -> None:
        self.test: TouchTest | None = None
        self.why = self.failed = ""
        self._topology, self._begun = topology, -1

    def take(self, window: Window) -> None:
        """Learn from a window; where what is followed has another origin than before it begins
        again."""
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

    def learn(self, window: Window) -> None:
        """As `take`; what fails is reported to whoever asks for what was learned."""
        if not self.failed:
            try:
                self.take(window)
            except Exception as error:
                self._fail(error)

    def warmup(self) -> None:
        """Compile what a window needs, or load it."""
        try:
            warmup(self._topology)
        except Exception as error:
            self._fail(error)

    def report(self) -> dict[str, Any]:
        """``pressed`` and ``sigma_ut``; see `skin.calibrate.background.Learning.report`."""
        if self.test is None:
            return {"pressed": {}, "sigma_ut": None}
        pairs = zip(self._topology.unit_names, self.test.pressed, strict=True)
        return {
            "pressed": {name: int(count) for name, count in pairs if count},
            "sigma_ut": float(self.test.estimate.sigma_ut().mean()),
        }

    def stencil(self) -> dict[str, str]:
        """``stencil``, the bytes of its file in base64; else what is ``missing``, or what has
        ``failed``."""
        if self.failed:
            return {"failed": self.failed}
        if self.test is None:
            why = f" ({self.why})" if self.why else ""
            return {"missing": f"second without a touch{why}"}
        if not self.test.pressed.any():
            return {"missing": "press next to an untouched unit"}
        try:
            file = io.BytesIO()
            self.test.estimate.stencil().write(file)
        except Exception as error:
            self._fail(error)
            return self.stencil()
        return {"stencil": base64.b64encode(file.getvalue()).decode()}

    def _fail(self, error: Exception) -> None:
        self.failed = str(error) or type(error).__name__


class LearnerService(Service):
    """Learns and answers until the loop has ended: it has asked for all that it wants by then."""

    at_once = frozenset({"report"})
    rest_s = LOOKS_S
    reads_to_end = False
    frees_first = True

    def __init__(self, request: dict[str, Any]) -> None:
        self.learner = learner = Learner(unpacked(request["topology"]))
        self.commands = {"report": learner.report, "stencil": learner.stencil}

    def take(self, records: np.ndarray) -> None:
        """Learn from a window."""
        window = records[0]
        self.learner.learn(Window(int(window["begun"]), *(window[k] for k in Window._fields[1:])))


def begin(end: WorkerEnd) -> LearnerService:
    """Be ready for the first window."""
    service = LearnerService(end.request)
    service.learner.warmup()
    return service


def main() -> None:
    """Run as a process of its own."""
    run(begin)


if __name__ == "__main__":
    main()
