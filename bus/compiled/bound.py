"""Calls of kernels whose arguments stay the same.

Numba looks at every argument of every call: some 60 ns for each array, which for a kernel with
twenty of them is as long as its work on a hundred units. Here they are looked at once and written
down as the words that the compiled function takes, addresses among them; a call then has one
argument.

It stands on private parts of numba and llvmlite: how a function takes its arguments, and where it
lies. Where a version has none of them, a bound kernel calls the kernel as anybody would.
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Iterator
from hashlib import blake2b
from typing import Any, NamedTuple
from weakref import WeakSet

import numpy as np
from numba import njit, typeof, types
from numba.extending import intrinsic

from bus.compiled import nested, pool
from bus.compiled.cache import cache_on_disk

try:
    from llvmlite import ir
    from numba.core import cgutils
    from numba.core.errors import NumbaError

    OF_NUMBA: tuple[type[Exception], ...] = (NumbaError,)
except ImportError:  # numba or llvmlite of another version
    ir: Any = None
    cgutils: Any = None
    OF_NUMBA = ()

__all__ = ["Bound", "Callers", "calling_at", "direct", "prepare", "ready_all"]

TUPLE: Any = types.BaseTuple
DATA = 4
"""Which of an array's words is the address of its data."""
_queued: WeakSet[Bound] = WeakSet()
_callers: dict[object, tuple[Callable, int | None, object]] = {}
_known: dict[Any, types.Type] = {}
"""Types of arguments, by their `_key`."""


def direct(kernel: Any) -> Callable[..., Any]:
    """A kernel without its dispatcher, which looks at the type of every array at each call.

    Parameters
    ----------
    kernel : callable
        Compiled for one signature, for which the caller answers from now on; anything else is
        handed back as it is.
    """
    if not hasattr(kernel, "overloads"):
        return kernel
    (found,) = kernel.overloads.values()
    return getattr(found, "entry_point", kernel)


