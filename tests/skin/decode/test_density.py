"""Units too near to each other: found by `skin check`, with what to change, and only where true."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

import skin
import topology
from skin.cli import main
from skin.decode.density import contraction_of
from skin.errors import TooDenseError
from skin.physics.stencil import Stencil
from skin.physics.stray import powers
from tests.fixtures.cases import long_after_first
from tests.skin.decode.test_crosstalk import made_up, plane

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
    _, status, report = checked(tmp_path, patch(**SMALL), capsys)
    assert (status, report["too_dense"], report["ok"]) == (0, [], True)


def test_a_stencil_of_blocked_units_names_one():
    palm = topology.load("palm")
    close = topology.Topology(**{**vars(palm), "path": None, "position": palm.position * [[0.1]]})
    tilted = np.roll(close.rotation, 1, axis=0)
    close = topology.Topology(**{**vars(close), "rotation": tilted})
    with pytest.raises(TooDenseError, match=r"palm/r\dc\d: must keep its chip clear of its neig"):
        Stencil.of(close)


def test_a_sweep_leaves_of_a_pair_what_each_adds_at_the_other_over_its_own_slope():
    """By hand: 1e-3 (1 + 2 H) of the strength per mm, over k M0(H); the most of five depths."""
    pair, exponents = plane(1, 2), powers(2)
    stencil, added = made_up(pair, 2), np.zeros((2, 3, len(exponents)))
    for axis, (i, j) in enumerate(((1, 0), (0, 1))):
        for depth, slope in ((0, 1e-3), (1, 2e-3)):
            added[:, axis, (exponents == (i, j, depth)).all(axis=1)] = slope
    stencil = dataclasses.replace(stencil, coefficients=added)
    p, depth = pair.parameters, np.linspace(0.0, 2.0, 5)
    steep = p["field_wavenumber_rad_per_mm"] * p["field_amplitude_ut"]
    steep = steep[0] * np.exp(0.72 * (depth - p["field_reference_mm"][0]))
    share = 1e-3 * (1.0 + 2.0 * depth) * np.sqrt(stencil.strength.prod()) / steep
    assert contraction_of(pair, stencil) == pytest.approx(share.max(), rel=1e-6)
