"""The commands as in a container: an unprivileged user that nobody knows, no home, compiled code
that may only be read, or none."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import skin
from bus.compiled import cache
from tests.fixtures.topology import PAIR

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs users and modes of files")

ROOT = Path(skin.__file__).parent.parent
NOBODY = 54321
"""A user without an entry in the list of users."""
PROGRAM = """
import sys
from skin.cli import main

for line in sys.argv[1:]:
    assert main(line.split()) == 0
"""
COMMANDS = (
    "check pair.toml --json",
    "sim pair.toml press --seconds 1 --record sim.log --json",
    "run pair.toml --simulate press --seconds 0.3 --record run.log --json",
    "decode pair.toml sim.log --output felt.csv --json",
)
MADE = {"sim.log", "run.log", "felt.csv", "felt.contacts.csv", "felt.faults.csv"}


def ran(folder, environment, user=()):
    """What the commands tell in a folder that holds a topology: their reports, and what they say
    beside them."""
    done = subprocess.run(
        [*user, sys.executable, "-B", "-c", PROGRAM, *COMMANDS], cwd=folder, env=environment,
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert {path.name for path in folder.iterdir()} == MADE | {"pair.toml"}
    reports = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return reports, done.stderr


@pytest.fixture(scope="module")
def user():
    """What makes a command that of another user; without root, or where the interpreter is not for
    all, of one without rights over what is read only."""
    if os.geteuid():
        return []
    for tried in (
        ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"],
        ["setpriv", "--inh-caps=-all", "--bounding-set=-all"],
    ):
        if not subprocess.run([*tried, sys.executable, "-c", "import numpy"], check=False,
                              cwd="/", capture_output=True).returncode:  # fmt: skip
            return tried
    return []


@pytest.fixture
def container():
    """A folder with two that everybody can write."""
    folder = Path(tempfile.mkdtemp(prefix="container-"))
    folder.chmod(0o755)
    for name in ("work", "temporary"):
        folder.joinpath(name).mkdir()
        folder.joinpath(name).chmod(0o777)
    folder.joinpath("work/pair.toml").write_text(PAIR)
    yield folder
    for path in (folder, *folder.glob("kernels/**/")):
        path.chmod(0o755)
    shutil.rmtree(folder)


def contained(container, user, **environment):
    """What the commands tell in the container: numba looks for kernels by the path of their files,
    so the packages are those of this project."""
    for path in container.glob("kernels/**/"):
        path.chmod(0o555)
    bare = {"PATH": os.environ["PATH"], "TMPDIR": str(container / "temporary")}
    return ran(container / "work", bare | {"PYTHONPATH": str(ROOT)} | environment, user)


@pytest.mark.long
def test_commands_run_in_a_read_only_image_with_its_code_compiled(container, user, tmp_path):
    tmp_path.joinpath("pair.toml").write_text(PAIR)
    ran(tmp_path, os.environ | {"PYTHONPATH": str(ROOT)})
    kept = container / "kernels"
    passing = shutil.ignore_patterns("*.nb?.*")  # locks and unfinished files of other processes
    shutil.copytree(cache.folder(), kept / "f3t-skin" / cache.sources(), ignore=passing)
    reports, said = contained(container, user, NUMBA_CACHE_DIR=str(kept))
    assert "f3t-skin" not in said  # nothing was compiled
    assert [one["units_heard"] for one in reports if "units_heard" in one] == [2]
    assert reports[-1]["logs"][0]["peak_force_n"] > 0.1
    for name in MADE - {"run.log"}:
        assert container.joinpath("work", name).read_bytes() == (tmp_path / name).read_bytes()
