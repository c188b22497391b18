"""The cache of kernels: compiled anew when anything changes that a kernel is made of."""

import subprocess
import sys
from pathlib import Path

import bus

ROOT = Path(bus.__file__).parent.parent
CALLER = """
from bus.compiled.cache import watch
from bus.compiled.jit import compiled
import called
from constants import SHIFT

def kernel_python(x):
    return called.law(x) + SHIFT

kernel = compiled(kernel_python)
told = []
with watch(told.append):
    print(kernel(2.0), *told)
"""
CALLED = """
from bus.compiled.jit import jitable
from deeper import FACTORS

@jitable
def law(x):
    return FACTORS[1] * x
"""


def test_a_changed_constant_is_compiled_anew_wherever_it_stands(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    tmp_path.joinpath("caller.py").write_text(CALLER)
    tmp_path.joinpath("called.py").write_text(CALLED)
    said = []
    for factor, shift in ((3.0, 0.0), (3.0, 0.0), (5.0, 0.0), (5.0, 1.0), (5.0, 1.0)):
        tmp_path.joinpath("deeper.py").write_text(f"FACTORS = (1.0, {factor})")
        tmp_path.joinpath("constants.py").write_text(f"SHIFT = {shift}")
        command = [sys.executable, "-B", "caller.py"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        said.append(done.stdout.split())
    assert said == [
        ["6.0", "kernel_python"],
        ["6.0"],
        ["10.0", "kernel_python"],
        ["11.0", "kernel_python"],
        ["11.0"],
    ]
