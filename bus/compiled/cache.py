"""The cache of compiled kernels on disk: each is compiled once by all processes of a user.

A file holds the machine code of one kernel for one signature. Its name follows from all that the
code depends on: the digest of what the kernel is made of (`bus.compiled.stamps`), the signature,
the processor and its features, and the versions of Python, numba, llvmlite and numpy. So all
virtual environments of a user share the folder (`bus.compiled.places`), processes may write at the
same time, and there is no index that could mix two files up, as numba's own does.

Processes that need the same kernel at the same time wait for each other: who compiles holds a lock
on a file of its own, which the system releases when the process ends, however it ends. Where files
cannot be locked or nothing can be written, each compiles for itself.

Stands on private parts of numba (how a compiled function becomes bytes and is restored, and the
protocol between a dispatcher and its cache); where a version has none of them, kernels are
compiled in every process.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import pickle
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, cached_property
from hashlib import blake2b
from importlib.util import MAGIC_NUMBER
from pathlib import Path
from threading import Lock, local
from typing import Any, NamedTuple

import llvmlite
import numba
import numpy as np
from numba import config

from bus.compiled import places
from bus.compiled.stamps import layout, options_of, size_of, stamp

try:
    from numba.core.compiler import CompileResult
    from numba.core.serialize import dumps
except ImportError:  # a numba of another version
    CompileResult = dumps = None
try:
    import fcntl
except ImportError:  # not on this system
    fcntl = None

__all__ = [
    "KernelCache", "cache_on_disk", "rare_collections", "report_planned", "reporting", "watch",
]  # fmt: skip

DAMAGED = (AttributeError, EOFError, ImportError, IndexError, TypeError, ValueError,
           pickle.UnpicklingError)  # fmt: skip
"""What a file raises that was cut off, as by a loss of power."""
UNUSED_S = 30 * 24 * 3600.0
"""Files that nobody has read for so long go when another one is written [assumed]."""
LONGEST_S = 600.0
"""That a process waits for another one to compile [assumed: one that is stopped never ends]."""
RARE = 100_000, 50, 1000
"""Thresholds of the garbage collector while kernels are compiled."""
LOOK_S = 0.02
"""Between two looks whether a kernel has been compiled."""
VERSIONS = (numba.__version__, llvmlite.__version__, np.__version__, sys.implementation.cache_tag,
            MAGIC_NUMBER)  # fmt: skip

_log = logging.getLogger("bus")
_watchers: list[Watcher] = []
_held = local()
"""Locks that the compilations of a thread hold: ``locks``, the innermost last."""


@contextmanager
def watch(
    begun: Callable[[str], None],
    done: Callable[[str], None] = lambda kernel: None,
    planned: Callable[[str, int], None] = lambda kernel, size: None,
) -> Iterator[None]:
    """Hear of every kernel that is not in the cache, before it is compiled for this process.

    Parameters
    ----------
    begun : callable
        Takes the name of the kernel. To compile takes from a tenth of a second to half a minute.
    done : callable, optional
        Takes the name when it is compiled and kept.
    planned : callable, optional
        Takes, before, the name and the size of the byte code, to which the time is about
        proportional.
    """
    _watchers.append(watcher := Watcher(begun, done, planned))
    try:
        yield
    finally:
        _watchers.remove(watcher)


def report_planned(kernel: str, size: int) -> None:
    """Report to all that watch that a kernel will be compiled."""
    for watcher in _watchers:
        watcher.planned(kernel, size)


@contextmanager
def reporting(kernel: str) -> Iterator[None]:
    """Report to all that watch that another process compiles a kernel, and then that it has."""
    for watcher in _watchers:
        watcher.begun(kernel)
    try:
        yield
    finally:
        for watcher in _watchers:
            watcher.done(kernel)


def cache_on_disk(kernel: Any, options: Mapping[str, object]) -> None:
    """Keep what a dispatcher compiles from now on on disk, and look there first.

    Parameters
    ----------
    kernel : Dispatcher
    options : mapping
        With which it is compiled.
    """
    parts = (CompileResult, "_reduce"), (CompileResult, "_rebuild"), (kernel, "_cache")
    if dumps is None or not all(hasattr(holder, name) for holder, name in parts):
        return
    kernel._cache = KernelCache(kernel.py_func, options)
    numbas = kernel.compile

    def compile_alone(signature: Any) -> Any:
        locks = _held.__dict__.setdefault("locks", [])
        before = len(locks)
        try:
            with rare_collections():
                return numbas(signature)
        finally:  # compiled or not
            while len(locks) > before:
                _release(*locks.pop())

    kernel.compile = compile_alone


class Collector:
    """Thresholds of the garbage collector while kernels are compiled.

    Numba makes millions of objects that live until a kernel is compiled, and a collector that looks
    at them again and again takes a sixth of the time; without any, memory grows by a third.
    """

    def __init__(self) -> None:
        self._lock, self._within = Lock(), 0
        self._usual = gc.get_threshold()

    @contextmanager
    def rare(self) -> Iterator[None]:
        """Let it run a hundred times less often, as long as any thread is within."""
        with self._lock:
            self._within += 1
            if self._within == 1:
                self._usual = gc.get_threshold()
                gc.set_threshold(*RARE)
        try:
            yield
        finally:
            with self._lock:
                self._within -= 1
                if self._within == 0:
                    gc.set_threshold(*self._usual)


rare_collections = Collector().rare


class Watcher(NamedTuple):
    """See `watch`."""

    begun: Callable[[str], None]
    done: Callable[[str], None]
    planned: Callable[[str, int], None]


class KernelCache:
    """What numba asks for a kernel's machine code, and gives it to keep.

    Parameters
    ----------
    function : callable
        The kernel, not compiled.
    options : mapping
        With which it is compiled.

    Attributes
    ----------
    name : str
        Qualified name of the kernel.
    """

    def __init__(self, function: Any, options: Mapping[str, object]) -> None:
        self._function, self._options = function, options_of(options)
        name = f"{function.__module__}.{function.__qualname__}".replace("<locals>.", "")
        self._name = re.sub(r"[^\w.-]", "_", name)[-120:]
        self._stamp: str | None = None
        self.name: str = function.__qualname__

    @cached_property
    def size(self) -> int:
        """Bytes of byte code that the kernel is made of."""
        return size_of(self._function)

    @property
    def cache_path(self) -> str:
        """The folder for new kernels, empty for none: of numba's statistics."""
        return str(places.written() or "")

    def flush(self) -> None:
        """Of numba's protocol: nothing is kept whose name does not say what it is."""

    def file_of(self, signature: Any, codegen: Any) -> str:
        """Name of the file of a signature."""
        if self._stamp is None:
            self._stamp = stamp(self._function)
        settings: Any = config
        key = (VERSIONS, self._stamp, self._options, signature, layout(signature),
               codegen.magic_tuple(), bool(settings.BOUNDSCHECK))  # fmt: skip
        digest = blake2b(repr(key).encode(), digest_size=16).hexdigest()
        return f"{self._name}.{digest}.nbc"

    def holds(self, signature: Any, codegen: Any) -> bool:
        """Whether there is a file of a signature."""
        name = self.file_of(signature, codegen)
        return any((folder / name).exists() for folder in places.read())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Of numba's protocol: the compiled function of a signature; None if it is to be compiled,
        by this process alone where files can be locked."""
        target_context.refresh()
        name = self.file_of(sig, target_context.codegen())
        found = self._load(name, target_context)
        if found is None and (folder := places.written()) is not None:
            lock = _lock(folder / f"{name}.lock")
            if lock is not None:
                _held.__dict__.setdefault("locks", []).append(lock)
                found = self._load(name, target_context)  # of who held it before
        if found is None:
            for watcher in _watchers:
                watcher.planned(self.name, self.size)
                watcher.begun(self.name)
        return found

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Of numba's protocol: keep a compiled function."""
        try:
            folder = places.written()
            if folder is None:
                raise OSError("no folder can be written; set NUMBA_CACHE_DIR to one that can")
            if not (cres.library.has_dynamic_globals or any(not x.can_cache for x in cres.lifted)):
                self._save(folder / self.file_of(sig, cres.codegen), cres)
        except OSError as error:  # the disk is full, or the folder has gone
            _say_not_kept(error.strerror or str(error))
        for watcher in _watchers:
            watcher.done(self.name)

    def _load(self, name: str, target_context: Any) -> Any:
        rebuild: Any = CompileResult
        for folder in places.read():
            file = folder / name
            try:
                parts = pickle.loads(file.read_bytes())
                found = rebuild._rebuild(target_context, *parts)
            except OSError:
                continue
            except DAMAGED:
                with contextlib.suppress(OSError):
                    file.unlink()
                continue
            with contextlib.suppress(OSError):  # a folder that may be read only
                os.utime(file)
            return found
        return None

    def _save(self, file: Path, cres: Any) -> None:
        bytes_of: Any = dumps
        code = bytes_of(cres._reduce())
        handle, partial = tempfile.mkstemp(dir=file.parent, prefix=f"{file.name}.")
        try:
            with os.fdopen(handle, "wb") as out:
                out.write(code)
            os.chmod(partial, 0o644)  # another user may run a read-only image
            os.replace(partial, file)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(partial)
            raise
        for old in file.parent.glob("*.nbc*"):  # those that a killed process has left as well
            with contextlib.suppress(OSError):
                if time.time() - old.stat().st_mtime > UNUSED_S:
                    old.unlink()


def _lock(path: Path) -> tuple[int, Path] | None:
    """Lock a file, once no other process has it; None where that cannot be done, or takes longer
    than any compilation."""
    lock: Any = fcntl
    if lock is None:
        return None
    until = time.monotonic() + LONGEST_S
    while time.monotonic() < until:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError:
            return None
        try:
            lock.flock(handle, lock.LOCK_EX | lock.LOCK_NB)
            if os.path.samestat(os.fstat(handle), os.stat(path)):
                return handle, path
        except (BlockingIOError, FileNotFoundError):  # held, or just released
            pass
        except OSError:  # a file system without locks
            os.close(handle)
            return None
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
        time.sleep(LOOK_S)
    return None


def _release(handle: int, path: Path) -> None:
    """Release a lock. The file goes first: who has opened it meanwhile sees that it is gone."""
    with contextlib.suppress(OSError):
        path.unlink()
    with contextlib.suppress(OSError):  # the lock of a forked process would stay
        lock: Any = fcntl
        lock.flock(handle, lock.LOCK_UN)
    os.close(handle)


@cache
def _say_not_kept(why: str) -> None:
    """Say, once for each reason, that a kernel could not be kept."""
    _log.warning("f3t-skin: compiled kernels cannot be kept: %s", why)
