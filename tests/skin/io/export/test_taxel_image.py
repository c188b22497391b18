"""Forces of a patch as an image: each cell is the unit of its row and column."""

from __future__ import annotations

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest

import topology
from skin.cli import main
from skin.errors import OptionError, SkinError
from skin.io.export import TaxelGrid
from skin.io.export.lerobot import Dataset, Frame


def reading(skin, *shape):
    """A reading whose forces are the number of the unit, its row in the array, and the cycle."""
    n = skin.n
    force = np.zeros((*shape, 3, n), np.float32)
    force += np.arange(n) + 1000.0 * np.arange(3)[:, np.newaxis]
    return SimpleNamespace(force=force, valid=np.ones((*shape, n), bool))


def test_every_unit_of_a_grid_is_at_its_row_and_column_and_place():
    hand = topology.load("palm")
    image = TaxelGrid(hand)(reading(hand))
    assert image.force.shape == (8, 8, 3)
    assert image.force.dtype == np.float32
    assert image.valid.all()
    for i, name in enumerate(hand.unit_names):
        row, column = map(int, name.removeprefix("palm/r").split("c"))
        np.testing.assert_array_equal(image.force[row, column], [i, 1000 + i, 2000 + i])
    x = hand.position[0][image.force[..., 0].astype(int)]
    y = hand.position[1][image.force[..., 0].astype(int)]
    np.testing.assert_allclose(np.diff(x, axis=1), 0.012)
    np.testing.assert_allclose(np.diff(y, axis=0), 0.012)


def test_what_is_not_valid_is_nan_and_masked():
    palm = topology.load("palm")
    values = reading(palm)
    values.valid[10] = False
    values.force[1, 20] = np.nan
    image = TaxelGrid(palm, "palm")(values)
    wrong = np.zeros(64, bool)
    wrong[[10, 20]] = True
    np.testing.assert_array_equal(image.valid, ~wrong.reshape(8, 8))
    assert np.isnan(image.force[~image.valid]).all()
    assert np.isfinite(image.force[image.valid]).all()
    assert np.isfinite(values.force[:, 10]).all()  # the state's own array stays


def test_many_cycles_give_as_many_images():
    palm = topology.load("palm")
    values = reading(palm, 5)
    values.valid[3, 0] = False
    image = TaxelGrid(palm)(values)
    assert image.force.shape == (5, 8, 8, 3)
    assert np.argwhere(~image.valid).tolist() == [[3, 0, 0]]


def test_given_cells_place_units_and_leave_holes():
    gripper = topology.load("gripper")
    patch = gripper.patch_names[1]
    units = np.flatnonzero(gripper.patch == 1)
    cells = [[units[3], -1, units[0]]]
    image = TaxelGrid(gripper, patch, cells)(reading(gripper))
    assert image.valid.tolist() == [[True, False, True]]
    assert image.force[0, [0, 2], 0].tolist() == [units[3], units[0]]
    assert np.isnan(image.force[0, 1]).all()


@pytest.mark.parametrize(
    ("name", "patch", "cells", "words"),
    [
        ("hand", None, None, "patch: must be one of "),
        ("palm", "plam", None, "patch: must be 'palm'; got 'plam'"),
        *(("palm", "palm", cells, "cells: must be units of the patch, 0 to 63, each once, or -1")
          for cells in ([1, 2], [[1.5]], [[1], [2, 3]], [[1, 64]], [[1, 1]], [[]])),
    ],
)  # fmt: skip
def test_what_cannot_be_an_image_is_refused(name, patch, cells, words):
    with pytest.raises(OptionError) as raised:
        TaxelGrid(topology.load(name), patch, cells)
    assert words in str(raised.value)


def test_a_patch_without_rows_and_columns_needs_cells():
    palm = topology.load("palm")
    listed = dataclasses.replace(palm, unit_names=tuple(f"palm/{i}" for i in range(palm.n)))
    with pytest.raises(OptionError) as raised:
        TaxelGrid(listed)
    assert str(raised.value) == (
        "patch 'palm': must have rows and columns, or `cells` with the unit of each cell; "
        "got a unit '0'"
    )
    assert TaxelGrid(listed, cells=np.arange(64).reshape(4, 16)).cells.shape == (4, 16)


def test_a_state_of_another_skin_is_refused():
    grid = TaxelGrid(topology.load("palm"))
    with pytest.raises(SkinError, match="must be a state of 64 units; got one of 10"):
        grid(reading(topology.load("strip")))


def test_a_data_set_has_the_images_of_its_samples(palm, states, pipeline, tmp_path):
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    frames = [Frame(state.stamp_ns, {}, {"action": np.zeros(1)}) for state in states[100:200:10]]
    with Dataset(tmp_path / "set", palm, fps=25, window=2, taxels=["palm"]) as written:
        written.add_episode(states, frames, "slide", pipeline)
    rows = pq.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    image = np.array(rows["observation.tactile.image.palm"].to_pylist(), np.float32)
    valid = np.array(rows["observation.tactile.image_valid.palm"].to_pylist())
    flat = np.array(rows["observation.tactile.force"].to_pylist(), np.float32)
    np.testing.assert_array_equal(image.reshape(-1, 64, 3), flat)
    np.testing.assert_array_equal(valid.reshape(-1, 64), np.isfinite(flat).all(axis=2))
    info = json.loads((tmp_path / "set/meta/info.json").read_text())["features"]
    assert info["observation.tactile.image.palm"]["shape"] == [8, 8, 3]
    taxels = json.loads((tmp_path / "set/meta/tactile.json").read_text())["taxels"]
    assert taxels == {"palm": np.arange(64).reshape(8, 8).tolist()}


def test_the_command_takes_patches_and_names_the_ones_there_are(
    log, states, camera_folder, tmp_path, capsys
):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    frames = camera_folder([state.stamp_ns for state in states[100:130:10]])
    command = ["export", "lerobot", str(log), "--topology", "palm", "--frames", str(frames),
               "--task", "slide", "--fps", "25"]  # fmt: skip
    status = main([*command, "-o", str(tmp_path / "no"), "--taxel-image", "plam"])
    assert status == 2
    assert "patch: must be 'palm'; got 'plam'" in capsys.readouterr().err
    assert main([*command, "-o", str(tmp_path / "set"), "--taxel-image", "palm"]) == 0
