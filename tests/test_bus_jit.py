"""What numba's cache goes by: a kernel is compiled anew when a file changes that it calls into."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import bus
import skin

ROOT = Path(bus.__file__).parent.parent
CALLER = """
from numba import njit
import called
from bus.jit import stamp

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


@pytest.mark.parametrize("name", ["decode/kernels.py", "contact/step_kernel.py"])
def test_a_stamp_is_of_every_file_of_its_room_that_the_kernel_imports(name):
    file = Path(skin.__file__).parent / name
    tree = ast.parse(file.read_text())
    room = f"skin.{file.parent.name}"
    imported = {
        module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(room)
        for module in (
            [alias.name for alias in node.names] if node.module == room
            else [node.module.rsplit(".", 1)[1]]
        )
    }  # fmt: skip
    (call,) = (
        node for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "stamp"
    )  # fmt: skip
    stamped = {argument.id for argument in call.args}
    assert imported
    assert imported <= stamped
