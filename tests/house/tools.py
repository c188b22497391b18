"""The tools that run as programs: ruff, the type checker, doctests. Each starts at once and is
read when it ends, so that they share the processors."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from tests.house.imports import imports_of
from tests.house.sources import PACKAGES, ROOT, relative


class Outcome(NamedTuple):
    """What a tool has found: one line an error, and how much it has looked at."""

    errors: list[str]
    count: int


class Tool:
    """A program that runs beside others.

    Parameters
    ----------
    *command : str
        Arguments of Python, from ``-m`` on.
    environment : dict of str to str, optional
        In addition to that of this process.
    """

    def __init__(self, *command: str, environment: dict[str, str] | None = None) -> None:
        # into a file, not a pipe, which would fill up while nobody reads
        self._output = tempfile.TemporaryFile("w+", encoding="utf-8")
        self._process = subprocess.Popen(
            [sys.executable, *command],
            cwd=ROOT,
            env=os.environ | {"PYTHONPATH": str(ROOT)} | (environment or {}),
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
        )

    def finish(self) -> tuple[int, str]:
        """Exit status and output."""
        status = self._process.wait()
        self._output.seek(0)
        with self._output:
            return status, self._output.read()


class Ruff:
    """``ruff check`` and ``ruff format --check`` over the whole repository."""

    def __init__(self) -> None:
        check = ("-m", "ruff", "check", "--output-format=concise", "--quiet")
        self._tools = (
            Tool(*check),
            Tool("-m", "ruff", "format", "--check", "--output-format=concise", "--quiet"),
        )

    def outcome(self) -> Outcome:
        """One error a line; the count is that of errors."""
        errors = []
        for tool in self._tools:
            status, output = tool.finish()
            lines = output.strip().splitlines()
            if status:
                errors += lines or [f"ruff: must end with status 0; got {status}"]
        return Outcome(errors, len(errors))


class Types:
    """basedpyright over the three packages, as ``[tool.basedpyright]`` of pyproject.toml says."""

    def __init__(self) -> None:
        self._tool = Tool("-m", "basedpyright", "--outputjson", "--pythonpath", sys.executable)

    def outcome(self) -> Outcome:
        """Errors, warnings apart; the count is that of errors."""
        status, output = self._tool.finish()
        try:
            report = json.loads(output[output.index("{") :])
        except ValueError:
            return Outcome([f"basedpyright: must run; ended with {status}: {output.strip()}"], 1)
        errors = [
            f"{relative(Path(one['file']))}:{one['range']['start']['line'] + 1}: "
            + one["message"].splitlines()[0]
            for one in report["generalDiagnostics"]
            if one["severity"] == "error"
        ]
        if not report["summary"]["filesAnalyzed"]:
            errors.append("basedpyright: must analyse the packages; got no file")
        return Outcome(errors, len(errors))


class Doctests:
    """Every example of a docstring of the three packages. One that needs an extra which is not
    installed is left out."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._report = Path(self._folder.name) / "doctests.xml"
        self._tool = Tool(
            "-m", "pytest", "--doctest-modules", "--doctest-ignore-import-errors", "-q",
            "-p", "no:cacheprovider", "--durations=0", "--durations-min=60",
            f"--junitxml={self._report}", *PACKAGES,
            environment={"NUMBA_CACHE_DIR": str(ROOT / "build" / "numba")},
        )  # fmt: skip

    def outcome(self) -> Outcome:
        """Failures; the count is that of doctests run."""
        status, output = self._tool.finish()
        with self._folder:
            if not self._report.exists():
                return Outcome([f"doctests: must run; ended with {status}: {output.strip()}"], 0)
            suite = ElementTree.parse(self._report).getroot().find("testsuite")
        assert suite is not None
        ran = int(suite.get("tests", 0)) - int(suite.get("skipped", 0))
        errors = [output.strip()] if status else []
        told = [skip.text or "" for skip in suite.iter("skipped")]
        return Outcome([*errors, *filter(_is_error, told)], ran)


def _is_error(skipped: str) -> bool:
    """Whether a file was left out although every library that it imports is installed."""
    found = re.search(r"unable to import module .*'(.+\.py)'", skipped)
    if found is None:
        return False
    libraries = {one.module.split(".")[0] for one in imports_of(Path(found[1]))}
    return all(importlib.util.find_spec(name) for name in libraries)
