"""A digest of all that a kernel is made of: it changes when the kernel must be compiled again.

A kernel is made of its own byte code, the byte code of every function that it calls, at any depth,
and the values of all constants that these name, wherever they were imported from. Comments, types
of arguments and other functions of the same files are no part of it: an edit changes the digests of
the kernels that call the edited function, and of no others.

Functions of this package are replaced by others when they are compiled (`overload`, `intrinsic`),
which no name leads to: of these the whole file counts.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from hashlib import blake2b
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import types

__all__ = ["OUTSIDE", "Walk", "layout", "mark", "options_of", "size_of", "stamp"]

OUTSIDE = frozenset({"builtins", "llvmlite", "math", "numba", "numpy"})
"""Packages that are not looked into: their versions are in the key of the cache."""
OWN = __name__.rpartition(".")[0]
"""This package."""
MARK = "_compiled_with"
"""Attribute of functions that only kernels call: with which options."""
TUPLE: Any = types.BaseTuple
NAMED_TUPLE: Any = types.BaseNamedTuple


def stamp(function: Any) -> str:
    """A digest of all that a kernel is made of.

    Parameters
    ----------
    function : callable
        A kernel, or a function that is not compiled.

    Returns
    -------
    str
        Changes with the code and the options of any function that it calls, at any depth, with the
        value of any constant that one of them names, and with how this package compiles. Modules
        of `OUTSIDE` are not looked into.
    """
    walk = Walk()
    for file in ("jit.py", "nested.py"):
        walk.file(str(Path(__file__).with_name(file)))
    walk.value(function)
    return walk.digest.hexdigest()


def mark(function: Any, options: Mapping[str, object]) -> None:
    """Note with which options a function is compiled that only kernels call."""
    setattr(function, MARK, options_of(options))


def options_of(options: Mapping[str, object]) -> tuple[tuple[str, str], ...]:
    """Options of a compilation, as text that is the same in every process."""

    def text(value: object) -> str:
        if isinstance(value, set | frozenset):
            return repr(sorted(map(repr, value)))
        return value.__qualname__ if isinstance(value, type) else repr(value)

    return tuple(sorted((name, text(value)) for name, value in options.items()))


def layout(kind: Any) -> object:
    """Names of the fields of all named tuples in a type. Compiled code knows a field by its place;
    numba's own name of the type has the class and the types of the fields, not their names."""
    if isinstance(kind, NAMED_TUPLE):
        whose = kind.instance_class
        return whose.__module__, whose.__qualname__, kind.fields, layout(tuple(kind.types))
    if isinstance(kind, TUPLE):
        return layout(tuple(kind.types))
    return tuple(map(layout, kind)) if isinstance(kind, tuple) else None


class Walk:
    """Visits what a function is made of, and adds it to a digest.

    Attributes
    ----------
    digest : hashlib object
    size : int
        Bytes of byte code so far.
    """

    def __init__(self) -> None:
        self.digest = blake2b(digest_size=16)
        self.size = 0
        self._seen: set[object] = set()

    def value(self, value: Any, names: tuple[str, ...] = (), reader: Any = None) -> None:
        """Add a value; `names` are attributes that may be read of it, if it is a module, and
        `reader` is the function that names it."""
        if hasattr(value, "py_func"):  # a kernel
            self._add(options_of(getattr(value, "targetoptions", {})))
            value = value.py_func
        value = getattr(value, "_defn", value)  # an intrinsic
        if isinstance(value, FunctionType):
            self.function(value)
        elif isinstance(value, ModuleType):
            if _top(value.__name__) not in OUTSIDE:
                for name in names:
                    if hasattr(value, name):
                        self._named(name, getattr(value, name), names, reader)
        elif isinstance(value, np.ndarray):
            self._add(value.dtype.descr, value.shape, value.tobytes())
        elif isinstance(value, np.dtype):
            self._add(value.descr, value.itemsize)
        elif isinstance(value, enum.EnumType):
            members: Any = value
            self._add([(member.name, member.value) for member in members])
        elif isinstance(value, type):
            self._add(value.__module__, value.__qualname__, getattr(value, "_fields", ()),
                      getattr(value, "_field_defaults", ()))  # fmt: skip
        elif isinstance(value, tuple | list):
            self._add(type(value).__name__, len(value), getattr(value, "_fields", ()))
            for part in value:
                self.value(part, names, reader)
        elif isinstance(value, set | frozenset):
            self._add(sorted(map(repr, value)))
        elif isinstance(value, types.Type):
            self._add(repr(value), layout(value))
        elif isinstance(value, bool | int | float | str | bytes | np.generic | enum.Enum | None):
            self._add(repr(value))
        else:  # what it is made of stands in a file of its own, or in that of who names it
            self._add(type(value).__qualname__, getattr(value, "__name__", ""))
            if reader is not None and _top(str(getattr(value, "__module__", ""))) not in OUTSIDE:
                self.file(reader.__code__.co_filename)

    def file(self, path: str) -> None:
        """Add the text of a file."""
        self._add(_file_digest(path))

    def function(self, function: FunctionType) -> None:
        """Add a function and all that it calls."""
        module = function.__module__ or ""
        if _top(module) in OUTSIDE:
            return
        cells = [cell.cell_contents for cell in function.__closure__ or ()]
        key = (function.__code__, tuple(map(id, cells)))
        if key in self._seen:
            return
        self._seen.add(key)
        if module.startswith(OWN + "."):
            self.file(function.__code__.co_filename)
        self._add(module, function.__qualname__, getattr(function, MARK, None))
        self._code(function.__code__)
        names = tuple(_names(function.__code__))
        for name in names:
            if name in function.__globals__:
                self._named(name, function.__globals__[name], names, function)
        given = *cells, *(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values()
        for value in given:
            self.value(value, names, function)

    def _code(self, code: CodeType) -> None:
        """Add byte code, that of functions within it included; where it stands is no part."""
        self.size += len(code.co_code)
        self._add(
            code.co_code, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars,
            code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags,
            getattr(code, "co_exceptiontable", b""),
        )  # fmt: skip
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                self._code(constant)
            else:
                self.value(constant)

    def _named(self, name: str, value: Any, names: tuple[str, ...], reader: Any) -> None:
        self._add(name)
        self.value(value, names, reader)

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


def size_of(function: Callable[..., Any]) -> int:
    """Bytes of byte code that a kernel is made of: what its compilation takes goes with it."""
    walk = Walk()
    walk.value(function)
    return walk.size
