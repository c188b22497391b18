"""How kernels are compiled, bound and told apart."""

from __future__ import annotations

import numpy as np
import pytest

from bus.compiled.jit import bound, compiled, direct
from tests.fixtures.compiling import watch


def scale_python(x, factor, out):
    for i in range(x.size):
        out[i] = factor * x[i]


scale = compiled(scale_python)
COMPILED = hasattr(scale, "compile")
needs_compiler = pytest.mark.skipif(not COMPILED, reason="kernels are interpreted")


def test_a_bound_kernel_reads_its_arrays_as_they_are_at_each_call():
    x, out = np.arange(3.0), np.zeros(3)
    call = bound(scale, x, 2.0, out)
    call()
    assert out.tolist() == [0.0, 2.0, 4.0]
    x[:] = 1.0
    call()
    assert out.tolist() == [2.0, 2.0, 2.0]


@needs_compiler
def test_a_bound_kernel_is_compiled_for_its_types_at_once_and_no_other_is():
    kernel, named = compiled(scale_python), []
    x = np.zeros(3, np.float32)
    with watch(named.append):
        bound(kernel, x, 2.0, x)
    assert [str(one[0]) for one in kernel.signatures] == ["array(float32, 1d, C)"]
    assert direct(kernel) is direct(kernel, x, 2.0, x)


def test_what_is_no_kernel_is_called_as_it_is():
    assert bound(max, 2, 3)() == 3
    assert direct(max) is max


def test_fast_math_that_would_delete_tests_for_nan_is_refused():
    with pytest.raises(ValueError, match="fastmath: must be of 'contract', 'reassoc', 'arcp'"):
        compiled(scale_python, fastmath={"nnan"})


def test_divisions_are_those_of_numpy():
    def divide_python(x):
        return x[0] / x[1]

    with np.errstate(divide="ignore"):
        assert compiled(divide_python)(np.array([1.0, 0.0])) == np.inf
