"""The cache of kernels: compiled anew when anything changes that a kernel is made of."""

import gc
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import bus
from bus.compiled import cache, places, stamps
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
    for factor, shift in ((3.0, 0.0), (3.0, 0.0), (5.0, 0.0), (5.0, 1.0)):
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
save, told = kernel._cache._save, []

def wait_for_the_other(*given):
    Path(sys.argv[1]).touch()
    until = time.monotonic() + 20.0
    while len(sys.argv) > 2 and not Path(sys.argv[2]).exists() and time.monotonic() < until:
        time.sleep(0.01)
    save(*given)

kernel._cache._save = wait_for_the_other
with watch(told.append):
    print(kernel(2.0), *told)
"""


@pytest.mark.long
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


VARIANTS = """
import sys
import numpy as np
from bus.compiled.bound import Bound
from bus.compiled.jit import compiled, jitable

def made(factor):
    @jitable
    def law(x):
        total = x
        for i in range(50):
            for j in range(50):
                total = total + np.sin(total + i) * np.cos(total - j)
        return 0.0 * total + factor * x
    def kernel_python(out):
        out[0] = law(1.0) + 0.0 * law(2.0) + 0.0 * law(3.0)
    return compiled(kernel_python)

kernels = {factor: made(float(factor)) for factor in sys.argv[1:]}
for kernel in kernels.values():
    kernel(np.zeros(1))
for factor, kernel in kernels.items():
    once, again = np.zeros(1), np.zeros(1)
    Bound(kernel, once)()
    kernel(again)
    print(once[0] == again[0] == float(factor))
"""


@pytest.mark.long
def test_variants_that_several_processes_have_compiled_first_are_not_mixed_up(
    tmp_path, monkeypatch
):
    """Numba counts what it compiles anew in each process, and finds code by a name with that count:
    the first of the variants that are loaded would run in place of all."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    tmp_path.joinpath("variants.py").write_text(VARIANTS)

    def run(*factors):
        command = [sys.executable, "-B", "variants.py", *factors]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.split()

    for factor in ("3.0", "5.0", "7.0"):
        assert run(factor) == ["True"]
    for factors in (("3.0", "5.0", "7.0"), ("7.0", "3.0"), ("9.0", "5.0", "3.0")):
        assert run(*factors) == ["True"] * len(factors)


INTERRUPTED = """
import sys
from numba.core.registry import cpu_target
from bus.compiled.cache import watch
from bus.compiled.jit import compiled

def interrupt(*_):
    raise KeyboardInterrupt

def kernel_python(x):
    return 3.0 * x

engine = cpu_target.target_context.codegen()._engine._ee
if sys.argv[1] == "interrupted":
    engine._object_cache_notify = interrupt
kernel = compiled(kernel_python)
told = []
with watch(told.append):
    print(kernel(2.0), *told)
"""


def test_a_kernel_is_kept_although_its_compilation_was_interrupted(tmp_path, monkeypatch):
    """LLVM's callback swallows what a signal raises in it, and numba has no machine code then."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    tmp_path.joinpath("interrupted.py").write_text(INTERRUPTED)
    said = []
    for how in ("interrupted", "not"):
        command = [sys.executable, "-B", "interrupted.py", how]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        said.append(done.stdout.split())
        assert ("KeyboardInterrupt" in done.stderr) == (how == "interrupted")
    assert said == [["6.0", "kernel_python"], ["6.0"]]


@pytest.mark.long
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


@pytest.mark.parametrize("left", [pytest.param(0, marks=pytest.mark.long), 100])
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
    """The machine's processor, versions, options, how this package compiles, defaults, members."""
    kernel = compiled(shift)
    codegen = kernel.targetctx.codegen()
    named = {kernel._cache.file_of((), codegen)}
    with monkeypatch.context() as patch:
        patch.setattr(type(codegen), "magic_tuple", lambda self: ("another", "processor"))
        named.add(kernel._cache.file_of((), codegen))
    with monkeypatch.context() as patch:
        patch.setattr(cache, "VERSIONS", ("another",))
        named.add(kernel._cache.file_of((), codegen))
    named.add(compiled(shift, fastmath={"contract"})._cache.file_of((), codegen))
    named.add(compiled(shift, fastmath={"contract", "reassoc"})._cache.file_of((), codegen))
    named.add(compiled(shift, allocates=False)._cache.file_of((), codegen))
    assert len(named) == 6
    before = stamps.stamp(shift)
    monkeypatch.setattr(shift, "__defaults__", (2.0,))
    assert stamps.stamp(shift) != before
    before = stamps.stamp(shift)
    monkeypatch.setattr(stamps, "_file_digest", lambda path: Path(path).name.encode())
    of_names = stamps.stamp(shift)
    monkeypatch.setattr(
        stamps, "_file_digest", lambda path: Path(path).name.replace("nested", "other").encode()
    )
    assert len({before, of_names, stamps.stamp(shift)}) == 3


