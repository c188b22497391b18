"""Who may import whom, what is imported late, and what names are promised."""

import importlib
import subprocess
import sys

import pytest

from tests.house.imports import FORBIDDEN, imports_of
from tests.house.sources import PACKAGES, ROOT, module_of, relative, sources

ONE_FILE_EACH = (
    "matplotlib", "gymnasium", "viser", "pyarrow", "cantools", "distributed",
    "mcap", "rosbags", "cyclonedds", "PIL", "mujoco", "trimesh",
)  # fmt: skip


def test_an_optional_library_lives_in_one_file():
    for library in ONE_FILE_EACH:
        files = [
            relative(file)
            for file in sources()
            if any(found.module.split(".")[0] == library for found in imports_of(file))
        ]
        assert len(files) <= 1, files


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_a_package_imports_nothing_heavy(package):
    code = f"import sys, {package}; print({package}.__file__, *sys.modules, sep='\\n')"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd="/", capture_output=True, text=True, check=True
    )
    place, *modules = done.stdout.splitlines()
    assert place == str(ROOT / package / "__init__.py")
    loaded = {name.split(".")[0] for name in modules}
    assert loaded.isdisjoint({"numba", "scipy", "tyro", *ONE_FILE_EACH} | FORBIDDEN[package])


def test_every_promised_name_is_there():
    for module in map(module_of, sources()):
        there = importlib.import_module(module)
        names = getattr(there, "__all__", [])
        assert len(set(names)) == len(names), f"{module} promises a name twice"
        assert [name for name in names if not hasattr(there, name)] == [], module