class Bound(functools.partial):
    """A kernel and its arguments, as a function without any.

    It is a partial of the compiled function, so that Python runs no line of its own in a call. Of a
    kernel without a result it may return 0, and of truth values their bits, see `chained.call`.

    Parameters
    ----------
    kernel : callable
        As of `bus.compiled.jit.compiled`; anything else is called as it is.
    *arguments
        Arrays, numbers, truth values, None, and tuples of these, named ones too. What a kernel is
        to be given with every call stands in an array.

    """

    _arguments: list[Any]
    _exchanged: dict[int | tuple[int | str, ...], np.ndarray]
    """What `put` gave, by where, and is not yet in `_arguments`."""
    _words: np.ndarray | None
    """What the compiled function takes; None where the kernel is called with `_arguments`."""
    _places: dict[int | tuple[int | str, ...], int]
    """Which of `_words` is the address of an array, by the path that leads to it."""
    _kernel: Any
    """Kept, or its code would go with it."""
    _kinds: tuple[types.Type, ...] | None
    """Types of the arguments of a kernel that has not been compiled or loaded yet."""
    entry: int | None = None
    """Address of a function of the address of `_words`, whose result is an integer; None where
    there is none."""

    def __new__(cls, kernel: Any, *arguments: Any) -> Bound:
        kept = list(arguments)
        words, places, kinds = [0], {}, None
        if hasattr(kernel, "overloads") and _has_private_parts():
            kinds = tuple(_kind(argument) for argument in arguments)
            for position, (kind, argument) in enumerate(zip(kinds, arguments, strict=True)):
                places |= _places(kind, argument, (position,), len(words))
                words += _words(kind, argument)
        self = super().__new__(cls, lambda: kernel(*kept))
        self._words = None if kinds is None else np.array(words, np.int64)
        self._arguments, self._exchanged, self._places, self._kernel = kept, {}, places, kernel
        self._kinds = kinds
        if kinds is not None:
            if pool.submit(kernel, kinds):
                self._turn_into(self._first)
                _queued.add(self)
            else:
                self.ready()
        return self

    def ready(self) -> None:
        """Compile the kernel or load it, where that is not done yet: within `pool.together` it is
        when it is needed."""
        if self._kinds is None:
            return
        kinds, words = self._kinds, self._words
        _queued.discard(self)
        pool.wait(self._kernel, kinds)
        found = prepare(self._kernel, kinds)
        if found is None or words is None:
            kernel, self._words = self._kernel, None
            self._turn_into(lambda: kernel(*self.arguments))
        else:
            words[0] = found.code
            self._turn_into(found.caller, words.ctypes.data)
            self.entry = found.entry
        self._kinds = None

    def _first(self) -> Any:
        self.ready()
        return self()

    def _turn_into(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Be a partial of another function."""
        state = function, arguments, {}, self.__dict__
        self.__setstate__(state)  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def arguments(self) -> list[Any]:
        """The arguments as of now; kept, as a call reads and writes them by address."""
        while self._exchanged:
            where, array = self._exchanged.popitem()
            path = list(where) if isinstance(where, tuple) else [where]
            position: Any = path.pop(0)
            self._arguments[position] = _replaced(self._arguments[position], path, array)
        return self._arguments

    def put(self, where: int | tuple[int | str, ...], array: np.ndarray) -> None:
        """Exchange an array for another of the same type, shape and strides, for which the caller
        answers.

        Parameters
        ----------
        where : int or tuple
            Which argument; within named tuples the names that lead to it: ``(1, "counts")``.
        array : ndarray
        """
        self._exchanged[where] = array
        if self._words is None:
            _ = self.arguments
        else:
            self._words[self._places[where]] = array.__array_interface__["data"][0]

    def __reduce__(self) -> str:
        raise TypeError("a bound kernel knows the addresses of its arrays: it cannot be copied")


def _kind(argument: Any) -> types.Type:
    """The type of an argument by numba, which takes 0.1 ms to find that of an array of records:
    kept, so that what is bound again in a running loop costs no cycle."""
    key = _key(argument)
    kind = _known.get(key)
    if kind is None:
        kind = _known[key] = typeof(argument)
    return kind


def _key(argument: Any) -> Any:
    """What the type of an argument depends on."""
    if isinstance(argument, tuple):
        return type(argument), *map(_key, argument)
    if isinstance(argument, np.ndarray):
        flags = argument.flags
        layout = flags.c_contiguous, flags.f_contiguous, flags.aligned, flags.writeable
        return type(argument), argument.dtype, argument.ndim, *layout
    is_large = isinstance(argument, int) and argument >= 1 << 63
    return type(argument), getattr(argument, "dtype", None), is_large


def ready_all() -> None:
    """Compile or load all kernels that were bound within `pool.together` and are still held."""
    for bound in list(_queued):
        bound.ready()


def _has_private_parts() -> bool:
    """Whether kernels can be called by their addresses; without unique names code is not found."""
    return ir is not None and cgutils is not None and nested.kernel_pipeline is not None


class Callers(NamedTuple):
    """Where the code of a kernel lies, and what calls it: from Python, and by an address."""

    code: int
    caller: Callable[..., Any]
    entry: int | None


def prepare(kernel: Any, kinds: tuple[types.Type, ...]) -> Callers | None:
    """Compile a kernel, or load it, and what calls it; None where numba has no address."""
    if kinds not in kernel.overloads:
        kernel.compile(kinds)
    found = kernel.overloads[kinds]
    try:
        return Callers(_address_of(found), *_caller(found.signature))
    except (AttributeError, *OF_NUMBA):  # private parts of another version
        return None


def _address_of(compiled: Any) -> int:
    """Where the code of a compiled function lies."""
    return compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)


def _places(kind: Any, value: Any, path: tuple, first: int) -> dict[Any, int]:
    """Which words are the addresses of arrays, for a value whose words begin at `first`."""
    if isinstance(kind, types.Array):
        return dict.fromkeys((path, path[0]) if len(path) == 1 else (path,), first + DATA)
    places = {}
    if isinstance(kind, TUPLE):
        names = getattr(value, "_fields", range(len(value)))
        for name, part, inner in zip(names, tuple(kind), value, strict=True):
            places |= _places(part, inner, (*path, name), first)
            first += len(_words(part, inner))
    return places


def _replaced(value: Any, path: list[Any], array: np.ndarray) -> Any:
    """A named tuple with one array exchanged, at any depth."""
    if not path:
        return array
    name, *rest = path
    return value._replace(**{name: _replaced(getattr(value, name), rest, array)})


def _words(kind: Any, value: Any) -> list[int]:
    """A value as the words that `_value` reads."""
    if isinstance(kind, types.Array):
        # neither a reference count nor an owner: both are the arguments' that are kept
        return [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]
    if isinstance(kind, TUPLE):
        return [word for part in zip(kind, value, strict=True) for word in _words(*part)]
    if isinstance(kind, types.NoneType):
        return []
    if isinstance(kind, types.Integer | types.Boolean):
        return [int(value)]
    if kind == types.float64:
        return [struct.unpack("<q", struct.pack("<d", value))[0]]
    raise TypeError(f"a bound kernel takes no {kind}")


def _value(context: Any, builder: Any, kind: Any, words: Iterator[Any]) -> Any:
    """A value of a kind in compiled code, from its words."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder)
        model = context.data_model_manager[kind]
        for name in ("meminfo", "parent", "nitems", "itemsize", "data", "shape", "strides"):
            of = model.get_member_fe_type(name)
            member = next(words) if not isinstance(of, TUPLE) else _value(
                context, builder, of, words)  # fmt: skip
            if name in ("meminfo", "parent", "data"):
                member = builder.inttoptr(member, context.get_value_type(of))
            setattr(array, name, member)
        return array._getvalue()
    if isinstance(kind, TUPLE):
        parts = [_value(context, builder, part, words) for part in kind]
        return context.make_tuple(builder, kind, parts)
    if isinstance(kind, types.NoneType):
        return context.get_dummy_value()
    if isinstance(kind, types.Boolean):
        return builder.icmp_unsigned("!=", next(words), ir.IntType(64)(0))
    if kind == types.float64:
        return builder.bitcast(next(words), ir.DoubleType())
    return next(words)


def _caller(signature) -> tuple[Callable[..., Any], int | None]:
    """The compiled function that calls any function of a signature, given where that function's
    address and, after it, its arguments stand, and its own address where its result is an integer:
    0 for none, and truth values as bits from the lowest up."""
    key = signature.return_type, signature.args
    if key in _callers:
        return _callers[key][:2]
    call = _as_integer(calling_at(signature), signature.return_type)
    # a name, and so a file of the cache, for each signature: they are compiled side by side
    digest = blake2b(repr(key).encode(), digest_size=12).hexdigest()
    call.__qualname__ = f"{_caller.__qualname__}.{digest}"
    kernel: Any = njit(nogil=True)(call)
    cache_on_disk(kernel, {"nogil": True})
    kernel.compile((types.int64,))
    (found,) = kernel.overloads.values()
    entry = _address_of(found) if found.signature.return_type == types.int64 else None
    _callers[key] = found.entry_point, entry, kernel
    return _callers[key][:2]


def _as_integer(calling: Any, result: Any) -> Callable[[int], Any]:
    """A function of one number whose result is an integer where what it calls gives none, an
    integer, or truth values."""

    def nothing(place):
        calling(place)
        return np.int64(0)

    def two_bits(place):
        first, second = calling(place)
        return np.int64(first) | np.int64(second) << 1

    def number(place):
        return np.int64(calling(place))

    def other(place):
        return calling(place)

    if isinstance(result, types.NoneType):
        return nothing
    if isinstance(result, types.UniTuple) and result == types.UniTuple(types.boolean, 2):
        return two_bits
    return number if isinstance(result, types.Integer | types.Boolean) else other


def calling_at(signature) -> Any:
    """What kernels call to call a function of a signature by the words of a `Bound`."""
    result, kinds = signature.return_type, signature.args

    def call_address(typing, place):
        def code(context, builder, given, arguments):
            base = builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())
            words = (
                builder.load(builder.gep(base, [ir.IntType(64)(i)])) for i in range(2**31)
            )  # fmt: skip
            convention = context.call_conv
            function = convention.get_function_type(result, kinds).as_pointer()
            function = builder.inttoptr(next(words), function)
            values = [_value(context, builder, kind, words) for kind in kinds]
            status, out = convention.call_function(builder, function, result, kinds, values)
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return out

        return result(place), code

    return intrinsic(call_address)
