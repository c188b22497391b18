"""Every example runs as it stands, and reports what it should; one that needs a package that is not
installed skips."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fixtures.patience import LONG_S

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted([*(ROOT / "examples").glob("*.py"), *(ROOT / "examples").glob("*.ipynb")])
OWN = {"skin", "topology", "bus", "benchmarks", "shared"}
NEEDS = {"lerobot_dataset": "pyarrow", "record_replay_plot": "mcap", "ros2_topics": "cyclonedds",
         "grasp_in_mujoco": "mujoco", "train_policy": "gymnasium", "fig4b_gestures": "mujoco",
         "fig4c_adaptive_grasp": "mujoco", "fig5_pva": "mujoco", "fig6_tea": "mujoco"}  # fmt: skip
"""What an example needs by way of this project."""
QUICK = {"own_hand", "slip_margin_loop"}
"""What `make test` runs; `make docs` runs all of them."""
SHORT = {"fig4b_gestures": ["--last", "2"], "fig4c_adaptive_grasp": ["--seconds", "0.5"],
         "fig5_pva": ["--rounds", "0"], "fig6_tea": ["--goal", "24"]}  # fmt: skip
"""Arguments with which a figure of the paper is the begin or the end of it."""
REPORTS = {
    "fig4b_gestures": r"^2 of 2 right, direction [\d.]+ degrees rms, 0 reported where nobody",
    "fig4c_adaptive_grasp": r"^dropped +False$",
    "fig5_pva": r"^done +True$",
    "fig6_tea": r"^done +True$",
    "notebook": r"^[1-9]\d+ cycles with a contact, [1-9]\d* of them slipping$",
    "calibrate_bench": r"^gel_current_ratio +12 +12\.1\d +12\.1\d$",
    "contacts_of_another_array": r"^shear rises from [\d.]+ to [\d.]+ N$",
    "contacts_to_pandas": r"^ +time +id +load_n +x_mm",
    "grasp_in_mujoco": r"^cube at (2[5-9]|3\d|4\d)\.\d mm$",
    "lerobot_dataset": r"^2 episodes, 120 frames$",
    "own_hand": r"^finger at +[1-9][\d.]+°: tip/",
    "record_replay_plot": r"wrenches identical$",
    "ros2_topics": r"^[1-9]\d+ states published, 0 left out$",
    "slip_margin_loop": r"^[\d.]+ s: contact 1 (INCIPIENT|GROSS), friction",
    "train_policy": r"^unseen objects lifted by \[",
}
"""A line of the output of each."""
LINES, LINES_OF_FIGURES = 70, 250


def _gallery():
    """The module that shows the examples on the site."""
    spec = importlib.util.spec_from_file_location("gallery", ROOT / "docs" / "site" / "gallery.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


program = _gallery().program


def libraries(script):
    """Packages of others that a script imports."""
    for node in ast.walk(ast.parse(program(script))):
        names = [one.name for one in node.names] if isinstance(node, ast.Import) else (
            [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        )  # fmt: skip
        yield from {name.split(".")[0] for name in names} - OWN - set(sys.stdlib_module_names)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_it_is_short_and_says_what_it_shows(script):
    text = program(script)
    most = LINES_OF_FIGURES if script.stem.startswith("fig") else LINES
    assert 15 <= text.count("\n") <= most
    title = (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    assert title.endswith(".")
    assert "`" not in title


@pytest.mark.parametrize(
    "script",
    [pytest.param(each, marks=[pytest.mark.long] * (each.stem not in QUICK)) for each in SCRIPTS],
    ids=lambda script: script.stem,
)
def test_it_runs(script, tmp_path):
    needed = {*libraries(script), *filter(None, [NEEDS.get(script.stem)])}
    missing = sorted(name for name in needed if importlib.util.find_spec(name) is None)
    if missing:
        pytest.skip(f"{', '.join(missing)} is not installed")
    file = script
    if script.suffix != ".py":
        file = tmp_path / f"{script.stem}.py"
        file.write_text(program(script), "utf-8")
    done = subprocess.run(
        [sys.executable, str(file), *SHORT.get(script.stem, ())], cwd=tmp_path, check=False,
        capture_output=True, text=True, timeout=LONG_S,
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'examples'}", "MPLBACKEND": "agg"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    if script.stem in REPORTS:
        assert re.search(REPORTS[script.stem], done.stdout, re.MULTILINE), done.stdout
    if "savefig" in script.read_text("utf-8"):
        assert list(tmp_path.glob("*.png"))


def test_notebooks_are_kept_without_outputs():
    for file in SCRIPTS:
        if file.suffix == ".ipynb":
            notebook = json.loads(file.read_text("utf-8"))
            code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
            assert notebook["nbformat"] == 4
            assert notebook["cells"][0]["cell_type"] == "markdown"
            assert not any(cell["outputs"] or cell["execution_count"] for cell in code)


def test_a_cell_that_ends_with_a_value_prints_it(tmp_path):
    def cell(kind, *lines):
        return {"cell_type": kind, "source": [f"{line}\n" for line in lines]}

    file = tmp_path / "small.ipynb"
    cells = [cell("markdown", "# A title.", "", "Text."), cell("code", "x = 2", "(x,", " 3)"),
             cell("markdown", "More."), cell("code", "x.bit_length()")]  # fmt: skip
    file.write_text(json.dumps({"cells": cells}))
    text = program(file)
    assert ast.get_docstring(ast.parse(text)).startswith("A title.\n\nText.")
    assert "# More." in text
    done = subprocess.run([sys.executable, "-c", text], check=True, capture_output=True, text=True)
    assert done.stdout == "(2, 3)\n"
