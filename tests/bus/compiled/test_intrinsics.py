"""Functions of arrays and of single numbers in kernels: the same numbers, of the same type."""

from __future__ import annotations

import numpy as np
import pytest

from bus.compiled.intrinsics import above_zero, choose, lesser
from bus.compiled.jit import compiled

VALUES = np.array([-np.inf, -2.5, -0.0, 0.0, 1e-40, 0.5, 3.0, np.inf, np.nan])


def each_python(x, y, out):
    for i in range(x.size):
        out[0, i] = above_zero(x[i])
        out[1, i] = lesser(x[i], y[i])
        out[2, i] = choose(x[i] > y[i], x[i], y[i])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_numbers_of_a_kernel_are_those_of_arrays(dtype):
    x, y = (a.ravel().astype(dtype) for a in np.meshgrid(VALUES, VALUES))
    out = np.empty((3, x.size), dtype)
    compiled(each_python)(x, y, out)
    known = ~(np.isnan(x) | np.isnan(y))
    np.testing.assert_array_equal(out[0, known], np.where(x > 0, x, 0)[known])
    np.testing.assert_array_equal(out[1, known], np.where(x < y, x, y)[known])
    np.testing.assert_array_equal(out[2], np.where(x > y, x, y))
    for row, array in zip(out, (above_zero(x), lesser(x, y), choose(x > y, x, y)), strict=True):
        assert array.dtype == dtype
        np.testing.assert_array_equal(row[known], array[known])


def test_single_numbers_stay_numbers_in_python():
    assert above_zero(-1.0) == 0.0
    assert lesser(2.0, 1.0) == 1.0
    chosen = choose(np.float32(1.0) > 0.0, np.float32(3.0), np.float32(4.0))
    assert isinstance(chosen, np.float32)
    assert chosen == 3.0
