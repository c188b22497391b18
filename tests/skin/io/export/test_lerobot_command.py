"""`skin export lerobot`: recordings as episodes; what is wrong ends with a message and status 2."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest

import skin
from skin.cli import main

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")

STAMP = "must be from 0 to 9223372036854775807 ns on the clock of the skin; got "


def recorded(file):
    """States of a run, and its recording."""
    pytest.importorskip("mcap", reason="mcap is not installed")
    with skin.open("strip", simulate=True, pace=False, record=file) as strip:
        return [state.copy() for state in itertools.islice(strip, 200)]


def command(source, frames, folder, *more, topology="strip"):
    return ["export", "lerobot", str(source), "--topology", topology, "--frames", str(frames),
            "-o", str(folder), "--task", "press", "--fps", "28", "--json", *more]  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    return file, recorded(file)


@pytest.mark.long
def test_a_recording_is_an_episode_with_the_states_of_its_run(
    run, camera_folder, image_file, tmp_path, capsys
):
    file, states = run
    offset_ns = 2_000_000
    frames = camera_folder([state.stamp_ns + 1000 - offset_ns for state in states[20:200:9]])
    assert main(command(file, frames, tmp_path / "set", "--offset-s", "0.002")) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (report["frames"], report["faults"]) == (20, [])
    table = pq.read_table(tmp_path / "set/data")
    force = np.array(table["observation.tactile.force"].to_pylist(), np.float32)
    wrench = np.array(table["observation.tactile.wrench"].to_pylist(), np.float32)
    for at, state in enumerate(states[20:200:9]):
        expected = np.where(state.units.valid, state.units.force, np.nan).T
        np.testing.assert_array_equal(force[at], expected)
        np.testing.assert_array_equal(wrench[at], np.float32(state.wrench))
    assert np.nanmax(force[..., 2]) > 0.1, "nothing was pressed"
    files = {one["bytes"] for one in table["observation.images.camera"].to_pylist()}
    assert files == {image_file()}


def test_a_recording_needs_no_topology_and_frames_of_before_it_are_no_error(
    run, camera_folder, tmp_path, capsys
):
    """A camera that starts a frame earlier than the skin."""
    file, states = run
    first = states[0].stamp_ns
    frames = camera_folder([first - 10_000_000, *(one.stamp_ns for one in states[3:200:9])])
    given = command(file, frames, tmp_path / "set")
    del given[3:5]
    assert main(given) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (report["frames"], report["alignment"][0]["without_sample"]) == (23, 1)
    far = camera_folder([first - 10_000_000 * k for k in (3, 2, 1)], "far")
    assert main(command(file, far, tmp_path / "none")) == 2  # no frame at all has one
    assert "none within" in capsys.readouterr().err


def test_what_cannot_be_an_episode_is_refused(run, log, camera_folder, tmp_path, capsys):
    file, states = run
    frames = camera_folder([state.stamp_ns for state in states[20:200:9]])
    given = command(log, frames, tmp_path / "set")
    del given[3:5]
    assert main(given) == 2
    assert "--topology: must be given with logs; got none" in capsys.readouterr().err
    assert main(command(file, frames, tmp_path / "set", topology="palm")) == 2
    assert capsys.readouterr().err.startswith(
        f"{file}: topology: must be recorded with 'palm' as it is now; got differences in "
    )
    assert not (tmp_path / "set").exists()


def test_folders_of_frames_that_cannot_be_end_with_a_message(run, image_file, tmp_path, capsys):
    (folder := tmp_path / "frames").mkdir()
    cases = (
        ({}, f"{folder}: must have images (.jpeg, .jpg, .png); got none"),
        (
            {"5.png": image_file()[:2000]},
            "camera: frame 0: 'camera': must be a whole image; got: image file is truncated",
        ),
        (
            {"5.png": b"", "5.jpg": b""},
            f"{folder}/5.png: must be the only image of its time; got '5.jpg', too",
        ),
        ({f"{'9' * 30}.png": b""}, f"{folder}/{'9' * 30}.png: {STAMP}{'9' * 30}"),
        ({"a.png": b""}, f"{folder}/a.png: must be named by the time of its frame in ns, as "
         "1700000000000000000.png; got 'a.png'"),
    )  # fmt: skip
    for files, message in cases:
        for name, data in files.items():
            (folder / name).write_bytes(data)
        assert main(command(run[0], folder, tmp_path / "set")) == 2
        assert capsys.readouterr().err == f"{message}\n"
        assert not (tmp_path / "set").exists()
        for name in files:
            (folder / name).unlink()
    assert main(command(run[0], tmp_path / "no", tmp_path / "set")) == 2
    assert "no: must be a folder of images named by their stamps" in capsys.readouterr().err
