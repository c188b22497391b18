"""Kernels that are bound together are compiled by several processes, each once."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import bus
from bus.compiled import cache, pool
from bus.compiled.bound import Bound, ready_all
from bus.compiled.chained import address
from bus.compiled.jit import compiled

ROOT = Path(bus.__file__).parent.parent
MODULE = """
import functools, os, pathlib
import numpy as np
from bus.compiled.jit import compiled

def double_python(x):
    x[0] = 2.0 * x[0]

def halve_python(x):
    x[0] = 0.5 * x[0]

double, halve = compiled(double_python), compiled(halve_python)

@functools.cache
def scale(factor):
    def scale_python(x):
        x[0] = factor * x[0]
    return compiled(scale_python, made_by=("scale", factor))

def refuse_python(x):
    x[0] = "a word"

refuse = compiled(refuse_python)
if os.environ.get("DIES") and os.environ["DIES"] != str(os.getpid()):
    os._exit(3)
"""
PROGRAM = """
import os, sys
from contextlib import suppress
if sys.argv[2:]:
    os.environ["DIES"] = str(os.getpid())
import numpy as np
import kernels
from bus.compiled import pool
from bus.compiled.bound import Bound
from bus.compiled.cache import watch

pool.PACKAGES.add("kernels")
here = []
compile_here = kernels.double._cache.save_overload.__func__
def save(self, sig, cres):
    here.append(self.name)
    compile_here(self, sig, cres)
type(kernels.double._cache).save_overload = save

known, begun, done = {}, [], []
x = np.ones(1)
with watch(begun.append, done.append, known.__setitem__), pool.together(int(sys.argv[1])):
    calls = [Bound(kernel, x) for kernel in (
        kernels.double, kernels.halve, kernels.scale(3.0), kernels.scale(5.0))]
    assert not here or sys.argv[1] == "1"
    refused = None
    with suppress(Exception):
        refused = Bound(kernels.refuse, x)
        refused()
    for call in calls:
        call()
times = begun.count("double_python")  # once more after a process that died of it
assert times == 1 or (times == 2 and sys.argv[2:])
own = [name for name in done if "_caller" not in name and "refuse" not in name]
assert set(own) <= set(known)
print(x[0], len(own), len(set(own)), sum("_caller" not in name for name in here))
"""


@pytest.fixture
def run(tmp_path):
    tmp_path.joinpath("kernels.py").write_text(MODULE)
    tmp_path.joinpath("program.py").write_text(PROGRAM)

    def run(*arguments, place="cache"):
        environment = os.environ | {
            "NUMBA_CACHE_DIR": str(tmp_path / place), "PYTHONPATH": str(ROOT)
        }  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-B", "program.py", *arguments], cwd=tmp_path, env=environment,
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        files = [file.name for file in tmp_path.glob(f"{place}/f3t-skin/*.nbc")]
        assert sum("_caller" not in name for name in files) == 4
        product, *counts = done.stdout.split()
        assert product == "15.0"
        return [int(count) for count in counts]

    return run


def test_each_kernel_is_compiled_once_and_not_all_of_them_here(run):
    done, kernels, here = run("3")
    assert (done, kernels) == (4, 3)  # two have one name
    assert here < 4


def test_alone_a_process_compiles_all_itself(run):
    assert run("1") == [4, 3, 4]


def test_processes_that_die_cost_no_kernel(run):
    _, kernels, here = run("3", "die")
    assert kernels == 3
    assert here == 4


def double_python(x):
    x[0] = 2.0 * x[0]


double = compiled(double_python)


def test_no_process_is_started_for_what_is_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    def refuse(*_, **__):
        raise AssertionError("a process was started")

    monkeypatch.setattr(pool, "PACKAGES", {__name__.partition(".")[0]})
    compiled(double_python)(x := np.ones(1))
    monkeypatch.setattr(subprocess, "Popen", refuse)
    monkeypatch.setattr(double, "overloads", {})
    with pool.together(4) as found:
        assert double._cache.holds((), double.targetctx.codegen()) is False
        call = Bound(double, x)
        assert not found._threads
    call()
    assert x[0] == 4.0


def test_what_no_other_process_can_find_is_compiled_here(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    x = np.ones(1)

    def treble(x):
        x[0] = 3.0 * x[0]

    kernel = compiled(treble)
    assert pool.job_of(kernel, ()) is None
    with pool.together(4):
        call = Bound(kernel, x)
    call()
    assert x[0] == 3.0


def test_a_queued_kernel_is_ready_once_its_address_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(pool, "PACKAGES", {__name__.partition(".")[0]})
    monkeypatch.setattr(pool.Pool, "_serve", lambda self: None)  # nobody helps
    fresh, x = compiled(double_python), np.ones(1)
    monkeypatch.setattr(sys.modules[__name__], "double", fresh)
    with pool.together(4):
        call, other = Bound(fresh, x), np.full(1, 5.0)
        call.put(0, other)
        assert not fresh.overloads
        assert address(call) is not None
        assert fresh.overloads
    call()
    assert (x[0], other[0]) == (1.0, 10.0)


def test_all_that_is_queued_can_be_had_before_the_first_call(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(pool, "PACKAGES", {__name__.partition(".")[0]})
    monkeypatch.setattr(pool.Pool, "_serve", lambda self: None)
    fresh, x = compiled(double_python), np.ones(1)
    monkeypatch.setattr(sys.modules[__name__], "double", fresh)
    with pool.together(4):
        call = Bound(fresh, x)
        assert not fresh.overloads
        ready_all()
        assert fresh.overloads
    call()
    assert x[0] == 2.0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs forks")
def test_a_forked_process_compiles_for_itself(monkeypatch):
    with pool.together(4) as found:
        monkeypatch.setattr(os, "getpid", lambda: -1)
        found.wait(double, ())
        assert not found.submit(double, ())


def test_what_is_watched_is_said_of_other_processes_as_well():
    heard = []
    with cache.watch(lambda name: heard.append((1, name)), lambda name: heard.append((2, name))):
        with cache.reporting("far"):
            heard.append((0, "between"))
    assert heard == [(1, "far"), (0, "between"), (2, "far")]


def test_what_takes_longest_is_begun_first_here_as_well(monkeypatch):
    begun = []

    def prepare(kernel, kinds):
        begun.append(kernel)
        raise TypeError("who needs it meets it")

    monkeypatch.setattr(pool, "_prepare", prepare)
    found, kinds = pool.Pool(2), ()
    own = pool.Job(__name__, "double", None, kinds)
    monkeypatch.setattr(pool, "job_of", lambda *given: own)
    jobs = [own._replace(name=name) for name in ("long", "short")]
    found._queue = [(300, jobs[0], "long"), (200, own, double), (100, jobs[1], "short")]
    found.wait(double, kinds)
    assert begun == ["long"]
    assert [one[2] for one in found._queue] == ["short"]
    found.wait(double, kinds)  # compiled by now
    assert begun == ["long"]
