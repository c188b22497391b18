"""Processes that need the same kernels at the same time: each kernel is compiled once."""

import errno
import fcntl
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

import bus
from bus.compiled import cache, places
from bus.compiled.jit import compiled
from tests.fixtures.patience import LONG_S

ROOT = Path(bus.__file__).parent.parent
KERNELS = 3
PROGRAM = f"""
import sys, time
from pathlib import Path
from bus.compiled.cache import watch
from bus.compiled.jit import compiled

def made(factor):
    def kernel_python(x):
        return factor * x
    kernel_python.__qualname__ = f"kernel_{{factor}}"
    return compiled(kernel_python)

def begun(name):
    names.append(name)
    Path(f"{{sys.argv[1]}}-{{name}}").touch()
    if sys.argv[2:] == [name]:
        time.sleep(3600.0)

names = []
kernels = [made(factor) for factor in range({KERNELS})]
Path(sys.argv[1]).touch()
while not Path("go").exists():
    time.sleep(0.001)
with watch(begun):
    results = [kernel(2.0) for kernel in kernels]
print(*results, *names)
"""
RESULTS = [str(2.0 * factor) for factor in range(KERNELS)]
NAMES = [f"kernel_{factor}" for factor in range(KERNELS)]


@pytest.fixture
def start(tmp_path):
    tmp_path.joinpath("program.py").write_text(PROGRAM)
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)
    }  # fmt: skip
    started = []

    def start(*arguments):
        started.append(subprocess.Popen(
            [sys.executable, "-B", "program.py", *arguments], cwd=tmp_path, env=environment,
            stdout=subprocess.PIPE, text=True,
        ))  # fmt: skip
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()


def until(path):
    end = time.monotonic() + LONG_S
    while not path.exists() and time.monotonic() < end:
        time.sleep(0.005)
    assert path.exists()


def test_processes_that_start_together_compile_each_kernel_once(start, tmp_path):
    processes = [start("first"), start("second")]
    for name in ("first", "second"):
        until(tmp_path / name)
    tmp_path.joinpath("go").touch()
    said = [process.communicate()[0].split() for process in processes]
    assert [words[:KERNELS] for words in said] == [RESULTS, RESULTS]
    assert sorted(said[0][KERNELS:] + said[1][KERNELS:]) == NAMES
    assert len(list(tmp_path.glob("cache/f3t-skin/*.nbc"))) == KERNELS
    assert not list(tmp_path.glob("cache/f3t-skin/*.lock"))


def test_a_process_that_is_killed_as_it_compiles_blocks_nobody(start, tmp_path):
    tmp_path.joinpath("go").touch()
    killed = start("killed", NAMES[1])
    until(tmp_path / f"killed-{NAMES[1]}")
    assert len(list(tmp_path.glob("cache/f3t-skin/*.lock"))) == 1
    other = start("other")
    until(tmp_path / "other")
    with pytest.raises(subprocess.TimeoutExpired):  # it waits
        other.wait(1.0)
    killed.kill()
    assert other.communicate()[0].split() == [*RESULTS, *NAMES[1:]]
    assert not list(tmp_path.glob("cache/f3t-skin/*.lock"))


def double(x):
    return 2.0 * x


def test_where_files_cannot_be_locked_kernels_are_compiled_and_kept(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(fcntl, "flock", refuse)
    assert compiled(double)(2.0) == 4.0
    assert len(list(places.written().glob("*.nbc"))) == 1
    monkeypatch.setattr(cache, "fcntl", None)
    assert compiled(double)(2) == 4.0
    assert len(list(places.written().glob("*.nbc"))) == 2


def test_a_kernel_that_cannot_be_compiled_releases_its_lock(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    kernel = compiled(double)
    with pytest.raises(Exception, match="mul"):
        kernel("two")
    assert not list(places.written().glob("*.lock"))
    assert kernel(2.0) == 4.0
