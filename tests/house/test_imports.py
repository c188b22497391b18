"""The house's order: who may import whom, what is imported late, and what names are promised."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from tests.house import draw, imports
from tests.house.imports import FORBIDDEN, ROOMS, imports_of
from tests.house.sources import PACKAGES, ROOT, module_of, relative, sources

ONE_FILE_EACH = (
    "matplotlib",
    "gymnasium",
    "magpylib",
    "viser",
    "pyarrow",
    "asammdf",
    "cantools",
    "distributed",
    "mcap",
    "rosbags",
    "cyclonedds",
    "PIL",
    "mujoco",
    "trimesh",
)
MODULES = [module_of(file) for file in sources()]


@pytest.fixture
def file_in(tmp_path, monkeypatch):
    """Write a file of a room of `skin` in a repository of its own."""
    monkeypatch.setattr(imports, "ROOT", tmp_path)
    monkeypatch.setattr("tests.house.sources.ROOT", tmp_path)

    def write(place, text):
        file = tmp_path / "skin" / place
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file

    return write


def in_new_process(code):
    return subprocess.run(
        [sys.executable, "-c", code], cwd="/", capture_output=True, text=True, check=True
    ).stdout.splitlines()


def test_imports_go_one_way():
    assert imports.package_errors() == []


def test_rooms_of_skin_import_as_the_table_says():
    assert imports.room_errors() == []


def test_no_room_may_import_itself_through_others():
    def below(room):
        return {far for other in ROOMS[room] for far in (other, *below(other))}

    assert [room for room in ROOMS if room in below(room)] == []


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("decode/laws.py", "from skin.sim.body import Body\n"),
        ("decode/laws.py", "import skin.calibrate\n"),
        ("contact/track.py", "from skin import decode\n"),
        ("contact/slip/friction.py", "def late():\n    from skin.live import Skin\n"),
        ("calibrate/tare.py", "if TYPE_CHECKING:\n    from skin.sim.unit import UnitSimulator\n"),
        ("physics/film.py", "from bus.status import Status\n"),
        ("physics/film.py", "from skin.state import Reading\n"),
        ("state.py", "from skin.contact.stream import Contact\n"),
        ("pipeline.py", "from skin.cli import main\n"),
        ("newroom/thing.py", "import numpy\n"),
    ],
)
def test_an_import_the_wrong_way_is_found(file_in, place, text):
    assert len(imports.room_errors([file_in(place, text)])) == 1


@pytest.mark.parametrize(
    ("place", "text"),
    [
        (
            "decode/laws.py",
            "from skin.physics import film\nfrom bus.compiled.jit import compiled\n",
        ),
        ("state.py", "if TYPE_CHECKING:\n    from skin.contact.stream import Contact\n"),
        ("cli/run.py", "import skin\nfrom skin.sim import bench\n"),
        (
            "physics/film.py",
            "from bus.compiled.jit import compiled\nfrom topology import Topology\n",
        ),
    ],
)
def test_an_import_the_right_way_is_not(file_in, place, text):
    assert imports.room_errors([file_in(place, text)]) == []


def test_the_picture_in_the_docs_is_that_of_the_code():
    assert draw.PICTURE.read_text() == draw.picture(), "draw it: python -m tests.house draw"


def test_an_arrow_that_others_imply_is_left_out():
    arrows = {("a", "b"), ("b", "c"), ("a", "c"), ("a", "d")}
    assert draw.reduced(arrows) == [("a", "b"), ("a", "d"), ("b", "c")]


@pytest.mark.parametrize("library", ONE_FILE_EACH)
def test_an_optional_library_lives_in_one_file(library):
    files = [
        relative(file)
        for file in sources()
        if any(found.module.split(".")[0] == library for found in imports_of(file))
    ]
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
