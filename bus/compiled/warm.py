"""Kernels compiled side by side, by as many processes as there are cores.

Each process compiles one kernel after the other, the largest first, and keeps them in the cache;
the process that needs them loads them from there. One that cannot compile, or dies, costs time
alone: who needs the kernel compiles it then.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from numba import typeof

from bus.compiled import cache
from bus.processors import processors

__all__ = ["Job", "jobs_of", "side_by_side"]


class Job(NamedTuple):
    """A kernel, as another process finds it: its module and its name there, and the types of its
    arguments."""

    module: str
    name: str
    kinds: tuple[Any, ...]

    def compile(self) -> None:
        """Compile the kernel, or load it."""
        getattr(import_module(self.module), self.name).compile(self.kinds)

    @property
    def mark(self) -> Path | None:
        """A file that says that the kernel has been compiled; None where nothing is kept."""
        place = cache.folder()
        return None if place is None else place / f"{cache.digest(repr(self))}.compiled"


def jobs_of(calls: Iterable[tuple[Any, ...]]) -> list[Job]:
    """Jobs for calls that are not known to be in the cache.

    Parameters
    ----------
    calls : iterable of tuple
        A kernel of `bus.compiled.jit.compiled`, and its arguments.
    """
    found = []
    for kernel, *arguments in calls:
        if not hasattr(kernel, "py_func"):
            continue  # interpreted
        function = kernel.py_func
        name = function.__name__.removesuffix("_python")
        job = Job(function.__module__, name, tuple(map(typeof, arguments)))
        if job.mark is not None and not job.mark.exists():
            found.append(job)
    return found


def side_by_side(jobs: Iterable[Job], done: Callable[[Job], None]) -> None:
    """Compile in several processes; returns when all are done.

    Parameters
    ----------
    jobs : iterable of Job
        Those that take longest first.
    done : callable
        Called for each, from threads, when it is compiled.
    """
    waiting: queue.SimpleQueue[Job] = queue.SimpleQueue()
    for job in jobs:
        waiting.put(job)
    threads = [
        threading.Thread(target=_serve, args=(waiting, done), daemon=True)
        for _ in range(min(processors(), waiting.qsize()))
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def _serve(waiting: queue.SimpleQueue[Job], done: Callable[[Job], None]) -> None:
    """Give a process one job after the other."""
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    with suppress(OSError, queue.Empty, EOFError, pickle.PicklingError), subprocess.Popen(
        [sys.executable, "-P", "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": paths},
        start_new_session=True,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        while True:
            job = waiting.get_nowait()
            pickle.dump(job, process.stdin)
            process.stdin.flush()
            if process.stdout.read(1) != b"1":
                return
            done(job)


def main() -> None:
    """Compile what comes on standard input, until it ends."""
    into, out = sys.stdin.buffer, os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what a module prints is no answer
    while True:
        try:
            job: Job = pickle.load(into)  # of the process that has started this one
        except EOFError:
            return
        with suppress(Exception):  # the process that needs the kernel meets it as well
            job.compile()
            if job.mark is not None:
                job.mark.touch()
        out.write(b"1")


if __name__ == "__main__":
    main()