KEPT = """
import sys, tempfile
from pathlib import Path
from bus.compiled.jit import compiled

tempfile.tempdir = sys.argv[1]

def kernel_python(x):
    return 3.0 * x

kernel = compiled(kernel_python)
print(kernel(2.0), len(list(Path(sys.argv[1]).glob("**/*.nbc"))))
"""


def as_nobody(*command):
    """The command, without the rights of root over files."""
    drop = ("setpriv", "--inh-caps=-all", "--bounding-set=-all") if os.geteuid() == 0 else ()
    return [*drop, *command]


@pytest.mark.skipif(os.name != "posix", reason="needs users and modes of files")
@pytest.mark.parametrize(
    ("temporary", "kept"), [("temporary", 1), pytest.param("missing", 0, marks=pytest.mark.long)]
)
def test_kernels_run_where_no_folder_can_be_written(temporary, kept, tmp_path):
    """A read-only package, a user without a home: a folder for temporary files, or none."""
    tmp_path.joinpath("kept.py").write_text(KEPT)
    tmp_path.joinpath("temporary").mkdir()
    tmp_path.chmod(0o555)
    command = as_nobody(sys.executable, "-B", "kept.py", str(tmp_path / temporary))
    environment = {"PYTHONPATH": str(ROOT), "HOME": str(tmp_path), "PATH": os.environ["PATH"]}
    for told in (1, 0 if kept else 1):
        done = subprocess.run(
            command, check=True, cwd=tmp_path, capture_output=True, text=True, env=environment
        )
        assert done.stdout.split() == ["6.0", str(kept)]
        lines = done.stderr.splitlines()
        assert len(lines) == told
        for line in lines:
            assert line.startswith("f3t-skin: compiled kernels ")
            assert line.endswith("folder can be written; set NUMBA_CACHE_DIR to one that can")
            assert ("cannot be kept" in line) == (not kept)
    tmp_path.chmod(0o755)


@pytest.mark.skipif(os.name != "posix", reason="needs users and modes of files")
def test_code_that_came_with_a_read_only_image_is_run(tmp_path):
    """It is neither compiled again, nor said to be lost."""
    tmp_path.joinpath("called.py").write_text(CALLED)
    tmp_path.joinpath("deeper.py").write_text("FACTORS = 2.0, 3.0")
    tmp_path.joinpath("constants.py").write_text("SHIFT = 1.0")
    tmp_path.joinpath("caller.py").write_text(CALLER)
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        environment = {"PYTHONPATH": str(ROOT), "PATH": os.environ["PATH"]}
        environment[name] = str(tmp_path / name)
        for found in (["7.0", "kernel_python"], ["7.0"]):
            done = subprocess.run(
                as_nobody(sys.executable, "caller.py"), check=True, cwd=tmp_path,
                capture_output=True, text=True, env=environment,
            )  # fmt: skip
            assert done.stdout.split() == found
            assert not done.stderr
            for folder in (*tmp_path.glob("**/"), tmp_path):
                folder.chmod(0o555)
        for folder in (tmp_path, *tmp_path.glob("**/")):
            folder.chmod(0o755)


@pytest.mark.long_but_first
@pytest.mark.skipif(os.name != "posix", reason="needs users and modes of files")
@pytest.mark.parametrize("mode", [0o775, 0o757])
def test_code_from_a_folder_that_others_can_write_is_not_run(mode, tmp_path):
    """What lies there is compiled again, kept elsewhere, and the reason is said."""
    for name in ("called", "caller"):
        tmp_path.joinpath(f"{name}.py").write_text(CALLED if name == "called" else CALLER)
    tmp_path.joinpath("deeper.py").write_text("FACTORS = 2.0, 3.0")
    tmp_path.joinpath("constants.py").write_text("SHIFT = 1.0")
    tmp_path.joinpath("temporary").mkdir()
    environment = {
        "PYTHONPATH": str(ROOT),
        "PATH": os.environ["PATH"],
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "TMPDIR": str(tmp_path / "temporary"),
    }

    def run():
        return subprocess.run([sys.executable, "caller.py"], check=True, cwd=tmp_path,
                              capture_output=True, text=True, env=environment)  # fmt: skip

    assert run().stdout.split() == ["7.0", "kernel_python"]
    folder = tmp_path / "cache/f3t-skin"
    folder.chmod(mode)
    done = run()
    assert done.stdout.split() == ["7.0", "kernel_python"]
    said = done.stderr.splitlines()
    assert said[0] == (
        f"f3t-skin: compiled kernels in {folder} are not used: must be writable by its owner "
        f"alone; got mode {mode:o}"
    )
    assert len(list(folder.glob("*.nbc"))) == 1
    assert len(list(tmp_path.glob("temporary/f3t-skin-*/*.nbc"))) == 1
    folder.chmod(0o755)
    assert run().stdout.split() == ["7.0"]


