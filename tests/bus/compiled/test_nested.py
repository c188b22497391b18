"""Functions that only kernels call: the same results, and no machine code of their own."""

import numpy as np
import pytest

from bus.compiled import jit, nested

needs = pytest.mark.skipif(nested.pipeline is None, reason="numba of another version")


def kernel_of(monkeypatch, pipeline):
    """A kernel of three levels, compiled with or without `pipeline`."""
    monkeypatch.setattr(nested, "pipeline", pipeline)

    @jit.jitable
    def root(x):
        if x < 0.0:
            raise ValueError("below 0")
        return np.sqrt(x)

    @jit.jitable(inline=True)
    def norm(a):
        total = 0.0
        for value in a:
            total += value * value
        return root(total)

    def norms_python(a, out):
        parts = np.empty_like(a)
        for i in range(a.shape[0]):
            parts[i] = 2.0 * a[i]
            out[i] = norm(parts[i])
        return root(a[0, 0])

    return jit.compiled(norms_python, cache=False)


@needs
def test_nested_functions_give_what_numba_gives_without(monkeypatch):
    a = np.random.default_rng(1).normal(size=(50, 3))
    a[0, 0] = 4.0
    own, plain = np.zeros(50), np.zeros(50)
    assert kernel_of(monkeypatch, nested.pipeline)(a, own) == 2.0
    assert kernel_of(monkeypatch, None)(a, plain) == 2.0
    np.testing.assert_array_equal(own, plain)
    np.testing.assert_allclose(own, 2.0 * np.linalg.norm(a, axis=1), rtol=1e-14)


@needs
def test_an_error_within_a_nested_function_reaches_python(monkeypatch):
    kernel = kernel_of(monkeypatch, nested.pipeline)
    with pytest.raises(ValueError, match="below 0"):
        kernel(-np.ones((2, 3)), np.zeros(2))


@needs
def test_errors_with_arguments_and_print_work_in_nested_functions(capfd):
    @jit.jitable
    def refuse(i):
        if i > 2:
            raise ValueError("too many", i)
        print("fine", i)
        return i

    def kernel_python(i):
        return refuse(i) + 1

    kernel = jit.compiled(kernel_python, cache=False)
    assert kernel(2) == 3
    assert capfd.readouterr().out == "fine 2\n"
    with pytest.raises(ValueError, match="'too many', 3"):
        kernel(3)


@needs
def test_machine_code_is_made_of_the_kernel_alone(monkeypatch):
    made = []
    context = jit.njit(lambda: 0).targetctx
    real = type(context).get_executable

    def get_executable(self, library, fndesc, env):
        made.append(fndesc.qualname.rpartition(".")[2])
        return real(self, library, fndesc, env)

    monkeypatch.setattr(type(context), "get_executable", get_executable)
    kernel_of(monkeypatch, nested.pipeline)(np.ones((2, 3)), np.zeros(2))
    assert "norms_python" in made
    assert {"norm", "root"}.isdisjoint(made)
    made.clear()
    kernel_of(monkeypatch, None)(np.ones((2, 3)), np.zeros(2))
    assert {"norm", "root"} < set(made)


def tails_python(values, first, out):
    for j in range(out.size):
        out[j] = values[first[0] + j]
    return values[-1] + np.flip(values)[-1]


@needs
def test_indices_count_from_the_front_but_for_constants(monkeypatch):
    """What adds the length to a negative index is gone: it keeps loops from being vectors."""
    values, first = np.arange(10.0), np.array([3])
    choices = {}
    for name, known in (("own", nested.OF_INDEX), ("another version", ())):
        monkeypatch.setattr(nested, "OF_INDEX", known)
        kernel, out = jit.compiled(tails_python, cache=False), np.zeros(4)
        assert kernel(values, first, out) == 9.0
        assert out.tolist() == [3.0, 4.0, 5.0, 6.0]
        (code,) = kernel.inspect_llvm().values()
        choices[name] = code.count(" select ")
    assert choices["own"] < choices["another version"]


@needs
def test_checked_kernels_refuse_an_index_from_the_end():
    kernel = jit.compiled(tails_python, cache=False, boundscheck=True)
    assert kernel(np.arange(10.0), np.array([6]), np.zeros(4)) == 9.0
    for first in (-1, 7):
        with pytest.raises(IndexError, match="out of bounds"):
            kernel(np.arange(10.0), np.array([first]), np.zeros(4))
