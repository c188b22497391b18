"""The house's order: who may import whom, what is imported late, and what names are promised."""

import ast
import functools
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("topology", "bus", "skin")
FORBIDDEN = {"topology": {"bus", "skin"}, "bus": {"skin"}, "skin": set()}
ONE_FILE_EACH = (
    "matplotlib",
    "magpylib",
    "viser",
    "pyarrow",
    "asammdf",
    "cantools",
    "mcap",
    "cyclonedds",
)
FILES = sorted(file for name in PACKAGES for file in (ROOT / name).rglob("*.py"))
MODULES = [
    ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for file in FILES
]


@functools.cache
def imported(file):
    """List the top-level packages that a file imports, at any depth of it."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(), str(file))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(node.module.split(".")[0])
    return frozenset(names)


def in_new_process(code):
    return subprocess.run(
        [sys.executable, "-c", code], cwd="/", capture_output=True, text=True, check=True
    ).stdout.splitlines()


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_go_one_way(package):
    wrong = {
        str(file.relative_to(ROOT)): names
        for file in sorted((ROOT / package).rglob("*.py"))
        if (names := imported(file) & FORBIDDEN[package])
    }
    assert wrong == {}


@pytest.mark.parametrize("library", ONE_FILE_EACH)
def test_an_optional_library_lives_in_one_file(library):
    files = [str(file.relative_to(ROOT)) for file in FILES if library in imported(file)]
    assert len(files) <= 1, files


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_a_package_imports_nothing_heavy(package):
    code = (
        f"import sys, {package}; print(*{{name.split('.')[0] for name in sys.modules}}, sep='\\n')"
    )
    loaded = set(in_new_process(code))
    assert package in loaded
    assert loaded.isdisjoint({"numba", "scipy", "tyro", *ONE_FILE_EACH} | FORBIDDEN[package])


def test_the_three_packages_lie_side_by_side():
    lines = [f"import {name}; print({name}.__file__)" for name in PACKAGES]
    files = [Path(line) for line in in_new_process("; ".join(lines))]
    assert files == [ROOT / name / "__init__.py" for name in PACKAGES]


@pytest.mark.parametrize("module", MODULES)
def test_every_promised_name_is_there(module):
    there = importlib.import_module(module)
    names = getattr(there, "__all__", [])
    assert sorted(set(names)) == sorted(names), "a name is promised twice"
    assert [name for name in names if not hasattr(there, name)] == []
