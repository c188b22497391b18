"""The README's examples, as a type checker in a user's editor sees them: no errors."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fixtures.patience import LONG_S

ROOT = Path(__file__).parents[2]
GIVEN = "import numpy as np\n\ncounts = np.zeros((6, 64), np.int16)\n"
"""What an example takes from the reader."""


def examples():
    """The README's blocks of Python."""
    return re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)


@pytest.mark.long
def test_examples_have_no_type_errors(tmp_path):
    pytest.importorskip("basedpyright")
    (tmp_path / "pyrightconfig.json").write_text(
        json.dumps({"typeCheckingMode": "basic", "extraPaths": [str(ROOT)], "include": ["."]})
    )
    found = examples()
    assert found
    for number, text in enumerate(found):
        (tmp_path / f"example{number}.py").write_text(GIVEN + text)
    command = [sys.executable, "-m", "basedpyright", "--outputjson", "--level", "error",
               "--pythonpath", sys.executable, "--project", str(tmp_path)]  # fmt: skip
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    report = json.loads(done.stdout)
    assert report["summary"]["filesAnalyzed"] >= len(found), done.stdout
    problems = [(problem["file"], problem["message"]) for problem in report["generalDiagnostics"]]
    assert problems == []


def test_the_first_program_ends_and_reports_contacts():
    """As it stands: its scene presses within the cycles that it waits for."""
    first = next(text for text in examples() if "simulate=True" in text)
    done = subprocess.run(
        [sys.executable, "-c", first], cwd=ROOT, check=False, capture_output=True, text=True,
        timeout=LONG_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert re.search(r"^1 .* -\d+\.\d+ STICK ", done.stdout, re.MULTILINE)


def test_it_is_short():
    """A reader sees what it is, how to install it and how it runs."""
    text = (ROOT / "README.md").read_text()
    assert text.count("\n") <= 130
    assert "pip install '.[view]'" in text


def test_types_are_shipped():
    for package in ("skin", "bus", "topology"):
        assert (ROOT / package / "py.typed").exists()
