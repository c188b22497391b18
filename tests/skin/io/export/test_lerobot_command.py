"""`skin export lerobot`: recordings as episodes; what is wrong ends with a message and status 2."""

from __future__ import annotations

import io
import itertools
import json

import numpy as np
import pytest

import skin
from bus.logs import write
from skin.cli import main
from tests.fixtures.live import frames_of

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
image_library = pytest.importorskip("PIL.Image", reason="Pillow is not installed")

STAMP = "must be from 0 to 9223372036854775807 ns on the clock of the skin; got "


def recorded(file, **options):
    """States of a run, and its recording."""
    pytest.importorskip("mcap", reason="mcap is not installed")
    with skin.open("strip", simulate=True, pace=False, record=file, **options) as strip:
        return [state.copy() for state in itertools.islice(strip, 200)]


def command(source, frames, folder, topology="strip", task="press", offset_s="0"):
    return ["export", "lerobot", str(source), "--topology", topology, "--frames", str(frames),
            "-o", str(folder), "--task", task, "--offset-s", offset_s, "--json"]  # fmt: skip


def table_of(states, tmp_path):
    file = tmp_path / "frames.csv"
    rows = [f"{state.stamp_ns + 1000},{at}" for at, state in enumerate(states[20:200:9])]
    file.write_text("\n".join(["stamp_ns,action.grip", *rows]))
    return file


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    return file, recorded(file, dtype="float64")


def test_a_recording_is_an_episode_with_the_states_of_its_run(run, tmp_path, capsys):
    file, states = run
    frames = table_of(states, tmp_path)
    assert main(command(file, frames, tmp_path / "set")) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (report["frames"], report["faults"]) == (20, [])
    table = pq.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    force = np.array(table["observation.tactile.force"].to_pylist(), np.float32)
    wrench = np.array(table["observation.tactile.wrench"].to_pylist(), np.float32)
    for at, state in enumerate(states[20:200:9]):
        expected = np.where(state.units.valid, state.units.force, np.nan).T
        np.testing.assert_array_equal(force[at], np.float32(expected))
        np.testing.assert_array_equal(wrench[at], np.float32(state.wrench))
    assert np.nanmax(force[..., 2]) > 0.1, "nothing was pressed"


def test_a_recording_needs_no_topology_and_frames_of_before_it_are_no_error(run, tmp_path, capsys):
    """A camera that starts a frame earlier than the skin."""
    file, states = run
    frames = table_of(states, tmp_path)
    head, *rows = frames.read_text().splitlines()
    before = f"{states[0].stamp_ns - 10_000_000},0"
    frames.write_text("\n".join([head, before, *rows]))
    given = [word for word in command(file, frames, tmp_path / "set") if word != "strip"]
    given.remove("--topology")
    assert main(given) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (report["frames"], report["alignment"][0]["without_sample"]) == (21, 1)
    far = [head, *(f"{states[0].stamp_ns - 10_000_000 * k},0" for k in (3, 2, 1))]
    frames.write_text("\n".join(far))
    given[given.index(str(tmp_path / "set"))] = str(tmp_path / "none")
    assert main(given) == 2  # no frame at all has one
    assert "none within" in capsys.readouterr().err


def test_a_log_needs_its_topology(log, tmp_path, capsys):
    given = [word for word in command(log, tmp_path / "f.csv", tmp_path / "set") if word != "strip"]
    given.remove("--topology")
    assert main(given) == 2
    assert "--topology: must be given with logs; got none" in capsys.readouterr().err


def test_a_recording_of_another_skin_is_refused(run, tmp_path, capsys):
    file, states = run
    assert main(command(file, table_of(states, tmp_path), tmp_path / "set", "palm")) == 2
    assert capsys.readouterr().err.startswith(
        f"{file}: topology: must be recorded with 'palm' as it is now; got differences in "
    )
    assert not (tmp_path / "set").exists()


def test_a_recording_without_what_samples_have_is_refused(tmp_path, capsys):
    states = recorded(tmp_path / "run.mcap", want={"temperature", "force"})
    frames = table_of(states, tmp_path)
    assert main(command(tmp_path / "run.mcap", frames, tmp_path / "set")) == 2
    assert capsys.readouterr().err == (
        "skin: cycle 0: must have temperature, force, wrench, contacts (want=…); got a state "
        "without wrench, contacts\n"
    )
    assert not (tmp_path / "set").exists()


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    file = tmp_path_factory.mktemp("log") / "strip.log"
    write(file, frames_of("strip", "press", 50))
    return file


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"stamp_ns,grip\n{'9' * 30},1\n", f":2: {STAMP}{'9' * 30}"),
        (f"stamp_ns,grip\n{'9' * 19},1\n", f":2: {STAMP}{'9' * 19}"),
        ("time_s,grip\n1e10,1\n", f":2: {STAMP}10000000000000000000"),
        ("time_s,grip\n1e300,1\n", f":2: {STAMP}1000"),
        (f"time_s,grip\n1,{'1' * 131073}\n", ":2: must be a row of a CSV table; got: field larger"),
        ("time_s,grip\n1,2\n1,3\n", ":3: must be later than the frame before it; got one of the"),
        ("time_s,grip\n1,1e39\n", ":2: grip: must be finite as float32; got 1e+39"),
    ],
)
def test_tables_that_cannot_be_end_with_their_line(text, message, log, tmp_path, capsys):
    file = tmp_path / "frames.csv"
    file.write_text(text)
    assert main(command(log, file, tmp_path / "set")) == 2
    assert capsys.readouterr().err.startswith(f"{file}{message}")
    assert [path.name for path in tmp_path.iterdir()] == ["frames.csv"]


def test_options_that_cannot_be_end_with_a_message(log, tmp_path, capsys, monkeypatch):
    frames = tmp_path / "frames.csv"
    frames.write_text("stamp_ns,grip\n1700000000000000000,1\n")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for options, message in (
        ({"offset_s": "9e9"}, f"{frames}:2: {STAMP}10700000000000000000"),
        ({"task": "slide \udcff"}, "task: must be words in UTF-8; got 'slide \\udcff'"),
        ({"folder": "set\udcff"}, "folder: must be a path in UTF-8; got 'set\\udcff'"),
        ({"folder": "."}, ".: must be a new or empty folder; got the one this runs in"),
    ):
        assert main(command(**{"source": log, "frames": frames, "folder": "set"} | options)) == 2
        assert capsys.readouterr().err == f"{message}\n"
    assert list((tmp_path / "here").iterdir()) == []


def test_images_that_cannot_be_end_with_a_message(log, tmp_path, capsys):
    out = io.BytesIO()
    noise = np.random.default_rng(7).integers(0, 255, (40, 50, 3), np.uint8)
    image_library.fromarray(noise).save(out, format="PNG")
    folder = tmp_path / "frames"
    folder.mkdir()
    cases = (
        (
            {"5.png": out.getvalue()[:2000]},
            "camera: frame 0: 'camera': must be a whole image; got: image file is truncated",
        ),
        (
            {"5.png": b"", "5.jpg": b""},
            f"{folder}/5.png: must be the only image of its time; got '5.jpg', too",
        ),
        ({f"{'9' * 30}.png": b""}, f"{folder}/{'9' * 30}.png: {STAMP}{'9' * 30}"),
    )
    for files, message in cases:
        for name, data in files.items():
            (folder / name).write_bytes(data)
        assert main(command(log, folder, tmp_path / "set")) == 2
        assert capsys.readouterr().err == f"{message}\n"
        assert not (tmp_path / "set").exists()
        for name in files:
            (folder / name).unlink()
