"""Calls of kernels whose arguments stay the same.

Numba looks at every argument of a call anew: some 60 ns for each array, which for a kernel with
twenty of them is as long as its work on a hundred units. Here they are looked at once and written
down as the words that the compiled function takes, addresses among them; a call then has one
argument. It stands on the insides of numba: how a function takes its arguments, and where it lies.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator

import numpy as np
from llvmlite import ir
from numba import njit, typeof, types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["Bound"]

WORD = ir.IntType(64)
DATA = 4
"""Which of an array's words is the address of its data."""
_callers: dict[object, Callable] = {}


class Bound(functools.partial):
    """A kernel and its arguments, as a function without any.

    It is a partial of the compiled function, so that Python runs no line of its own in a call.

    Parameters
    ----------
    kernel : callable
        Made by `numba.njit`; anything else is called as it is (NUMBA_DISABLE_JIT).
    *arguments
        Arrays, whole numbers, truth values, None, and tuples of these. What a kernel is to be told
        anew with every call stands in an array.

    Attributes
    ----------
    arguments : list
        Kept, as a call reads and writes them by address.
    """

    def __new__(cls, kernel: Callable, *arguments: object) -> Bound:
        kept = list(arguments)
        if not hasattr(kernel, "overloads"):
            self = super().__new__(cls, lambda: kernel(*kept))
            self.arguments, self._words = kept, None
            return self
        kinds = tuple(typeof(argument) for argument in arguments)
        kernel.compile(kinds)
        compiled = kernel.overloads[kinds]
        words = [compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)]
        places = []
        for kind, argument in zip(kinds, arguments, strict=True):
            places.append(len(words))
            words += _words(kind, argument)
        kept_words = np.array(words, np.int64)
        self = super().__new__(cls, _caller(compiled.signature), kept_words.ctypes.data)
        self.arguments, self._words, self._places = kept, kept_words, places
        self._kernel = kernel  # or its code would go with it
        return self

    def put(self, position: int, argument: np.ndarray) -> None:
        """Exchange an array for another of the same type, shape and strides, for which the caller
        answers."""
        self.arguments[position] = argument
        if self._words is not None:
            self._words[self._places[position] + DATA] = argument.__array_interface__["data"][0]

    def __reduce__(self) -> str:
        raise TypeError("a bound kernel knows the addresses of its arrays: it cannot be copied")


def _words(kind: types.Type, value: object) -> list[int]:
    """A value as the words that `_value` reads."""
    if isinstance(kind, types.Array):
        # neither a reference count nor an owner: both are the arguments' that are kept
        return [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]
    if isinstance(kind, types.BaseTuple):
        return [word for part in zip(kind, value, strict=True) for word in _words(*part)]
    if isinstance(kind, types.NoneType):
        return []
    if isinstance(kind, types.Integer | types.Boolean):
        return [int(value)]
    raise TypeError(f"a bound kernel takes no {kind}")


def _value(context, builder, kind: types.Type, words: Iterator[ir.Value]) -> ir.Value:
    """A value of a kind in compiled code, from its words."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder)
        model = context.data_model_manager[kind]
        for name in ("meminfo", "parent", "nitems", "itemsize", "data", "shape", "strides"):
            of = model.get_member_fe_type(name)
            member = next(words) if not isinstance(of, types.BaseTuple) else _value(
                context, builder, of, words)  # fmt: skip
            if name in ("meminfo", "parent", "data"):
                member = builder.inttoptr(member, context.get_value_type(of))
            setattr(array, name, member)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        parts = [_value(context, builder, part, words) for part in kind]
        return context.make_tuple(builder, kind, parts)
    if isinstance(kind, types.NoneType):
        return context.get_dummy_value()
    if isinstance(kind, types.Boolean):
        return builder.icmp_unsigned("!=", next(words), WORD(0))
    return next(words)


def _caller(signature) -> Callable:
    """The compiled function that calls any function of a signature, given where that function's
    address and, after it, its arguments stand."""
    key = signature.return_type, signature.args
    if key in _callers:
        return _callers[key]
    result, kinds = key

    @intrinsic
    def call_address(typing, place):
        def code(context, builder, given, arguments):
            base = builder.inttoptr(arguments[0], WORD.as_pointer())
            words = (
                builder.load(builder.gep(base, [WORD(i)])) for i in range(2**31)
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

    @njit([(types.int64,)], nogil=True)
    def call(place):
        return call_address(place)

    (compiled,) = call.overloads.values()
    _callers[key] = compiled.entry_point
    return compiled.entry_point
