"""Bound kernels called by other kernels: by address, so that it is the same machine code.

A kernel that calls others is compiled together with them, which takes long, and lets the compiler
order their arithmetic in another way. A chained call is of any `Bound`, however it was compiled,
and gives the same numbers to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic, overload

from bus.compiled import nested
from bus.compiled.bound import Bound

try:
    from llvmlite import ir
    from numba.core import cgutils
except ImportError:  # numba or llvmlite of another version
    ir: Any = None
    cgutils: Any = None

__all__ = ["address", "addresses", "call", "copy_bytes", "words"]


def address(bound: object) -> np.ndarray | None:
    """Where a bound kernel is called: of a function of one number, and that number.

    Parameters
    ----------
    bound : Bound
        Kept by the caller, as its arguments are read by address.

    Returns
    -------
    ndarray, shape (2,), int64, or None
        None where numba has no address, and of what is no `Bound`.
    """
    if not isinstance(bound, Bound):
        return None
    bound.ready()
    return None if bound.entry is None else np.array([bound.entry, words(bound).ctypes.data])


def addresses(calls: Sequence[object]) -> np.ndarray | None:
    """Where bound kernels are called, for `call`.

    Parameters
    ----------
    calls : sequence of Bound or None

    Returns
    -------
    ndarray, shape (m, 2), int64, or None
        Zeros for None; None where one of the others has no address.
    """
    found = [np.zeros(2, np.int64) if one is None else address(one) for one in calls]
    if any(one is None for one in found):
        return None
    return np.array(found, np.int64).reshape(-1, 2)


def call(calls: Any, which: Any) -> int:
    """Call one of some bound kernels.

    Parameters
    ----------
    calls : ndarray or sequence of callable
        What `addresses` gave; in Python the kernels themselves.
    which : int

    Returns
    -------
    int
        Its result: 0 for none, and truth values as bits from the lowest up.
    """
    found = calls[which]()
    if isinstance(found, tuple):
        return int(found[0]) | int(found[1]) << 1
    return int(found) if isinstance(found, int | np.integer | np.bool_) else 0


def words(bound: Bound) -> np.ndarray:
    """What the call of a bound kernel reads its arguments from, int64, to be written by who calls
    it by its `address`: a number among them may be another one in the next call."""
    found = bound._words
    assert found is not None  # it has no address otherwise
    return found


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


def _call_one(calls, which):
    return call_at(calls[which, 0], calls[which, 1])


def _in_kernels(python: Callable[..., Any], compiled: Callable[..., Any]) -> None:
    """Let kernels run another function in place of one of Python."""
    options: Any = {} if nested.pipeline is None else {"pipeline_class": nested.pipeline}

    @overload(python, jit_options=options, strict=False)
    def _overload(*_arguments: object) -> Callable[..., Any]:
        return compiled


_in_kernels(call, _call_one)
