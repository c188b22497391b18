"""The cache of compiled kernels on disk: compiled anew when anything changes that they are made of.

Numba's own cache looks at the kernel's file and at nothing else. Here the key of the cache holds a
stamp of all that the kernel stands on: the files of all functions that it calls, at any depth, and
the values of all constants that these name, wherever they were imported from.

Numba numbers the files of a kernel and keeps an index of them; two processes that compile two
variants at the same time may give both the same number, and the index of one leads to the code of
the other from then on. Here the name of a file follows from its key, and there is no index.

It lies where numba would keep its own: in NUMBA_CACHE_DIR, beside the kernel, or in the user's
folder for caches. Where none of them can be written, it lies in a folder of the user's own among
temporary files, and where that cannot be written either, nothing is kept; the logger "bus" says so.
What lies beside the kernel or in NUMBA_CACHE_DIR is read in any case: a read-only image may hold
code that was compiled when it was built.

Stands on private parts of numba (`FunctionCache`, its places, `IndexDataCacheFile`); where a
version lacks them, kernels are compiled anew in every process.
"""

from __future__ import annotations

import contextlib
import enum
import logging
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from hashlib import blake2b
from pathlib import Path
from pickle import UnpicklingError
from stat import S_IRWXG, S_IRWXO, S_ISDIR, S_ISVTX
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import config, types

try:
    from numba.core.caching import FunctionCache, IndexDataCacheFile
except ImportError:  # a numba of another version
    FunctionCache = IndexDataCacheFile = None

__all__ = ["cache_on_disk", "stamp", "watch"]

OUTSIDE = frozenset({"builtins", "llvmlite", "math", "numba", "numpy"})
"""Packages whose versions numba's cache, or ours, does not look at."""
DAMAGED = (AttributeError, EOFError, ImportError, IndexError, UnpicklingError, ValueError)
"""What a file raises that was cut off, as by a loss of power."""
UNUSED_S = 30 * 24 * 3600.0
"""Files of a kernel that nobody has read for so long go when another one is written [assumed]."""
PRIVATE = ((FunctionCache, "_index_key"), (getattr(FunctionCache, "_impl_class", None),
           "_locator_classes"), (IndexDataCacheFile, "_load_data"),
           (IndexDataCacheFile, "_save_data"))  # fmt: skip

_log = logging.getLogger("bus")
_watchers: list[tuple[Callable[[str], None], Callable[[str], None]]] = []


@contextmanager
def watch(
    told: Callable[[str], None], done: Callable[[str], None] = lambda kernel: None
) -> Iterator[None]:
    """Be told the name of every kernel that the cache lacks, before it is compiled.

    Parameters
    ----------
    told : callable
        Takes the name of the kernel. To compile takes from a tenth of a second to several.
    done : callable, optional
        Takes the name when it is compiled and kept.
    """
    _watchers.append(watcher := (told, done))
    try:
        yield
    finally:
        _watchers.remove(watcher)


def cache_on_disk(kernel: Any) -> None:
    """Keep what a dispatcher compiles from now on on disk, and look there first.

    Nothing is kept of a kernel without a file, and where no folder can be written.
    """
    if not all(hasattr(holder, name) for holder, name in PRIVATE):
        return
    with contextlib.suppress(RuntimeError):  # numba finds no place
        kernel._cache = _stamped_cache()(kernel.py_func)


class _Spare:
    """Among temporary files: where a kernel is kept that no place of numba's can take."""

    def __init__(self, function: FunctionType) -> None:
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: FunctionType, file: str) -> _Spare | None:
        return cls(function) if Path(file).exists() else None

    def ensure_cache_path(self) -> None:
        folder = _temporary_folder()
        if folder is None:
            raise OSError("no folder can be written; set NUMBA_CACHE_DIR to one that can")
        _kept_in(folder)

    def get_cache_path(self) -> str:
        return _temporary_folder() or os.devnull

    def get_source_stamp(self) -> None:
        return None

    def get_disambiguator(self) -> str:
        return str(self._line)


