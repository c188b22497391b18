"""Trials on all processors; what they come to does not depend on how many there are."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

from bus.processors import processors

__all__ = ["in_parallel"]


def in_parallel(work: Callable[[Any], Any], tasks: Iterable[Any], chunk: int = 1) -> list[Any]:
    """What `work` returns for each task, in their order.

    The first is done in this process, so that its kernels are compiled before the others are forked
    from it.

    Parameters
    ----------
    work : callable
        Of a module, or `functools.partial` of one.
    tasks : iterable
    chunk : int
        Tasks that a process takes at a time.
    """
    first, *others = tasks
    done = [work(first)]
    workers = min(processors(), -(-len(others) // chunk))
    if workers < 2:
        return done + [work(task) for task in others]
    with ProcessPoolExecutor(workers, get_context("fork")) as pool:
        return done + list(pool.map(work, others, chunksize=chunk))
