"""What numba's cache goes by: a kernel is compiled anew when a file changes that it calls into."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import bus

ROOT = Path(bus.__file__).parent.parent
CALLER = """
from numba import njit
import called
from bus.compiled.jit import stamp

def make(sources):
    def kernel(x):
        assert sources
        return called.law(x)
    return kernel

kernel = njit(cache=True)(make(stamp(called)))
print(kernel(2.0), sum(kernel.stats.cache_hits.values()))
"""
CALLED = """
from numba.extending import register_jitable

@register_jitable
def law(x):
    return {factor} * x
"""


def test_a_changed_file_is_compiled_anew(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    tmp_path.joinpath("caller.py").write_text(CALLER)
    said = []
    for factor in (3.0, 3.0, 5.0):
        tmp_path.joinpath("called.py").write_text(CALLED.format(factor=factor))
        command = [sys.executable, "-B", "caller.py"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        said.append(done.stdout.split())
    assert said == [["6.0", "0"], ["6.0", "1"], ["10.0", "0"]]


def imports(file):
    """Files of ours that a file imports from."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            inside = ROOT.joinpath(*node.module.split("."))
            files = [inside.with_suffix(".py"), *(inside / f"{n.name}.py" for n in node.names)]
            found |= {file for file in files if file.exists()}
    return found


@pytest.mark.parametrize("name", ["decode/kernels.py", "contact/step_kernel.py"])
def test_a_stamp_is_of_every_file_that_a_kernel_stands_on(name):
    file = ROOT / "skin" / name
    reached, new = set(), imports(file)
    while new:
        reached |= new
        new = set().union(*map(imports, new)) - reached
    (call,) = (
        node for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "stamp"
    )  # fmt: skip
    assert {argument.id for argument in call.args} == {file.stem for file in reached}
