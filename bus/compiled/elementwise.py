"""Functions of arrays that kernels call with single numbers: so that one formula serves both.

In Python each is numpy's and broadcasts; in a kernel it is the comparison of two numbers, without
numpy's care for NaN, which would cost a vector loop several instructions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import overload

__all__ = ["above_zero", "anywhere", "choose", "lesser"]


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