def test_a_folder_of_another_user_is_not_used(tmp_path, monkeypatch):
    owner = tmp_path.stat().st_uid
    monkeypatch.setattr(os, "getuid", lambda: owner + 1)
    fault = places.fault_of(tmp_path)
    assert fault == (
        None if owner == 0 else f"must belong to this user or to root; got owner {owner}"
    )
    monkeypatch.setattr(os, "getuid", lambda: owner)
    assert places.fault_of(tmp_path) is None


@pytest.mark.skipif(os.name != "posix", reason="needs users without a home")
@pytest.mark.parametrize(
    "home",
    ["~", *(pytest.param(one, marks=pytest.mark.long) for one in ("", "nowhere", "{}/missing"))],
)
def test_a_user_without_a_home_finds_no_folder_in_the_working_one(home, tmp_path):
    tmp_path.joinpath("package").mkdir()
    tmp_path.joinpath("working").mkdir()
    file = tmp_path / "package/kept.py"
    file.write_text(KEPT)
    file.parent.chmod(0o555)
    home = home.format(tmp_path)
    given = "" if os.path.isabs(home) else home
    environment = {"PYTHONPATH": str(ROOT), "HOME": home, "XDG_CACHE_HOME": given}
    done = subprocess.run(
        as_nobody(sys.executable, "-B", file, tmp_path), check=True, cwd=tmp_path / "working",
        capture_output=True, text=True, env=environment | {"PATH": os.environ["PATH"]},
    )  # fmt: skip
    assert done.stdout.split() == ["6.0", "1"]
    assert {path.name for path in tmp_path.iterdir()} == {
        "package", "working", f"f3t-skin-{os.getuid()}"
    }  # fmt: skip
    assert not list(tmp_path.joinpath("working").iterdir())
    file.parent.chmod(0o755)


def test_a_full_disk_costs_the_cache_and_nothing_else(tmp_path, monkeypatch, caplog):
    kernel = compiled(shift)

    def full(*_):
        raise OSError(28, "No space left on device", "kernel.nbc")

    monkeypatch.setattr(kernel._cache, "_save", full)
    monkeypatch.setattr(Path, "read_bytes", full)
    monkeypatch.setattr(os, "open", full)
    cache._say_not_kept.cache_clear()
    assert kernel(2.0) == 3.0
    assert kernel(np.float32(2.0)) == 3.0
    assert [record.getMessage() for record in caplog.records] == [
        "f3t-skin: compiled kernels cannot be kept: No space left on device"
    ]


@pytest.mark.skipif(os.name != "posix", reason="needs users and modes of files")
def test_a_temporary_folder_that_others_can_write_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = places.temporary()
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o722)
    assert places.temporary() is None
    folder.rmdir()
    folder.symlink_to(tmp_path)
    assert places.temporary() is None


@pytest.mark.skipif(os.name != "posix", reason="needs modes of files")
def test_the_working_folder_is_no_folder_for_temporary_files(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert places.temporary() is None
    assert not list(tmp_path.iterdir())
    tmp_path.chmod(0o1777)  # as /tmp itself
    assert places.temporary() is not None


def test_the_garbage_collector_is_as_it_was_when_the_last_thread_has_compiled():
    usual, collector = gc.get_threshold(), cache.Collector()
    other = ThreadPoolExecutor(1)
    first, second = collector.rare(), collector.rare()
    with first:
        assert gc.get_threshold() == cache.RARE
        other.submit(second.__enter__).result()
    assert gc.get_threshold() == cache.RARE  # the other thread still compiles
    other.submit(second.__exit__, None, None, None).result()
    assert gc.get_threshold() == usual
    with pytest.raises(ZeroDivisionError), collector.rare():
        1 / 0  # noqa: B018
    assert gc.get_threshold() == usual
