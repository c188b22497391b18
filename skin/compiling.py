"""Log messages while kernels are compiled, which takes long the first time on a machine.

On a terminal a bar on standard error says what is compiled and how far it is. Elsewhere, or where
NO_COLOR is set, the logger "skin" says it in two lines, as warnings: a program that sets up no
logging shows them on standard error; ``logging.getLogger("skin").setLevel("ERROR")`` keeps both
away.
"""

from __future__ import annotations

import atexit
import functools
import logging
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from threading import Lock, Timer
from typing import TextIO

__all__ = ["Announcer", "Progress", "announcer", "short", "terminal"]

PATIENCE_S = 1.0
"""Compile time before the first message. [assumed]"""

PAUSE_S = 3.0
"""Pause after which compiling counts as finished, without `finish`. [assumed]"""

DRAW_S = 0.2
"""Between two pictures of the bar. [assumed]"""
NEARLY = 0.95
"""Share of a kernel that is never said to be compiled before it is. [assumed]"""
CELLS = 24
"""Of the bar. [assumed]"""

_log = logging.getLogger("skin")
_watching = ExitStack()
"""For the lifetime of the process."""
atexit.register(_watching.close)


class Progress:
    """How far a round of kernels is. The time of one goes about with the size of its byte code.

    Attributes
    ----------
    sizes : dict of str to int
        Of all kernels that are known to be needed.
    seconds : dict of str to float
        That those took which are compiled.
    """

    def __init__(self) -> None:
        self.sizes: dict[str, int] = {}
        self.seconds: dict[str, float] = {}
        self._begun: dict[str, float] = {}
        self._shown = 0.0

    def planned(self, kernel: str, size: int) -> None:
        """A kernel will be compiled."""
        self.sizes[kernel] = size

    def begins(self, kernel: str, now_s: float) -> None:
        """A kernel is being compiled."""
        self._begun[kernel] = now_s

    def ends(self, kernel: str, now_s: float) -> None:
        """A kernel is compiled."""
        self.seconds[kernel] = now_s - self._begun.pop(kernel, now_s)

    @property
    def running(self) -> list[str]:
        """Kernels that are being compiled, the longest first."""
        return [*self._begun]

    def share(self, now_s: float) -> float:
        """Share of the work that is done, 0 to 1; never less than before, though more kernels may
        become known."""
        known = sum(self.sizes.values())
        done = sum(self.sizes.get(kernel, 0) for kernel in self.seconds)
        spent = sum(self.seconds.values())
        rate = done / spent if spent > 0.0 else 0.0
        for kernel, began_s in self._begun.items():
            done += min(NEARLY * self.sizes.get(kernel, 0), rate * (now_s - began_s))
        self._shown = max(self._shown, min(1.0, done / known) if known else 0.0)
        return self._shown

    def line(self, now_s: float, elapsed_s: float, width: int) -> str:
        """The bar and what is compiled, in at most `width` columns."""
        share = self.share(now_s)
        full = round(CELLS * share)
        names = ", ".join(map(short, self.running))
        text = (
            f"f3t-skin: compiling for this machine, once [{'#' * full}{'.' * (CELLS - full)}] "
            f"{share:4.0%} {elapsed_s:3.0f} s, {len(self.seconds)} of {len(self.sizes)} kernels"
        )
        return f"{text}: {names}"[:width] if names else text[:width]


def short(kernel: str) -> str:
    """The name of a kernel, for people."""
    first, _, last = kernel.partition(".")
    name = last.rpartition(".")[2] if "<locals>" in kernel else first
    return name.removeprefix("_").removesuffix("_python")


class Announcer:
    """One line when kernels have been compiled for a second, and one when all are done; a bar in
    their place on a terminal.

    Parameters
    ----------
    terminal : file, optional
        Where a bar is drawn; without one there are lines.

    Attributes
    ----------
    kernels : list of str
        Names of the kernels compiled in the current round.
    """

    def __init__(self, terminal: TextIO | None = None) -> None:
        self.kernels: list[str] = []
        self._terminal = terminal
        self._lock = Lock()
        self._progress = Progress()
        self._depth = 0
        self._seconds = self._began = 0.0
        self._said = self._held = False
        self._timer: Timer | None = None
        self._others = ExitStack()

    def plans(self, kernel: str, size: int) -> None:
        """A kernel will be compiled, of so much byte code."""
        with self._lock:
            self._progress.planned(kernel, size)

    def begins(self, kernel: str) -> None:
        """A kernel is about to be compiled, perhaps within another one, or at the same time."""
        with self._lock:
            self.kernels.append(kernel)
            self._progress.begins(kernel, time.monotonic())
            self._depth += 1
            if self._depth == 1:
                self._began = time.monotonic()
                self._wait(max(DRAW_S * self._said, PATIENCE_S - self._seconds), self._say)

    def ends(self, kernel: str) -> None:
        """A kernel is compiled."""
        with self._lock:
            self._progress.ends(kernel, time.monotonic())
            self._depth = max(0, self._depth - 1)
            if self._depth == 0:
                self._seconds += time.monotonic() - self._began
                self._stop()
                if not self._held:
                    self._wait(PAUSE_S, self.finish)

    def hold(self) -> Announcer:
        """More may have to be compiled until `finish` is called, however long the pause; kernels
        that are bound are compiled by as many processes as there are cores."""
        if not self._held:
            from bus.compiled.pool import together

            self._held = True
            self._others.enter_context(together())
        return self

    @contextmanager
    def holding(self) -> Iterator[None]:
        """`hold` and `finish`."""
        self.hold()
        try:
            yield
        finally:
            self.finish()

    def finish(self) -> None:
        """All that is needed for now is compiled."""
        self._others.close()
        with self._lock:
            self._held = False
            if self._depth:
                return
            self._stop()
            if self._said:
                if self._terminal is not None:
                    self._draw("")
                _log.log(
                    logging.INFO if self._terminal is not None else logging.WARNING,
                    "f3t-skin: compiled in %.1f s", self._seconds,
                )  # fmt: skip
            self.kernels, self._seconds, self._said = [], 0.0, False
            self._progress = Progress()

    def _say(self) -> None:
        with self._lock:
            if not self._depth:
                return
            if self._terminal is not None and _log.isEnabledFor(logging.WARNING):
                now = time.monotonic()
                width = shutil.get_terminal_size().columns - 1
                elapsed = self._seconds + now - self._began
                self._draw(self._progress.line(now, elapsed, width))
                self._wait(DRAW_S, self._say)
            elif not self._said:
                _log.warning("f3t-skin: compiling kernels for this machine, once …")
            self._said = True

    def _draw(self, line: str) -> None:
        assert self._terminal is not None
        self._terminal.write(f"\r\x1b[K{line}")
        self._terminal.flush()

    def _wait(self, seconds: float, then: Callable[[], None]) -> None:
        self._stop()
        self._timer = Timer(max(0.0, seconds), then)
        self._timer.daemon = True
        self._timer.start()

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()


def terminal() -> TextIO | None:
    """Standard error, if it shows a bar."""
    file: TextIO | None = sys.stderr
    return file if file is not None and file.isatty() and not os.environ.get("NO_COLOR") else None


@functools.cache
def announcer() -> Announcer:
    """The announcer of this process; the first call registers it with the compiler."""
    from bus.compiled import cache

    found = Announcer(terminal())
    _watching.enter_context(cache.watch(found.begins, found.ends, found.plans))
    return found
