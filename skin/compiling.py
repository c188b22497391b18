"""What is said while kernels are compiled, which takes long the first time on a machine.

On a terminal a bar on standard error says how many are compiled. Elsewhere, or where NO_COLOR is
set, the logger "skin" says it in two lines, as warnings: a program that sets up no logging shows
them on standard error; ``logging.getLogger("skin").setLevel("ERROR")`` keeps both away.
"""

from __future__ import annotations

import atexit
import functools
import logging
import os
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from threading import Lock, Timer
from typing import TextIO

__all__ = ["Announcer", "announcer", "terminal"]

PATIENCE_S = 1.0
"""Compile time before the first message. [assumed]"""
CELLS = 24
"""Of the bar. [assumed]"""

_log = logging.getLogger("skin")


class Announcer:
    """One line when kernels have been compiled for a second, and one when all are done; a bar in
    their place on a terminal.

    Parameters
    ----------
    terminal : file, optional
        Where a bar is drawn; without one there are lines.
    """

    def __init__(self, terminal: TextIO | None = None) -> None:
        self._terminal, self._lock = terminal, Lock()
        self._known: set[str] = set()
        self._done: set[str] = set()
        self._running, self._seconds, self._began = 0, 0.0, 0.0
        self._said = False
        self._timer = Timer(0.0, self._say)
        self._others = ExitStack()

    def plans(self, kernel: str, _size: int) -> None:
        """A kernel will be compiled."""
        with self._lock:
            self._known.add(kernel)

    def begins(self, kernel: str) -> None:
        """A kernel is about to be compiled, perhaps within another one, or at the same time."""
        with self._lock:
            self._known.add(kernel)
            self._running += 1
            if self._running == 1:
                self._began = time.monotonic()
                self._timer = Timer(max(0.0, PATIENCE_S - self._seconds), self._say)
                self._timer.daemon = True
                self._timer.start()

    def ends(self, kernel: str) -> None:
        """A kernel is compiled."""
        with self._lock:
            self._done.add(kernel)
            self._running -= 1
            if not self._running:
                self._seconds += time.monotonic() - self._began
                self._timer.cancel()
            self._draw()

    @contextmanager
    def holding(self) -> Iterator[None]:
        """`hold`, and `finish` in the end."""
        self.hold()
        try:
            yield
        finally:
            self.finish()

    def hold(self) -> None:
        """Let as many processes as there are cores compile, until `finish` is called."""
        from bus.compiled.pool import together

        self._others.close()
        self._others.enter_context(together())

    def finish(self) -> None:
        """All that is needed for now is compiled."""
        self._others.close()
        with self._lock:
            if self._running:
                return
            if self._said:
                level = logging.WARNING if self._terminal is None else logging.INFO
                _log.log(level, "f3t-skin: compiled in %.1f s", self._seconds)
            self._known, self._done, self._seconds, self._said = set(), set(), 0.0, False

    def _say(self) -> None:
        with self._lock:
            if not self._running:
                return
            if self._terminal is None and not self._said:
                _log.warning("f3t-skin: compiling kernels for this machine, once …")
            self._said = True
            self._draw()

    def _draw(self) -> None:
        """The bar, or none where nothing is compiled."""
        if not self._said or self._terminal is None or not _log.isEnabledFor(logging.WARNING):
            return
        line, done, known = "", len(self._done), len(self._known)
        if self._running:
            bar = f"{'#' * (CELLS * done // known):.<{CELLS}}"
            line = f"f3t-skin: compiling for this machine, once [{bar}] {done} of {known} kernels"
        self._terminal.write(f"\r\x1b[K{line}")
        self._terminal.flush()


def terminal() -> TextIO | None:
    """Standard error, if it shows a bar."""
    file: TextIO | None = sys.stderr
    return file if file is not None and file.isatty() and not os.environ.get("NO_COLOR") else None


@functools.cache
def announcer() -> Announcer:
    """The announcer of this process; the first call registers it with the compiler."""
    from bus.compiled import cache

    found, watching = Announcer(terminal()), ExitStack()
    watching.enter_context(cache.watch(found.begins, found.ends, found.plans))
    atexit.register(watching.close)
    atexit.register(found.finish)
    return found
