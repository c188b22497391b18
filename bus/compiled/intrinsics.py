"""What numba has no words for: a hint for the compiler, and an order of what is written for other
processes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from threading import Lock
from typing import Any

import numpy as np
from numba import types
from numba.extending import lower_builtin, overload, type_callable

__all__ = ["above_zero", "anywhere", "assume_noalias", "choose", "lesser", "publish"]

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


# -- functions of arrays that kernels call with single numbers: one formula serves both ------------
#
# In Python each is numpy's and broadcasts; in a kernel it is the comparison of two numbers, without
# numpy's care for NaN, which would cost a vector loop several instructions.


def above_zero(x: Any) -> Any:
    """`x` where it is above 0, else 0: max(x, 0)."""
    return np.maximum(x, 0.0)


def lesser(x: Any, y: Any) -> Any:
    """The lesser of two: min(x, y)."""
    return np.minimum(x, y)


def anywhere(condition: Any) -> Any:
    """Whether a condition holds anywhere; in a kernel, the condition."""
    return bool(np.any(condition))


def choose(condition: Any, yes: Any, no: Any) -> Any:
    """`yes` where a condition holds, else `no`; both are evaluated."""
    return np.where(condition, yes, no)[()]


def _in_kernels(of_arrays: Callable[..., Any], of_numbers: Callable[..., Any]) -> None:
    """Let kernels run another function in place of one of arrays; its code is put into theirs."""

    @overload(of_arrays, jit_options={"forceinline": True}, strict=False)
    def _overload(*_arguments: object) -> Callable[..., Any]:
        return of_numbers


def _number_above_zero(x):
    return max(x, type(x)(0.0))


def _lesser_number(x, y):
    return min(x, y)


def _of_number(condition):
    return condition


def _chosen_number(condition, yes, no):
    return yes if condition else no


_in_kernels(above_zero, _number_above_zero)
_in_kernels(lesser, _lesser_number)
_in_kernels(anywhere, _of_number)
_in_kernels(choose, _chosen_number)
