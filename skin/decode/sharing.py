"""Kernels in several threads: they let go of the interpreter while they run."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from bus.compiled.bound import Bound

__all__ = ["ENOUGH", "Shared", "processors", "together"]

ENOUGH = 1 << 18
"""Units times cycles from which on work is shared: about a millisecond of it, where to hand over to
a thread takes about a tenth of one."""


def processors() -> int:
    """Those that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def together(calls: Sequence[Callable[[], object]]) -> None:
    """Make calls at the same time, the first in this thread; all have ended on return.

    Raises
    ------
    Exception
        What a call has raised, of the first one that has.
    """
    others = [_threads().submit(call) for call in calls[1:]]
    try:
        calls[0]()
    finally:
        wait(others)
    for other in others:
        other.result()


class Shared:
    """Bound kernels, each on its share of the same arrays, as one."""

    def __init__(self, calls: Sequence[Bound]) -> None:
        self._calls = calls

    def put(self, where: int | tuple[int | str, ...], array: np.ndarray) -> None:
        """Exchange an array of all of them, see `bus.compiled.bound.Bound`."""
        for call in self._calls:
            call.put(where, array)

    def __call__(self) -> None:
        """Call all of them, and wait."""
        together(self._calls)


@functools.cache
def _threads() -> ThreadPoolExecutor:
    """The threads of this process, which are started as they are needed."""
    return ThreadPoolExecutor(processors(), thread_name_prefix="decode")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_threads.cache_clear)
