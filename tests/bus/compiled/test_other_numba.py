"""A numba without the private parts that bus.compiled stands on: slower, and the same results."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit

import bus
from bus.compiled import bound
from bus.compiled.bound import Bound, direct

ROOT = Path(bus.__file__).parent.parent
PROGRAM = """
import sys

import numba
import numba.core.compiler
import numba.core.serialize
import llvmlite
import numpy as np

back = []
for name in sys.argv[1:]:
    # of modules that are imported already; numba itself gets them back, as it imports some late
    module, _, attribute = name.rpartition(".")
    if name in sys.modules:
        back.append((sys.modules.__setitem__, name, sys.modules[name]))
        sys.modules[name] = None
    if module in sys.modules:
        holder = sys.modules[module]
        back.append((setattr, holder, attribute, getattr(holder, attribute)))
    else:  # a class
        module, _, kind = module.rpartition(".")
        holder = getattr(sys.modules[module], kind)
    delattr(holder, attribute)

from bus.compiled.bound import Bound, direct
from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import compiled, jitable
from bus.compiled import nested

for function, *arguments in back:
    function(*arguments)

@jitable(inline=True)
def law(x):
    return 3.0 * x

def weigh_python(values, out):
    assume_noalias()
    for i in range(values.size):
        out[i] = law(values[i])

weigh = compiled(weigh_python, fastmath=["contract"])
values, out, other = np.arange(5.0), np.zeros(5), np.zeros(5)
call = Bound(weigh, values, out)
call()
call.put(1, other)
call()
direct(weigh)(values, values)
print(call._words is not None, weigh._cache.__class__.__name__, nested.pipeline is not None)
print(*out, *other, *values)
"""
NUMBERS = 3 * "0.0 3.0 6.0 9.0 12.0 "


@pytest.mark.parametrize(
    ("removed", "is_bound", "is_cached", "is_nested"),
    [
        ([], True, True, True),
        pytest.param(["numba.core.serialize"], True, False, True, marks=pytest.mark.long),
        pytest.param(
            ["numba.core.compiler.CompileResult"], True, False, True, marks=pytest.mark.long
        ),
        (["numba.core.compiler.CompileResult._reduce"], True, False, True),
        (["numba.core.cgutils"], False, True, True),
        pytest.param(["numba.core.errors"], False, True, True, marks=pytest.mark.long),
        pytest.param(["llvmlite.ir"], False, True, True, marks=pytest.mark.long),
        pytest.param(["numba.extending.lower_builtin"], True, True, True, marks=pytest.mark.long),
        pytest.param(["numba.extending.type_callable"], True, True, True, marks=pytest.mark.long),
        (["numba.core.typed_passes.NativeLowering"], False, True, False),
        pytest.param(["numba._dynfunc"], False, True, False, marks=pytest.mark.long),
    ],
    ids=lambda value: ",".join(value) or "nothing" if isinstance(value, list) else None,
)
def test_without_private_parts_kernels_give_the_same(
    removed, is_bound, is_cached, is_nested, tmp_path, monkeypatch
):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    command = [sys.executable, "-B", program, *removed]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    found, numbers = done.stdout.splitlines()
    assert numbers == NUMBERS.strip()
    assert found == f"{is_bound} {'KernelCache' if is_cached else 'NullCache'} {is_nested}"


def test_a_kernel_that_does_not_tell_where_it_lies_is_called_as_it_is(monkeypatch):
    def refuse(signature):
        raise AttributeError("no call_conv here")

    monkeypatch.setattr(bound, "_caller", refuse)

    @njit
    def double(values, out):
        out[:] = 2.0 * values

    out, other = np.zeros(3), np.zeros(3)
    call = Bound(double, np.arange(3.0), out)
    call()
    call.put(1, other)
    call()
    assert out.tolist() == other.tolist() == [0.0, 2.0, 4.0]
    assert call._words is None


def test_without_an_entry_point_the_dispatcher_is_called():
    kernel = SimpleNamespace(overloads={"any": SimpleNamespace()})
    assert direct(kernel) is kernel
