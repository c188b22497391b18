"""Hints for the compiler that numba has no words for; in Python, and in a numba without its private
parts, they do nothing."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from numba import types
from numba.extending import register_jitable

try:
    from llvmlite import ir
    from numba.extending import lower_builtin, type_callable
except ImportError:  # numba or llvmlite of another version
    ir: Any = None

__all__ = ["assume_noalias", "prefetch"]


def assume_noalias() -> None:
    """Tell the compiler that no two arrays of the calling kernel overlap.

    It would ask at run time, for every pair of them, and beyond a few pairs give up vectors. A
    kernel with so many arrays is also better off with the widest vectors that there are, which the
    compiler avoids on most processors for the sake of code that needs them now and then.
    """


def prefetch(array: np.ndarray, index: int) -> None:
    """Begin to fetch the cache line of an element of a 1-D array, which may lie beyond its end."""


def _tell_compiler() -> None:
    """Teach numba both hints."""

    @type_callable(assume_noalias)
    def _noalias_type(context):
        return lambda: types.none

    @lower_builtin(assume_noalias)
    def _noalias_code(context, builder, signature, arguments):
        with suppress(AttributeError):  # llvmlite of another version
            for argument in builder.function.args:
                if argument.type.is_pointer:
                    argument.add_attribute("noalias")
            # llvmlite's own `add` knows only the attributes that have no value.
            set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    @type_callable(prefetch)
    def _prefetch_type(context):
        return lambda array, index: types.none(array, types.intp)

    @lower_builtin(prefetch, types.Array, types.Integer)
    def _prefetch_code(context, builder, signature, arguments):
        with suppress(AttributeError):
            view = context.make_array(signature.args[0])(context, builder, arguments[0])
            byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
            kind = ir.FunctionType(ir.VoidType(), [byte, word, word, word])
            name = "llvm.prefetch.p0i8"
            fetch = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
            place = builder.bitcast(builder.gep(view.data, [arguments[1]]), byte)
            to_read, nearest, data = word(0), word(3), word(1)
            builder.call(fetch, [place, to_read, nearest, data])
        return context.get_dummy_value()


if ir is None:
    for hint in (assume_noalias, prefetch):
        register_jitable(hint)
else:
    _tell_compiler()
