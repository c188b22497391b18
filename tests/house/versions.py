"""Versions of the packages that tests run with: ``python -m tests.house.versions lock | test``.

``lock`` asks pip which versions it would install today and writes them to `constraints.txt`, for
this Python. ``test`` makes two environments, one of the oldest versions that `pyproject.toml`
declares and one of the newest that there are, and runs the tests of what stands on other packages
in both.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterator
from pathlib import Path

__all__ = ["LOCK", "lock", "lowest", "requirements"]

ROOT = Path(__file__).parents[2]
LOCK = ROOT / "constraints.txt"
HEAD = """\
# The versions that `make install` takes and all tests have passed with; `make lock` renews them.
# Of Python {python}: where they do not fit another one, the newest versions are installed.
"""
CORE = (
    "tests/topology", "tests/bus/compiled", "tests/bus/logs", "tests/bus/test_pythoncan.py",
    "tests/skin/test_live.py", "tests/skin/test_package.py", "tests/skin/io/record/test_replay.py",
    "tests/skin/io/export", "tests/skin/io/publish",
)  # fmt: skip
"""Tests of what stands on other packages."""
_NAME = re.compile(r"[A-Za-z0-9._-]+")
_LEAST = re.compile(r">=\s*([0-9][0-9A-Za-z.]*)")


def requirements(text: str, extras: tuple[str, ...] = ("test",)) -> Iterator[str]:
    """Requirements of a `pyproject.toml`: its own, and those of extras, with the extras of the
    package itself that these name.

    Parameters
    ----------
    text : str
        The file.
    extras : tuple of str

    Examples
    --------
    >>> list(requirements('''
    ... [project]
    ... name = "a"
    ... dependencies = ["numpy>=2.0"]
    ... [project.optional-dependencies]
    ... log = ["mcap>=1.6"]
    ... test = ["a[log]", "pytest>=8"]
    ... '''))
    ['numpy>=2.0', 'mcap>=1.6', 'pytest>=8']
    """
    project = tomllib.loads(text)["project"]
    yield from project["dependencies"]
    for extra in extras:
        for line in project["optional-dependencies"][extra]:
            own = re.fullmatch(rf"{re.escape(project['name'])}\[(.*)\]", line)
            if own is None:
                yield line
                continue
            for name in own[1].split(","):
                yield from project["optional-dependencies"][name.strip()]


def lowest(lines: Iterator[str]) -> list[str]:
    """The oldest versions that requirements declare, as constraints; of two parts, with whatever
    mends of it there are.

    Examples
    --------
    >>> lowest(iter(["numba>=0.62,<0.70", "vulture", "ros>=11; sys_platform == 'x'", "a>=1.2.3"]))
    ['a==1.2.3', 'numba==0.62.*', 'ros==11.0.*']
    """
    found = {}
    for line in lines:
        name, least = _NAME.match(line), _LEAST.search(line.partition(";")[0])
        if name is not None and least is not None:
            parts = least[1].split(".")
            version = least[1] if len(parts) > 2 else f"{parts[0]}.{(*parts, '0')[1]}.*"
            found[name[0].lower()] = f"{name[0]}=={version}"
    return [found[name] for name in sorted(found)]


def lock() -> str:
    """What pip would install today, as constraints."""
    command = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--dry-run",
               "--ignore-installed", "--report", "-", "-e", ".[test]"]  # fmt: skip
    told = subprocess.run(
        [sys.executable, *command], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True
    )
    own = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["name"]
    chosen = [one["metadata"] for one in json.loads(told.stdout)["install"]]
    lines = [f"{one['name']}=={one['version']}" for one in chosen if one["name"] != own]
    head = HEAD.format(python="{}.{}".format(*sys.version_info))
    return head + "\n".join(sorted(lines, key=str.lower)) + "\n"


def try_out(kinds: list[str]) -> int:
    """Install and run the core of the tests with other versions; the first exit status that is not
    0."""
    statuses = []
    for kind in kinds:
        with tempfile.TemporaryDirectory() as place:
            venv.create(place, with_pip=True)
            python = str(Path(place, "bin", "python"))
            chosen = Path(place, "constraints.txt")
            text = (ROOT / "pyproject.toml").read_text()
            chosen.write_text("\n".join(lowest(requirements(text)) if kind == "oldest" else ()))
            print(f"The {kind} versions:", flush=True)
            status = subprocess.call(
                [python, "-m", "pip", "install", "-q", "--disable-pip-version-check",
                 "-c", str(chosen), "-e", ".[test]"], cwd=ROOT,
            )  # fmt: skip
            status = status or subprocess.call(
                [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not long", *CORE],
                cwd=ROOT,
            )
            print(f"The {kind} versions: {'status ' + str(status) if status else 'passed'}")
            statuses.append(status)
    return next(filter(None, statuses), 0)


def main() -> int:
    """Do what the command line says."""
    if sys.argv[1:] == ["lock"]:
        LOCK.write_text(lock())
        return 0
    if sys.argv[1:2] == ["test"]:
        return try_out(sys.argv[2:] or ["oldest", "newest"])
    raise SystemExit(__doc__)


if __name__ == "__main__":
    sys.exit(main())