@cache
def _kept_in(folder: str) -> None:
    """Say, once, where compiled code goes."""
    _log.warning(
        "f3t-skin: compiled kernels are kept in %s: no other folder can be written; "
        "set NUMBA_CACHE_DIR to one that can",
        folder,
    )


def _places(numbas: list[Any]) -> tuple[Any, ...]:
    """Numba's and then ours. Of a user without a home numba would take a folder of the working
    one."""
    home = os.path.expanduser("~")
    has_home = os.path.isabs(os.environ.get("XDG_CACHE_HOME", home)) and Path(home).is_dir()
    return (*(one for one in numbas if has_home or "UserWide" not in one.__name__), _Spare)


def _temporary_folder() -> str | None:
    """A folder that nobody else can write: what is read from it is run. Not in the working folder,
    which `tempfile` takes where it finds no other."""
    user = os.getuid() if os.name == "posix" else 0
    try:
        place = Path(tempfile.gettempdir())
        if place.samefile(Path.cwd()) and not place.stat().st_mode & S_ISVTX:
            return None
        folder = place / f"f3t-skin-{user}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    if os.name == "posix" and (found.st_uid != user or found.st_mode & (S_IRWXG | S_IRWXO)):
        return None
    return str(folder) if S_ISDIR(found.st_mode) else None


@cache
def _stamped_cache() -> type:
    cache: Any = FunctionCache
    files: Any = IndexDataCacheFile
    settings: Any = config
    places = _places(cache._impl_class._locator_classes)

    class Places(cache._impl_class):
        """Numba's, and ours after them."""

        _locator_classes = places

    class KeyedFiles(files):
        """A file for each key, named by it: processes may write at once."""

        def __init__(self, path, kernel, ready):
            super().__init__(path, kernel, None)
            self._folder, self._kernel, self._ready = Path(path), kernel, ready

        def load(self, key):
            name = self._name(key)
            for file in (self._folder / name, *(folder / name for folder in self._ready)):
                try:
                    found = self._load_data(str(file))
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

        def save(self, key, data):
            self._save_data(self._name(key), data)
            for file in self._folder.glob(f"{self._kernel}.*.nbc"):
                with contextlib.suppress(OSError):
                    if time.time() - file.stat().st_mtime > UNUSED_S:
                        file.unlink()

        def _name(self, key):
            told = blake2b(repr((self._version, key)).encode(), digest_size=16).hexdigest()
            return f"{self._kernel}.{told}.nbc"

    class StampedCache(cache):
        """Numba's cache, with `stamp` in its key."""

        _impl_class = Places
        _stamp: str | None = None

        def __init__(self, function):
            super().__init__(function)
            file = function.__code__.co_filename
            ready = [Path(file).with_name("__pycache__")]
            if given := settings.CACHE_DIR:
                ready.append(Path(given, places[0].get_suitable_cache_subpath(file)))
            self._cache_file = KeyedFiles(self._cache_path, self._impl.filename_base, ready)

        def _index_key(self, sig, codegen):
            if self._stamp is None:
                self._stamp = stamp(self._py_func)
            return sig, _layout(sig), codegen.magic_tuple(), self._stamp

        def load_overload(self, sig, target_context):
            found = super().load_overload(sig, target_context)
            if found is None:
                for told, _ in _watchers:
                    told(self._py_func.__qualname__)
            return found

        def save_overload(self, sig, data):
            try:
                super().save_overload(sig, data)
            except OSError as error:  # the disk is full, or the folder has gone
                _not_kept(error.strerror or str(error))
            for _, done in _watchers:
                done(self._py_func.__qualname__)

    return StampedCache


@cache
def _not_kept(why: str) -> None:
    """Say, once for each reason, that a kernel could not be kept."""
    _log.warning("f3t-skin: compiled kernels cannot be kept: %s", why)


def stamp(function: Callable[..., Any]) -> str:
    """A digest of all that a kernel is made of.

    Parameters
    ----------
    function : callable
        Not compiled.

    Returns
    -------
    str
        Changes with the file of any function that it calls, at any depth, and with the value of any
        constant that one of them names, and with how this package compiles. Modules of `OUTSIDE`
        are not looked into.
    """
    walk = _Walk()
    for file in ("jit.py", "nested.py"):
        walk.file(str(Path(__file__).with_name(file)))
    walk.value(function)
    return walk.digest.hexdigest()


