"""Units too near to each other: found by `skin check`, with what to change, and only where true."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import skin
import topology
from skin.cli import main
from skin.errors import TooDenseError
from skin.physics.stencil import Stencil
from tests.fixtures.cases import long_after_first

BUS = """
format = 1
name = "dense"

sync_id = 0x80
cycle_rate_hz = 50
[[buses]]
name = "main"
interface = "memory"
data_bitrate = 5_000_000
"""


def patch(name="p", first_id=0x100, **keys):
    lines = [f"{key} = {value}" for key, value in keys.items()]
    return "\n".join([f'\n[[patches]]\nname = "{name}"\nbus = "main"\nlayout = "f3t-fd64"',
                      f"first_id = {first_id}", *lines, ""])  # fmt: skip


def unit(x, y):
    return f"[[patches.units]]\nxyz_m = [{x}, {y}, 0.0]\nnormal = [0, 0, 1]\n"


GRID = patch(kind="'grid'", rows=4, columns=4, pitch_m=0.004)
LIST = patch(kind="'list'") + "".join(
    unit(0.003 * i, 0.003 * j) for i in range(4) for j in range(4)
)
SMALL = {"kind": "'grid'", "rows": 3, "columns": 3, "pitch_m": 0.012}
STACK = patch(**SMALL) + patch("q", 0x200, **SMALL, pose="{ xyz_m = [0, 0, 0.002] }")


def checked(tmp_path, text, capsys):
    file = tmp_path / "dense.toml"
    file.write_text(BUS + text)
    status = main(["check", str(file), "--json"])
    return file, status, json.loads(capsys.readouterr().out.splitlines()[-1])


@long_after_first(
    ("text", "line", "where"),
    [
        (GRID, 20, "patches[0] 'p' pitch_m: must be larger, for "),
        (LIST, 22, "patches[0] 'p' units[1] xyz_m: must be farther from p/0, for "),
        (STACK, 31, "patches[1] 'q' pose: must be farther from p/"),
    ],
)
def test_check_says_which_key_of_a_dense_skin_to_change(text, line, where, tmp_path, capsys):
    file, status, report = checked(tmp_path, text, capsys)
    assert status == 1
    assert not report["ok"]
    (message,) = report["too_dense"]
    assert message.startswith(f"{file}:{line}: {where}")
    assert re.search(r"\([pq]/\w+, [pq]/\w+, [pq]/\w+, … \d+ units\); got ", message)
    with pytest.raises(TooDenseError) as refused:
        skin.Decoder(topology.load(file), sweeps=1, ambient=False)
    assert str(refused.value) == message


def test_sound_skins_pass(tmp_path, capsys):
    for name in topology.builtin:
        assert main(["check", name]) == 0
    _, status, report = checked(tmp_path, patch(**SMALL), capsys)
    assert (status, report["too_dense"], report["ok"]) == (0, [], True)


def test_a_stencil_of_blocked_units_names_one():
    palm = topology.load("palm")
    close = topology.Topology(**{**vars(palm), "path": None, "position": palm.position * [[0.1]]})
    tilted = np.roll(close.rotation, 1, axis=0)
    close = topology.Topology(**{**vars(close), "rotation": tilted})
    with pytest.raises(TooDenseError, match=r"palm/r\dc\d: must keep its chip clear of its neig"):
        Stencil.of(close)
