"""The stamp of every kernel of the three packages changes with each constant that it stands on."""

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import bus
import skin
import topology
from bus.compiled import stamps

ROOT = Path(bus.__file__).parent.parent
PACKAGES = (topology, bus, skin)


def kernels():
    """Every compiled function by its name, and the modules that are not installed here."""
    found, missing = {}, []
    for package in PACKAGES:
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if module.name.endswith("__main__"):
                continue
            try:
                names = vars(importlib.import_module(module.name))
            except ImportError as error:
                missing.append(error.name)
                continue
            for name, value in names.items():
                if hasattr(value, "py_func") and hasattr(value, "overloads"):
                    found[f"{value.py_func.__module__}.{name}"] = value.py_func
    return found, missing


class Visits(stamps.Walk):
    """A walk that notes the functions that it comes to."""

    def __init__(self):
        super().__init__()
        self.functions = []

    def function(self, function):
        if stamps._top(function.__module__ or "") not in stamps.OUTSIDE:
            self.functions.append(function)
        super().function(function)


def constants(kernel):
    """(names of a module, name) of every number that a kernel or what it calls reads."""
    visits, found = Visits(), {}
    visits.value(kernel)
    for function in visits.functions:
        names = tuple(stamps._names(function.__code__))
        holders = [function.__globals__]
        holders += [
            vars(value)
            for name in names
            if isinstance(value := function.__globals__.get(name), ModuleType)
            and stamps._top(value.__name__) not in stamps.OUTSIDE
        ]
        for holder in holders:
            for name in names:
                if isinstance(holder.get(name), int | float | np.ndarray):
                    found[id(holder), name] = (holder, name)
    return list(found.values())


def changed(value):
    if isinstance(value, np.ndarray) and value.dtype.names:
        other = value.copy()
        other.view(np.uint8)[0] += 1
        return other
    return value + value.dtype.type(1) if isinstance(value, np.ndarray) else type(value)(value + 1)


def test_the_stamp_of_every_kernel_changes_with_each_of_its_constants():
    found, missing = kernels()
    assert set(missing) <= {"asammdf", "magpylib", "matplotlib"}
    assert len(found) >= 20
    tried = 0
    for name, kernel in found.items():
        before = stamps.stamp(kernel)
        assert stamps.stamp(kernel) == before, name
        for holder, constant in constants(kernel):
            value = holder[constant]
            if isinstance(value, bool) or (isinstance(value, np.ndarray) and not value.size):
                continue
            try:
                holder[constant] = changed(value)
                assert stamps.stamp(kernel) != before, f"{name}: {constant}"
            finally:
                holder[constant] = value
            tried += 1
        assert stamps.stamp(kernel) == before, name
    assert tried >= 200


PROGRAM = """
from bus.assemble.cycles import show_units
from bus.assemble.memory import new_memory, new_shown
from bus.compiled.jit import compiled
from bus.table import FrameTable
from topology import load

skin = load("strip")
memory, shown = new_memory(skin, FrameTable(skin), 5), new_shown(skin.n)
memory.state["number"] = 0  # a cycle is open
compiled(show_units, allocates=False)(memory, shown)
print(shown.valid.any())  # of units that were never heard
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("file", "old", "new"),
    [("bus/status.py", "    Status.NEVER\n    | Status.LATE\n", "    Status.STALE\n")],
)
def test_a_changed_flag_is_seen_by_the_compiled_kernels(file, old, new, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    for package in ("topology", "bus"):
        left_out = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, tmp_path / package, ignore=left_out)

    def run():
        command = [sys.executable, "-B", "-c", PROGRAM]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    assert run() == "False"
    text = (tmp_path / file).read_text()
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new))
    assert run() == "True"


KERNELS = """
from bus.compiled.watch import watch

compiled = []
with watch(compiled.append):
    import bus.codec_kernels
print(*sorted(compiled))
"""


@pytest.fixture(scope="module")
def edited(tmp_path_factory):
    """A file of a copy of the packages, with kernels that are compiled as it is imported, and what
    tells the names of those that are."""
    folder = tmp_path_factory.mktemp("edited")
    for package in ("topology", "bus"):
        left_out = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, folder / package, ignore=left_out)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(folder)}

    def run():
        command = [sys.executable, "-B", "-c", KERNELS]
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=True
        )
        return set(done.stdout.split())

    assert run() == {"crc16_python", "frame_crc_python", "pack_python", "unpack_frame_python"}
    return folder / "bus/codec_kernels.py", run


@pytest.mark.long_but_first
@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("def pack_python(", "# a comment\n\n\ndef pack_python(", set()),
        ("place = 3 - i if", "place = 4 - i - 1 if", {"pack_python"}),
        ("row, place + 2, end)", "row, place + 1, end)", {"frame_crc_python", "pack_python"}),
    ],
    ids=["comment", "leaf of one", "leaf of two"],
)
def test_an_edit_compiles_what_stands_on_it_and_nothing_else(old, new, expected, edited):
    file, run = edited
    text = file.read_text()
    assert text.count(old) == 1
    file.write_text(text.replace(old, new))
    try:
        assert run() == expected
        assert run() == set()
    finally:
        file.write_text(text)