TUPLE: Any = types.BaseTuple
NAMED_TUPLE: Any = types.BaseNamedTuple


def _layout(kind: Any) -> object:
    """Names of the fields of all named tuples in a type. Compiled code knows a field by its place;
    numba's own name of the type tells the class and the types of the fields, not their names."""
    if isinstance(kind, NAMED_TUPLE):
        whose = kind.instance_class
        return whose.__module__, whose.__qualname__, kind.fields, _layout(tuple(kind.types))
    if isinstance(kind, TUPLE):
        return _layout(tuple(kind.types))
    return tuple(map(_layout, kind)) if isinstance(kind, tuple) else None


class _Walk:
    """Visits what a function stands on, and adds it to a digest."""

    def __init__(self) -> None:
        self.digest = blake2b(digest_size=16)
        self._seen: set[object] = set()

    def value(self, value: Any, names: tuple[str, ...] = ()) -> None:
        """Add a value; `names` are attributes that may be read of it, if it is a module."""
        value = getattr(value, "py_func", value)  # a kernel
        value = getattr(value, "_defn", value)  # an intrinsic
        if isinstance(value, FunctionType):
            self._function(value)
        elif isinstance(value, ModuleType):
            if _top(value.__name__) not in OUTSIDE:
                for name in names:
                    if hasattr(value, name):
                        self._named(name, getattr(value, name), names)
        elif isinstance(value, np.ndarray):
            self._add(value.dtype.descr, value.shape, value.tobytes())
        elif isinstance(value, np.dtype):
            self._add(value.descr, value.itemsize)
        elif isinstance(value, enum.EnumType):
            members: Any = value
            self._add([(member.name, member.value) for member in members])
        elif isinstance(value, type):
            self._add(value.__qualname__, getattr(value, "_fields", ()))
        elif isinstance(value, tuple | list):
            self._add(type(value).__name__, len(value), getattr(value, "_fields", ()))
            for part in value:
                self.value(part)
        elif isinstance(value, set | frozenset):
            self._add(sorted(map(repr, value)))
        elif isinstance(value, types.Type):
            self._add(repr(value), _layout(value))
        elif isinstance(value, bool | int | float | str | bytes | np.generic | enum.Enum | None):
            self._add(repr(value))
        else:
            self._add(type(value).__qualname__)

    def file(self, path: str) -> None:
        """Add the text of a file."""
        self._add(_file_digest(path))

    def _named(self, name: str, value: Any, names: tuple[str, ...]) -> None:
        self._add(name)
        self.value(value, names)

    def _function(self, function: FunctionType) -> None:
        if _top(function.__module__ or "") in OUTSIDE:
            return
        cells = [cell.cell_contents for cell in function.__closure__ or ()]
        key = (function.__code__, tuple(map(id, cells)))
        if key in self._seen:
            return
        self._seen.add(key)
        self.file(function.__code__.co_filename)
        self._add(function.__code__.co_code)
        for constant in function.__code__.co_consts:
            if not isinstance(constant, CodeType):
                self.value(constant)
        names = tuple(_names(function.__code__))
        for name in names:
            if name in function.__globals__:
                self._named(name, function.__globals__[name], names)
        for given in (*cells, *(function.__defaults__ or ())):
            self.value(given, names)

    def _add(self, *parts: object) -> None:
        for part in parts:
            self.digest.update(part if isinstance(part, bytes) else repr(part).encode())
            self.digest.update(b"\0")


def _top(module: str) -> str:
    return module.partition(".")[0]


def _names(code: CodeType) -> Iterator[str]:
    """Names that a function reads of its module, or as attributes, functions within it included."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


@cache
def _file_digest(path: str) -> bytes:
    try:
        return blake2b(Path(path).read_bytes(), digest_size=16).digest()
    except OSError:  # typed in, or generated
        return path.encode()
