"""Say that kernels are being compiled, where that takes long: the first time on a machine.

The logger "skin" says it, as warnings: a program that sets up no logging shows them on standard
error; ``logging.getLogger("skin").setLevel("ERROR")`` keeps them away.
"""

from __future__ import annotations

import atexit
import functools
import logging
import time
from collections.abc import Callable
from contextlib import ExitStack
from threading import Lock, Timer

__all__ = ["Announcer", "announcer"]

PATIENCE_S = 1.0
"""Seconds of compiling without a word. [assumed]"""

PAUSE_S = 3.0
"""Seconds without compiling until it counts as over, where nobody says so before. [assumed]"""

_log = logging.getLogger("skin")
_watching = ExitStack()
"""As long as the process lives."""
atexit.register(_watching.close)


class Announcer:
    """One line when kernels have been compiled for a second, and one when all are done.

    Attributes
    ----------
    kernels : list of str
        Names of the kernels compiled so far, of the round that is not over.
    """

    def __init__(self) -> None:
        self.kernels: list[str] = []
        self._lock = Lock()
        self._depth = 0
        self._seconds = self._began = 0.0
        self._said = self._held = False
        self._timer: Timer | None = None

    def begins(self, kernel: str) -> None:
        """A kernel is about to be compiled, perhaps within another one."""
        with self._lock:
            self.kernels.append(kernel)
            self._depth += 1
            if self._depth == 1:
                self._began = time.monotonic()
                self._wait(PATIENCE_S - self._seconds, self._say)

    def ends(self, _kernel: str) -> None:
        """A kernel is compiled."""
        with self._lock:
            self._depth = max(0, self._depth - 1)
            if self._depth == 0:
                self._seconds += time.monotonic() - self._began
                self._stop()
                if not self._held:
                    self._wait(PAUSE_S, self.finish)

    def hold(self) -> Announcer:
        """More may have to be compiled until `finish` is called, however long the pause."""
        self._held = True
        return self

    def finish(self) -> None:
        """All that is needed for now is compiled."""
        with self._lock:
            self._held = False
            if self._depth:
                return
            self._stop()
            if self._said:
                _log.warning("f3t-skin: compiled in %.1f s", self._seconds)
            self.kernels, self._seconds, self._said = [], 0.0, False

    def _say(self) -> None:
        with self._lock:
            if self._depth and not self._said:
                self._said = True
                _log.warning("f3t-skin: compiling kernels for this machine, once …")

    def _wait(self, seconds: float, then: Callable[[], None]) -> None:
        self._stop()
        self._timer = Timer(max(0.0, seconds), then)
        self._timer.daemon = True
        self._timer.start()

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()


@functools.cache
def announcer() -> Announcer:
    """The one of this process, which from now on hears of every kernel."""
    from bus.compiled import cache

    found = Announcer()
    _watching.enter_context(cache.watch(found.begins, found.ends))
    return found
