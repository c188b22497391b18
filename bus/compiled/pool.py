"""Several kernels compiled at once, by as many processes as there are cores.

Within `together`, a bound kernel that is not in the cache is not compiled where it is bound: it is
queued. Processes of their own take the largest ones first, compile them and keep them in the cache;
this one goes on, and loads the code when it needs it. Then it takes part: it compiles what is
queued, the largest first, until it has what it needs. No process is started where all kernels are
in the cache, where nothing can be kept, or where there is one core.

A process is given the names under which a kernel is found and the types of its arguments. One that
cannot compile, or dies, costs time alone: who needs the kernel compiles it then.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from threading import Condition, Thread
from typing import Any, NamedTuple

from bus.compiled import cache, places
from bus.processors import processors

__all__ = ["Job", "Pool", "job_of", "submit", "together", "wait"]

LOOK_S = 0.1
"""Between two looks at what others compile."""
PACKAGES = {"bus", "skin"}
"""Of which other processes compile kernels: to import other modules may have effects."""
_pools: list[Pool] = []
"""The innermost last."""


class Job(NamedTuple):
    """A kernel, as another process finds it: a module, the name of the kernel in it or of what
    makes it, and the arguments of that; and the types of its arguments."""

    module: str
    name: str
    made_by: tuple[Any, ...] | None
    kinds: tuple[Any, ...]

    def kernel(self) -> Any:
        """The kernel, imported."""
        found = getattr(import_module(self.module), self.name)
        return found if self.made_by is None else found(*self.made_by)


def job_of(kernel: Any, kinds: tuple[Any, ...]) -> Job | None:
    """How another process finds a kernel; None where it cannot."""
    function = kernel.py_func
    if function.__module__.partition(".")[0] not in PACKAGES:
        return None
    made_by = getattr(kernel, "made_by", None)
    if made_by is not None:
        return Job(function.__module__, made_by[0], made_by[1:], kinds)
    module = sys.modules.get(function.__module__)
    names = (name for name, value in vars(module).items() if value is kernel) if module else ()
    return next((Job(function.__module__, name, None, kinds) for name in names), None)


@contextmanager
def together(count: int | None = None) -> Iterator[Pool]:
    """Let kernels that are bound from now on be compiled by several processes.

    Parameters
    ----------
    count : int, optional
        Processes, this one included; as many as there are cores if not given.
    """
    _pools.append(pool := Pool(processors() if count is None else count))
    try:
        with cache.rare_collections():
            yield pool
    finally:
        _pools.remove(pool)
        pool.close()


def submit(kernel: Any, kinds: tuple[Any, ...]) -> bool:
    """Queue a kernel; False where it is to be compiled, or loaded, at once."""
    return bool(_pools) and _pools[-1].submit(kernel, kinds)


def wait(kernel: Any, kinds: tuple[Any, ...]) -> None:
    """Go on when nobody compiles a kernel that was queued."""
    for pool in list(_pools):
        pool.wait(kernel, kinds)


class Pool:
    """Processes that compile, started when there is something for them.

    Parameters
    ----------
    count : int
        At most so many kernels at once, that of this process included.
    """

    def __init__(self, count: int) -> None:
        self._count, self._owner = count, os.getpid()
        self._queue: list[tuple[int, Job, Any]] = []
        self._running: set[Job] = set()
        self._known: set[Job] = set()
        self._changed = Condition()
        self._threads: list[Thread] = []
        self._open = count > 1 and bool(sys.executable)

    def submit(self, kernel: Any, kinds: tuple[Any, ...]) -> bool:
        """Queue a kernel that is not in the cache; False where it is, or this process must."""
        kept = getattr(kernel, "_cache", None)
        if os.getpid() != self._owner:  # forked
            return False
        if not self._open or not isinstance(kept, cache.KernelCache) or kinds in kernel.overloads:
            return False
        job = job_of(kernel, kinds)
        if job is None or kept.holds(kinds, kernel.targetctx.codegen()):
            return False
        if places.written() is None:
            return False
        with self._changed:
            if job in self._known:
                return True
            self._known.add(job)
            self._queue.append((kept.size, job, kernel))
            self._queue.sort(key=lambda one: -one[0])
            cache.report_planned(kept.name, kept.size)
            if len(self._threads) < min(self._count - 1, len(self._known)):
                self._threads.append(thread := Thread(target=self._serve, daemon=True))
                thread.start()
            self._changed.notify_all()
        return True

    def wait(self, kernel: Any, kinds: tuple[Any, ...]) -> None:
        """Wait until nobody compiles a kernel, and it is not queued any more. Meanwhile compile
        others, and those that take longer even before it, if it is queued: all are needed, and what
        is begun last should be short."""
        job = job_of(kernel, kinds)
        while os.getpid() == self._owner:  # a fork has none of the threads
            with self._changed:
                if job not in self._running and all(one[1] != job for one in self._queue):
                    return
                if not self._queue:
                    self._changed.wait(LOOK_S)
                    continue
                _, found, other = self._queue.pop(0)
                if found == job:
                    return
            with suppress(Exception):  # who needs that kernel meets it as well
                _prepare(other, found.kinds)

    def close(self) -> None:
        """Start no more; what is being compiled is kept when it is done."""
        with self._changed:
            self._open = False
            self._queue.clear()
            self._changed.notify_all()

    def _next(self) -> tuple[int, Job, Any] | None:
        """The largest that is queued, once there is one; None at the end."""
        with self._changed:
            while self._open and not self._queue:
                self._changed.wait()
            if not self._open:
                return None
            found = self._queue.pop(0)
            self._running.add(found[1])
            return found

    def _serve(self) -> None:
        """Give a process one kernel after the other."""
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        with suppress(OSError), subprocess.Popen(
            [sys.executable, "-P", "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": paths},
            start_new_session=True,
        ) as process:  # fmt: skip
            into, out = process.stdin, process.stdout
            assert into is not None
            assert out is not None
            while (found := self._next()) is not None:
                _, job, kernel = found
                try:
                    with cache.reporting(kernel._cache.name):
                        pickle.dump(job, into)
                        into.flush()
                        pickle.load(out)
                except (OSError, EOFError, pickle.PicklingError, AttributeError):
                    return  # the process has died: who needs the kernel compiles it
                finally:
                    with self._changed:
                        self._running.discard(job)
                        self._changed.notify_all()


def _prepare(kernel: Any, kinds: tuple[Any, ...]) -> None:
    """Compile a kernel, and what calls it by address."""
    from bus.compiled.bound import prepare

    prepare(kernel, kinds)


def main() -> None:
    """Compile what comes on standard input, until it ends."""
    into, out = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a module prints is no answer
    while True:
        try:
            job: Job = pickle.load(into)
        except EOFError:
            return
        with suppress(Exception):  # the process that needs the kernel meets it as well
            _prepare(job.kernel(), job.kinds)
        pickle.dump(None, out)
        out.flush()


if __name__ == "__main__":
    main()
