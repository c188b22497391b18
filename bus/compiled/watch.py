"""Hear of every kernel that numba compiles in this process, by its own events."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event

__all__ = ["watch"]


class Listener(event.Listener):
    """Reports the outermost compilations: those within others are parts of them."""

    def __init__(self, begun: Callable[[str], None], done: Callable[[str], None]) -> None:
        self._begun, self._done, self._depth = begun, done, 0

    def on_start(self, event: Any) -> None:
        self._depth += 1
        if self._depth == 1:
            self._begun(event.data["dispatcher"].py_func.__qualname__)

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._done(event.data["dispatcher"].py_func.__qualname__)


@contextmanager
def watch(
    begun: Callable[[str], None], done: Callable[[str], None] = lambda kernel: None
) -> Iterator[None]:
    """Hear of every kernel that is not in the cache, before it is compiled.

    Parameters
    ----------
    begun, done : callable
        Take the name of the kernel.
    """
    with event.install_listener("numba:compile", Listener(begun, done)):
        yield
