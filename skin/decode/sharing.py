"""Kernels in several threads: they let go of the interpreter while they run."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TYPE_CHECKING

import numpy as np

from bus.compiled.aligned import zeros
from bus.processors import processors
from skin.decode import records

if TYPE_CHECKING:
    from bus.compiled.bound import Bound

__all__ = ["ENOUGH", "MOST_WORKERS", "Shared", "Shares", "together"]

ENOUGH = 1 << 18
"""Units times cycles from which on work is shared: about a millisecond of it, where to hand over to
a thread takes about a tenth of one."""
MOST_WORKERS = 1024
"""Threads that anybody can mean."""


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


class Shares:
    """Scratch of the decode kernel: the first for all blocks of units; if they can be shared, one
    for each share besides.

    Parameters
    ----------
    n : int
        Units.
    real : dtype
        Of the arithmetic.
    workers : int
        Shares at most.

    Attributes
    ----------
    control : ndarray, records of `skin.decode.records.CONTROL`
    scratch : list of dict
        Arrays by their names in `skin.decode.kernel.DecodeData`.
    """

    def __init__(self, n: int, real: np.dtype, workers: int) -> None:
        self._n = n
        blocks = -(-n // records.LANES)
        shares = min(workers, blocks)
        bounds = np.arange(shares + 1) * blocks // shares
        self.control = zeros(1 + shares if shares > 1 else 1, records.CONTROL)
        self.control["last"][0] = blocks
        if shares > 1:
            self.control["first"][1:], self.control["last"][1:] = bounds[:-1], bounds[1:]
        self.scratch = [
            {
                "flag": zeros(records.LANES, np.int16),
                "loaded": zeros(records.LANES, np.int16),
                "tile": zeros(1, records.tile(real)),
                "control": self.control[i : i + 1],
            }
            for i in range(self.control.size)
        ]

    def of(self, cycles: int) -> slice:
        """Those that decode so many cycles: the first, or all others together."""
        shared = len(self.scratch) > 1 and cycles * self._n >= ENOUGH
        return slice(1, None) if shared else slice(1)


@functools.cache
def _threads() -> ThreadPoolExecutor:
    """The threads of this process, which are started as they are needed."""
    return ThreadPoolExecutor(processors(), thread_name_prefix="decode")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_threads.cache_clear)
