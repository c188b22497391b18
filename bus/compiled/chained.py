"""Bound kernels called by other kernels: by address, so that it is the same machine code.

A kernel that calls others is compiled together with them, which takes long, and lets the compiler
order their arithmetic in another way. A chained call is of any `Bound`, however it was compiled,
and gives the same numbers to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from hashlib import blake2b
from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from bus.compiled.bound import Bound, calling_at
from bus.compiled.cache import cache_on_disk

try:
    from llvmlite import ir
    from numba.core import cgutils
except ImportError:  # numba or llvmlite of another version
    ir: Any = None
    cgutils: Any = None

__all__ = ["NOTHING", "address", "call_at", "copy_bytes", "words"]

NOTHING = np.zeros(2, np.int64)
"""In place of the address of what is not there."""
_entries: dict[object, tuple[int, object]] = {}


def address(bound: object) -> np.ndarray | None:
    """Where a bound kernel is called: of a function of one number, and that number.

    Parameters
    ----------
    bound : Bound
        Kept by the caller, as its arguments are read by address.

    Returns
    -------
    ndarray, shape (2,), int64, or None
        None where numba does not tell, and of what is no `Bound`.
    """
    words = getattr(bound, "_words", None)
    if not isinstance(bound, Bound) or words is None or ir is None or cgutils is None:
        return None
    (found,) = (one for one in bound._kernel.overloads.values() if _lies_at(one, int(words[0])))
    return np.array([_entry(found.signature), words.ctypes.data])


def words(bound: Bound) -> np.ndarray:
    """What the call of a bound kernel reads its arguments from, int64, to be written by who calls
    it by its `address`: a number among them may be another one in the next call."""
    found = bound._words
    assert found is not None  # it has no address otherwise
    return found


def _lies_at(overload: Any, place: int) -> bool:
    """Whether the code of a compiled function is at this address."""
    return overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name) == place


def _entry(signature: Any) -> int:
    """Address of the function that calls any of a signature and gives its result as an integer:
    0 for none, and truth values as bits from the lowest up."""
    key = signature.return_type, signature.args
    if key not in _entries:
        call = _as_integer(calling_at(signature), signature.return_type)
        digest = blake2b(repr(key).encode(), digest_size=12).hexdigest()
        call.__qualname__ = f"{_entry.__qualname__}.{digest}"
        kernel: Any = njit(nogil=True)(call)
        cache_on_disk(kernel)
        kernel.compile((types.int64,))
        (found,) = kernel.overloads.values()
        code = found.library.get_pointer_to_function(found.fndesc.llvm_func_name)
        _entries[key] = code, kernel
    return _entries[key][0]


def _as_integer(calling: Any, result: Any) -> Callable[[int], Any]:
    """A function of one number whose result is an integer, whatever it calls gives."""

    def nothing(place):
        calling(place)
        return 0

    def two_bits(place):
        first, second = calling(place)
        return np.int64(first) | np.int64(second) << 1

    def number(place):
        return np.int64(calling(place))

    if isinstance(result, types.NoneType):
        return nothing
    return two_bits if isinstance(result, types.BaseTuple) else number


def _call_at(typing, function, place):
    """Call what `address` gave."""
    kind = types.int64

    def code(context, builder, given, arguments):
        convention = context.call_conv
        shape = convention.get_function_type(kind, (kind,)).as_pointer()
        entry = builder.inttoptr(arguments[0], shape)
        status, out = convention.call_function(builder, entry, kind, (kind,), [arguments[1]])
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return out

    return kind(kind, kind), code


def _copy_bytes(typing, into, source, size):
    """Copy bytes from one address to another."""

    def code(context, builder, given, arguments):
        byte = ir.IntType(8).as_pointer()
        target, origin = (builder.inttoptr(one, byte) for one in arguments[:2])
        cgutils.raw_memcpy(builder, target, origin, arguments[2], ir.IntType(64)(1))
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, types.int64), code


call_at: Any = intrinsic(_call_at)
copy_bytes: Any = intrinsic(_copy_bytes)
