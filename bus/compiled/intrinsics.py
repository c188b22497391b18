"""What numba has no words for: a hint for the compiler, and an order of what is written for other
processes."""

from __future__ import annotations

from contextlib import suppress
from threading import Lock

import numpy as np
from numba import types
from numba.extending import lower_builtin, type_callable

__all__ = ["assume_noalias", "publish"]

_barrier = Lock()


def assume_noalias() -> None:
    """Promise the compiler that no two arrays of the calling kernel overlap.

    It would ask at run time, for every pair of them, and beyond a few pairs give up vectors. A
    kernel with so many arrays is also better off with the widest vectors that there are, which the
    compiler avoids on most processors for the sake of code that needs them now and then.
    """


def publish(count: np.ndarray, value: int) -> None:
    """Write a number into the first element of an array of int64, shape (1,), once all that was
    written before can be seen by whoever sees it, another process among them."""
    with _barrier:
        count[0] = value


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


@type_callable(publish)
def _publish_type(context):
    return lambda count, value: types.none(count, types.int64)


@lower_builtin(publish, types.Array, types.Integer)
def _publish_code(context, builder, signature, arguments):
    view = context.make_array(signature.args[0])(context, builder, arguments[0])
    builder.store_atomic(arguments[1], view.data, ordering="release", align=8)
    return context.get_dummy_value()
