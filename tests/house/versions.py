"""Versions of the packages that tests run with: ``python -m tests.house.versions lock | test``.

``lock`` writes the versions that pip would install today to `constraints.txt`. ``test`` runs the
tests of what stands on other packages with the oldest versions that `pyproject.toml` declares, and
with the newest that there are, each in an environment of its own.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).parents[2]
LOCK = ROOT / "constraints.txt"
HEAD = """\
# The versions that `make install` takes and all tests have passed with; `make lock` renews them.
# Of Python {}.{}: where they do not fit another one, the newest versions are installed.
"""
CORE = (
    "tests/topology", "tests/bus/compiled", "tests/bus/logs", "tests/bus/test_pythoncan.py",
    "tests/skin/test_live.py", "tests/skin/io/record/test_replay.py", "tests/skin/io/export",
    "tests/skin/io/publish",
)  # fmt: skip
"""Tests of what stands on other packages."""
PIP = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-e", ".[test]")


def oldest() -> str:
    """The least version of each package, as constraints; of two parts, with all its mends."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    lines = {*project["dependencies"], *(line for extra in extras.values() for line in extra)}
    found = []
    for line in lines:
        if least := re.match(r"([\w.-]+)>=(\d[\w.]*)", line):
            parts = least[2].split(".")
            version = least[2] if len(parts) > 2 else f"{parts[0]}.{[*parts, '0'][1]}.*"
            found.append(f"{least[1]}=={version}\n")
    return "".join(sorted(found))


def lock() -> None:
    """Write what pip would install today, as constraints."""
    command = [sys.executable, *PIP, "--dry-run", "--ignore-installed", "--report", "-"]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    chosen = [one["metadata"] for one in json.loads(done.stdout)["install"]]
    lines = [f"{one['name']}=={one['version']}" for one in chosen if one["name"] != "f3t-skin"]
    LOCK.write_text(HEAD.format(*sys.version_info) + "\n".join(sorted(lines, key=str.lower)) + "\n")


def test(kind: str, constraints: str) -> int:
    """Install these versions and run the core of the tests; the exit status."""
    print(f"The {kind} versions:", flush=True)
    with tempfile.TemporaryDirectory() as place:
        venv.create(place, with_pip=True)
        python, file = f"{place}/bin/python", Path(place, "constraints.txt")
        file.write_text(constraints)
        tests = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not long", *CORE)
        installed = subprocess.call([python, *PIP, "-c", str(file)], cwd=ROOT)
        return installed or subprocess.call([python, *tests], cwd=ROOT)


if __name__ == "__main__":
    if sys.argv[1:] == ["lock"]:
        sys.exit(lock())
    if sys.argv[1:] == ["test"]:
        sys.exit(max(test("oldest", oldest()), test("newest", "")))
    sys.exit(__doc__)
