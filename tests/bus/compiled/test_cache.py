"""The cache of kernels: compiled anew when anything changes that a kernel is made of."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

import bus
from bus.compiled import cache
from bus.compiled.cache import UNUSED_S
from bus.compiled.jit import compiled

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


TWICE = """
import sys, time
from pathlib import Path
from bus.compiled.cache import watch
from bus.compiled.jit import compiled

FACTOR = float(sys.argv[1])

def kernel_python(x):
    return FACTOR * x

kernel = compiled(kernel_python)
dump, told = kernel._cache._cache_file._dump, []

def wait_for_the_other(data):
    Path(sys.argv[1]).touch()
    until = time.monotonic() + 20.0
    while len(sys.argv) > 2 and not Path(sys.argv[2]).exists() and time.monotonic() < until:
        time.sleep(0.01)
    return dump(data)

kernel._cache._cache_file._dump = wait_for_the_other
with watch(told.append):
    print(kernel(2.0), *told)
"""


def test_processes_that_compile_variants_at_once_keep_both(tmp_path, monkeypatch):
    """Numba's own index gives both files one number: one of them then runs the other's code."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    tmp_path.joinpath("twice.py").write_text(TWICE)

    def start(*factors):
        command = [sys.executable, "-B", "twice.py", *factors]
        return subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)

    at_once = [start("3.0", "5.0"), start("5.0", "3.0")]
    said = [process.communicate()[0].split() for process in at_once]
    assert said == [["6.0", "kernel_python"], ["10.0", "kernel_python"]]
    assert [start(factor).communicate()[0].split() for factor in ("3.0", "5.0")] == [
        ["6.0"],
        ["10.0"],
    ]


def test_files_that_nobody_reads_go(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    tmp_path.joinpath("twice.py").write_text(TWICE)

    def run(factor):
        command = [sys.executable, "-B", "twice.py", factor]
        subprocess.run(command, cwd=tmp_path, capture_output=True, check=True)
        return set(tmp_path.glob("cache/**/*.nbc"))

    old = run("3.0")
    for file in old:
        os.utime(file, (0, time.time() - UNUSED_S - 60.0))
    used = run("4.0") - old
    assert len(used) == 1
    assert not any(file.exists() for file in old)
    for file in used:
        os.utime(file, (0, time.time() - UNUSED_S - 60.0))
    run("4.0")  # reads it
    assert run("6.0") > used


ORDERED = """
from typing import NamedTuple
import numpy as np
import order
from bus.compiled.jit import compiled

def kernel_python(data, among):
    return data.x[0] - data.y[0] + 10.0 * (among[0].x[0] - among[0].y[0])

kernel = compiled(kernel_python)
data = order.Data(x=np.array([3.0]), y=np.array([1.0]))
print(kernel(data, (data,)))
"""


def test_fields_of_a_named_tuple_may_change_places(tmp_path, monkeypatch):
    """Compiled code knows them by their places, and their types are the same."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    tmp_path.joinpath("ordered.py").write_text(ORDERED)
    said = []
    for first, second in (("x", "y"), ("y", "x")):
        fields = "".join(f"    {name}: np.ndarray\n" for name in (first, second))
        head = "from typing import NamedTuple\nimport numpy as np\nclass Data(NamedTuple):\n"
        tmp_path.joinpath("order.py").write_text(head + fields)
        command = [sys.executable, "-B", "ordered.py"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        said.append(done.stdout.strip())
    assert said == ["22.0", "22.0"]


@pytest.mark.parametrize("left", [0, 100])
def test_a_damaged_file_is_compiled_anew(left, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    tmp_path.joinpath("twice.py").write_text(TWICE)

    def run():
        command = [sys.executable, "-B", "twice.py", "3.0"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert run() == ["6.0", "kernel_python"]
    (file,) = tmp_path.glob("cache/**/*.nbc")
    file.write_bytes(file.read_bytes()[:left])
    assert run() == ["6.0", "kernel_python"]
    assert run() == ["6.0"]


def shift(values, by=1.0):
    return values + by


def test_every_part_of_the_key_counts(monkeypatch):
    """The machine's processor, how this package compiles, defaults, members, numba's version."""
    kernel = compiled(shift)
    codegen = kernel.targetctx.codegen()
    key = kernel._cache._index_key((), codegen)
    name = kernel._cache._cache_file._name(key)
    monkeypatch.setattr(type(codegen), "magic_tuple", lambda self: ("another", "processor"))
    assert kernel._cache._index_key((), codegen) != key
    monkeypatch.setattr(kernel._cache._cache_file, "_version", "another")
    assert kernel._cache._cache_file._name(key) != name
    before = cache.stamp(shift)
    monkeypatch.setattr(shift, "__defaults__", (2.0,))
    assert cache.stamp(shift) != before
    before = cache.stamp(shift)
    monkeypatch.setattr(cache, "_file_digest", lambda path: Path(path).name.encode())
    of_names = cache.stamp(shift)
    monkeypatch.setattr(
        cache, "_file_digest", lambda path: Path(path).name.replace("nested", "other").encode()
    )
    assert len({before, of_names, cache.stamp(shift)}) == 3
