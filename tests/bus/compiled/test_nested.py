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
