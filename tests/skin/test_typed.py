"""A type checker knows the attributes of what users read, and finds those that are misspelt."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import skin

ROOT = Path(skin.__file__).parents[1]
PROGRAM = """
import skin

with skin.open("palm", simulate=True) as palm:
    for state in palm:
        for contact in state.contacts:
            print(contact.load + 1.0, contact.wrench[:3], contact.slip.name, contact.margin)
            print(contact.centre)  # wrong
        print(state.units.forces)  # wrong
        print(state.wrenches)  # wrong
        part = state.patch("palm")
        print(part.wrench, part.contacts[0].load, part.wrench_sgima)  # wrong
        print(state.units["palm/r0c0"].force, state.time_s)
        if palm.topology.unit_name:  # wrong
            break
print(skin.Statte)  # wrong
"""


@pytest.mark.long
def test_misspelt_attributes_are_found_and_no_others(tmp_path):
    file = tmp_path / "program.py"
    file.write_text(PROGRAM)
    done = subprocess.run(
        [sys.executable, "-m", "basedpyright", "--outputjson", "--level", "error", str(file)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    found = {one["range"]["start"]["line"] for one in json.loads(done.stdout)["generalDiagnostics"]}
    wrong = {i for i, line in enumerate(PROGRAM.splitlines()) if line.endswith("# wrong")}
    assert found == wrong
