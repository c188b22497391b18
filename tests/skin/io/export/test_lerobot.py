"""Data sets for LeRobot: read back by pyarrow and json alone, every window is the skin's own."""

from __future__ import annotations

import io
import json
import sys
from dataclasses import replace

import numpy as np
import pytest

import skin
import topology
from skin.cli import main
from skin.errors import LibraryError, OptionError, SkinError
from skin.io.export.lerobot import Dataset, Frame

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
image_library = pytest.importorskip("PIL.Image", reason="Pillow is not installed")

WINDOW = 8
PERIOD_NS = 4_000_000


def camera(states, count=40, seed=0):
    """Frames of a simulated camera at 30 fps, its clock a little off that of the skin."""
    rng = np.random.default_rng(seed)
    start_ns = states[0].stamp_ns + 60_000_000
    for k in range(count):
        stamp_ns = start_ns + round(k * 1e9 / 30) + int(rng.integers(-900_000, 900_000))
        pixels = rng.integers(0, 255, (12, 16, 3), np.uint8)
        yield Frame(stamp_ns, {"wrist": pixels}, {"action": np.array([k, -k], np.float32)})


@pytest.fixture(scope="module")
def folder(palm, states, tmp_path_factory):
    path = tmp_path_factory.mktemp("set") / "grasps"
    with Dataset(path, palm, fps=30, window=WINDOW) as grasps:
        grasps.add_episode(states, camera(states), "slide over the palm")
        grasps.add_episode(states, camera(states, 25, seed=1), "slide again")
        grasps.add_episode(states, camera(states, 10, seed=2), "slide over the palm")
    return path


def column(folder, name):
    return pq.read_table(folder / "data/chunk-000/file-000.parquet")[name]


def test_every_window_is_that_of_the_states(folder, states):
    """Looked up state by state, by time alone."""
    stamps = np.array([state.stamp_ns for state in states])
    force = np.array(column(folder, "observation.tactile.force_window").to_pylist(), np.float32)
    newest = np.array(column(folder, "observation.tactile.force").to_pylist(), np.float32)
    valid = np.array(column(folder, "observation.tactile.valid_window").to_pylist())
    seen = [*camera(states), *camera(states, 25, seed=1), *camera(states, 10, seed=2)]
    assert force.shape == (75, WINDOW, 64, 3)
    for row, frame in enumerate(seen):
        last = int(np.flatnonzero(stamps <= frame.stamp_ns)[-1])
        for back in range(WINDOW):
            units = states[last - back].units
            expected = np.where(units.valid, units.force, np.nan).T
            np.testing.assert_array_equal(force[row, WINDOW - 1 - back], expected)
            assert valid[row, WINDOW - 1 - back].tolist() == units.valid.tolist()
        np.testing.assert_array_equal(newest[row], force[row, -1])
    ages = column(folder, "tactile.age_s").to_pylist()
    told = column(folder, "tactile.stamp_ns").to_pylist()
    for age, skin_ns, frame in zip(ages, told, seen, strict=True):
        assert age == np.float32(1e-9 * (frame.stamp_ns - skin_ns))
        assert 0 <= frame.stamp_ns - skin_ns < PERIOD_NS


def test_temperature_wrench_and_contacts_are_those_of_the_newest_sample(folder, states):
    by_stamp = {state.stamp_ns: state for state in states}
    info = json.loads((folder / "meta/tactile.json").read_text())
    at = {name: i for i, name in enumerate(info["contact_columns"])}
    names = ("temperature", "wrench", "contacts", "valid")
    rows = zip(column(folder, "tactile.stamp_ns").to_pylist(),
               *(column(folder, f"observation.tactile.{name}").to_pylist() for name in names),
               strict=True)  # fmt: skip
    touched = 0
    for stamp_ns, temperature, wrench, contacts, valid in rows:
        state = by_stamp[stamp_ns]
        warm = np.where(state.units.valid, state.units.temperature, np.nan)
        np.testing.assert_array_equal(np.array(temperature, np.float32), warm)
        np.testing.assert_array_equal(np.array(wrench, np.float32), np.float32(state.wrench))
        assert valid == state.units.valid.tolist()
        told = np.array(contacts)
        assert np.isnan(told[len(state.contacts) :]).all()
        for one, contact in zip(told, state.contacts, strict=False):
            touched += 1
            assert one[at["id"]] == contact.id
            assert one[at["load"]] == np.float32(contact.load)
            assert one[at["mz"]] == np.float32(contact.wrench[5])
    assert touched


def test_images_come_back_without_loss(folder, states):
    files = column(folder, "observation.images.wrist").to_pylist()
    seen = [*camera(states), *camera(states, 25, seed=1), *camera(states, 10, seed=2)]
    for file, frame in zip(files, seen, strict=True):
        pixels = np.asarray(image_library.open(io.BytesIO(file["bytes"])))
        np.testing.assert_array_equal(pixels, frame.images["wrist"])


def test_episodes_tasks_and_numbers_are_as_lerobot_has_them(folder):
    info = json.loads((folder / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["splits"]) == ("v3.0", 30, {"train": "0:3"})
    assert [info[f"total_{name}"] for name in ("episodes", "frames", "tasks")] == [3, 75, 2]
    episodes = pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet")
    assert episodes["length"].to_pylist() == [40, 25, 10]
    assert episodes["dataset_from_index"].to_pylist() == [0, 40, 65]
    assert episodes["dataset_to_index"].to_pylist() == [40, 65, 75]
    tasks = pq.read_table(folder / "meta/tasks.parquet")
    assert tasks["task_index"].to_pylist() == [0, 1]
    assert tasks["__index_level_0__"].to_pylist() == ["slide over the palm", "slide again"]
    assert column(folder, "task_index").to_pylist() == [0] * 40 + [1] * 25 + [0] * 10
    assert column(folder, "index").to_pylist() == list(range(75))
    assert column(folder, "frame_index").to_pylist() == [*range(40), *range(25), *range(10)]
    np.testing.assert_allclose(
        column(folder, "timestamp").to_pylist()[40:65], np.arange(25) / 30, rtol=1e-6
    )
    table = pq.read_table(folder / "data/chunk-000/file-000.parquet")
    assert list(info["features"]) == table.column_names
    assert info["features"]["observation.tactile.force_window"]["shape"] == [WINDOW, 64, 3]


def test_statistics_are_those_of_all_frames(folder):
    stats = json.loads((folder / "meta/stats.json").read_text())
    warm = np.array(column(folder, "observation.tactile.temperature").to_pylist())
    told = stats["observation.tactile.temperature"]
    np.testing.assert_allclose(told["mean"], warm.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(told["std"], warm.std(axis=0), rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(told["max"], warm.max(axis=0))
    assert told["count"] == [75]
    force = np.array(column(folder, "observation.tactile.force").to_pylist())
    np.testing.assert_allclose(
        stats["observation.tactile.force"]["min"], np.nanmin(force, axis=(0, 1)), rtol=1e-6
    )
    image = stats["observation.images.wrist"]
    assert np.shape(image["mean"]) == (3, 1, 1)
    assert np.ravel(image["mean"]) == pytest.approx(0.5, abs=0.05)


def test_the_layout_and_the_alignment_stand_beside(folder, palm):
    told = json.loads((folder / "meta/tactile.json").read_text())
    assert told["units"] == list(palm.unit_names)
    np.testing.assert_array_equal(np.array(told["position_m"]).T, palm.position)
    np.testing.assert_array_equal(
        np.moveaxis(np.array(told["rotation_skin_unit"]), 0, 2), palm.rotation
    )
    first = told["alignment"][0]
    assert (first["frames"], first["without_sample"], first["window_gaps"]) == (40, 0, 0)
    assert first["age_s_max"] < 0.004
    assert 1e-4 < first["camera_jitter_s"] < 2e-3


def test_gaps_of_the_skin_are_not_filled(palm, states, tmp_path):
    cut = [state for state in states if not 60 <= state.cycle - states[0].cycle < 70]
    lost = states[0].stamp_ns + 60 * PERIOD_NS
    frames = [Frame(lost + at * PERIOD_NS + 1) for at in (-1, 3, 8, 9, 12, 17, 18)]
    with Dataset(tmp_path / "set", palm, fps=79, window=WINDOW) as grasps:
        told = grasps.add_episode(cut, frames, "none")
    # the second and third frame are over two periods from any sample
    assert told.without_sample == 3
    valid = np.array(column(tmp_path / "set", "observation.tactile.valid_window").to_pylist())
    full = np.array([state.units.valid.all() for state in states])
    assert full.all()
    rows = valid.all(axis=2).astype(int).tolist()
    assert rows == [[1] * 8, [0] * 8, [0] * 8, [0] * 8, [0] * 5 + [1] * 3, [1] * 8, [1] * 8]
    force = np.array(column(tmp_path / "set", "observation.tactile.force_window").to_pylist())
    assert (np.isnan(force).all(axis=(2, 3)) == ~valid.all(axis=2)).all()
    assert np.isnan(column(tmp_path / "set", "tactile.age_s").to_pylist()[1:4]).all()
    assert told.window_gaps == 3 * 8 + 5


def test_units_that_are_not_valid_are_not_filled(palm, states, tmp_path):
    valid = states[20].units.valid.copy()
    valid[5] = False
    dead = replace(states[20], units=replace(states[20].units, valid=valid))
    with Dataset(tmp_path / "set", palm, fps=30, window=1, fill=-1.0) as grasps:
        grasps.add_episode([dead], [Frame(dead.stamp_ns)], "none")
    force = np.array(column(tmp_path / "set", "observation.tactile.force").to_pylist())
    assert force[0, 5].tolist() == [-1.0] * 3
    assert column(tmp_path / "set", "observation.tactile.valid").to_pylist()[0] == valid.tolist()


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        ([0, 33, 32], "camera: frame 2: must be later than the frame before it; got one 0.001 s "
         "earlier"),
        ([0, 33, 33], "camera: frame 2: must be later than the frame before it; got one of the "
         "same time"),
        ([0, 2**45], "camera: frame 1: stamp_ns: must be an integer from 0 to 9.22337e\\+18; got"),
        ([9000], "episode 0: must have frames while the skin was read; got 1 frames, none within "
         "0.008 s after a sample \\(of two clocks\\?\\)"),
        ([], "episode 0: must have frames; got none"),
    ],
)  # fmt: skip
def test_clocks_that_cannot_be_are_refused_and_nothing_stays(
    palm, states, tmp_path, stamps, message
):
    frames = [Frame(states[0].stamp_ns + 1_000_000 * at) for at in stamps]
    grasps = Dataset(tmp_path / "set", palm, fps=30)
    with pytest.raises(SkinError, match=message):
        grasps.add_episode(states, frames, "none")
    assert list(tmp_path.iterdir()) == []


def test_a_skin_whose_time_runs_back_is_refused(palm, states, tmp_path):
    grasps = Dataset(tmp_path / "set", palm, fps=30)
    with pytest.raises(SkinError, match="must come after cycle"):
        grasps.add_episode(
            [states[9], states[3]], [Frame(states[9].stamp_ns), Frame(states[9].stamp_ns + 1)], "no"
        )


def test_states_that_lack_what_samples_have_are_refused(palm, states, log, tmp_path):
    for want, lacking in (
        (("force",), "temperature, wrench, contacts"),
        (("temperature", "force", "wrench"), "contacts"),
        (("temperature",), "force, wrench, contacts"),
    ):
        grasps = Dataset(tmp_path / "set", palm, fps=30)
        with pytest.raises(SkinError) as told:
            grasps.add_episode(
                skin.decode_log(palm, log, want=want), [Frame(states[9].stamp_ns)], "no"
            )
        assert str(told.value) == (
            f"skin: cycle {states[0].cycle}: must have temperature, force, wrench, contacts "
            f"(want=…); got a state without {lacking}"
        )
    assert list(tmp_path.iterdir()) == []


def test_states_of_another_skin_are_refused(states, tmp_path):
    with pytest.raises(SkinError, match="must be of the 10 units of the topology; got 64"):
        Dataset(tmp_path / "set", topology.load("strip"), fps=30).add_episode(
            states, [Frame(states[9].stamp_ns)], "no"
        )


@pytest.mark.parametrize("task", ["", " ", 3, "slide \udcff"])
def test_a_task_is_words(palm, states, tmp_path, task):
    with pytest.raises(OptionError) as told:
        Dataset(tmp_path / "set", palm, fps=30).add_episode(states, [], task)
    assert str(told.value) == f"task: must be words in UTF-8; got {task!r}"
    assert list(tmp_path.iterdir()) == []


def test_the_folder_may_be_a_link_but_not_where_this_runs(palm, states, tmp_path, monkeypatch):
    (tmp_path / "far").mkdir()
    (tmp_path / "set").symlink_to("far")
    with Dataset(tmp_path / "set", palm, fps=30) as grasps:
        grasps.add_episode(states, [Frame(states[9].stamp_ns)], "none")
    assert (tmp_path / "far/meta/info.json").is_file()
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for folder in (".", "../here"):
        with pytest.raises(SkinError) as told:
            Dataset(folder, palm, fps=30)
        assert str(told.value) == (
            f"{folder}: must be a new or empty folder; got the one this runs in"
        )


def test_frames_must_be_alike(palm, states, tmp_path):
    frames = [
        Frame(state.stamp_ns, {"wrist": np.zeros((4, size, 3), np.uint8)})
        for state, size in zip(states[:2], (6, 7), strict=True)
    ]
    with pytest.raises(SkinError) as told:
        Dataset(tmp_path / "set", palm, fps=30).add_episode(states, frames, "none")
    assert str(told.value) == (
        "camera: frame 1: observation.images.wrist: must be of shape (4, 6, 3), as in the first "
        "frame; got (4, 7, 3)"
    )


@pytest.mark.parametrize(
    "name", ["index", "timestamp", "action/grip", "tactile.age_s", "", 3, "\udcff"]
)
def test_names_that_features_have_already_are_refused(palm, states, tmp_path, name):
    frame = Frame(states[0].stamp_ns, values={name: np.zeros(2)})
    with pytest.raises(OptionError) as told:
        Dataset(tmp_path / "set", palm, fps=30).add_episode(states, [frame], "none")
    assert str(told.value) == (
        f"camera: frame 0: must have names without '/' that no other feature has; got {name!r}"
    )


def test_features_of_the_user_are_numbers_whatever_their_names(palm, states, tmp_path):
    given = {"gripper.valid_share": [0.5], "arm_stamp_ns": [1 << 24, 0.25], "is.valid": [0.25]}
    with Dataset(tmp_path / "set", palm, fps=30) as grasps:
        grasps.add_episode(states, [Frame(states[0].stamp_ns, values=given)], "none")
    told = {name: column(tmp_path / "set", name).to_pylist()[0] for name in given}
    assert told == {
        "gripper.valid_share": 0.5, "arm_stamp_ns": [16777216.0, 0.25], "is.valid": 0.25,
    }  # fmt: skip
    info = json.loads((tmp_path / "set/meta/info.json").read_text())["features"]
    assert {info[name]["dtype"] for name in given} == {"float32"}
    assert info["observation.tactile.valid_window"]["dtype"] == "bool"
    assert info["camera.stamp_ns"]["dtype"] == info["tactile.stamp_ns"]["dtype"] == "int64"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.zeros(0), "must have numbers; got none, shape (0,)"),
        ("x", "must be an array of numbers; got 'x'"),
        ([[1.0], [1.0, 2.0]], "must be an array of numbers; got [[1.0], [1.0, 2.0]]"),
        (np.float64(1e39), "must be finite as float32; got 1e+39"),
        (
            np.array([1, -(2**63)], np.int64) + 1,
            "must be a number that float32 holds exactly, where it is beyond 16777216; got "
            "-9223372036854775807",
        ),
    ],
)
def test_values_that_float32_does_not_hold_are_refused(palm, states, tmp_path, value, message):
    frame = Frame(states[0].stamp_ns, values={"action": value})
    with pytest.raises(SkinError) as told:
        Dataset(tmp_path / "set", palm, fps=30).add_episode(states, [frame], "none")
    assert str(told.value) == f"camera: frame 0: 'action': {message}"
    assert list(tmp_path.iterdir()) == []


def test_half_floats_and_flags_are_taken(palm, states, tmp_path):
    given = {"half": np.array([0.5, 65504.0], np.float16), "flag": True, "none": np.nan}
    with Dataset(tmp_path / "set", palm, fps=30) as grasps:
        grasps.add_episode(states, [Frame(states[0].stamp_ns, values=given)], "none")
    assert column(tmp_path / "set", "half").to_pylist() == [[0.5, 65504.0]]
    assert column(tmp_path / "set", "flag").to_pylist() == [1.0]


def test_images_that_are_none_are_refused(palm, states, tmp_path):
    frame = Frame(states[0].stamp_ns, {"wrist": b"no image"})
    with pytest.raises(SkinError, match="camera: frame 0: 'wrist': must be a PNG or JPEG file"):
        Dataset(tmp_path / "set", palm, fps=30).add_episode(states, [frame], "none")


def file_of(mode, kind="PNG"):
    """The file of an image of noise, which does not pack well."""
    rgb = np.random.default_rng(7).integers(0, 255, (40, 50, 3), np.uint8)
    out = io.BytesIO()
    image_library.fromarray(rgb).convert(mode).save(out, format=kind)
    return out.getvalue()


@pytest.mark.parametrize(
    ("mode", "kind"), [("L", "PNG"), ("RGBA", "PNG"), ("P", "PNG"), ("L", "JPEG"), ("CMYK", "JPEG")]
)
def test_images_of_other_colours_are_refused(palm, states, tmp_path, mode, kind):
    frames = [
        Frame(states[at].stamp_ns, {"wrist": file_of(one, kind)})
        for at, one in ((0, "RGB"), (1, mode))
    ]
    with pytest.raises(SkinError) as told:
        Dataset(tmp_path / "set", palm, fps=30).add_episode(states, frames, "none")
    assert str(told.value) == (
        f"camera: frame 1: 'wrist': must be an image of RGB; got one of {mode}"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_images_that_are_not_whole_are_refused(palm, states, tmp_path, kind, share):
    """Not only those that the statistics look at."""
    whole = file_of("RGB", kind)
    files = [whole] * 40
    files[37] = whole[: int(share * len(whole))]
    frames = [Frame(states[at].stamp_ns, {"wrist": file}) for at, file in enumerate(files)]
    with pytest.raises(SkinError, match="camera: frame 37: 'wrist': must be a"):
        Dataset(tmp_path / "set", palm, fps=30).add_episode(states, frames, "none")


def test_what_is_neither_pixels_nor_a_file_is_refused(palm, states, tmp_path):
    for image, message in (
        ("a.png", "must be pixels or the bytes of a file; got 'a.png'"),
        (np.zeros((0, 4, 3), np.uint8), "must be pixels, shape (h, w, 3), uint8; got (0, 4, 3), "
         "uint8"),
    ):  # fmt: skip
        with pytest.raises(SkinError) as told:
            Dataset(tmp_path / "set", palm, fps=30).add_episode(
                states, [Frame(states[0].stamp_ns, {"wrist": image})], "none"
            )
        assert str(told.value) == f"camera: frame 0: 'wrist': {message}"


def test_a_folder_with_files_is_left_alone(palm, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(SkinError, match="must be a new or empty folder; got one with files in it"):
        Dataset(tmp_path, palm, fps=30)
    assert (tmp_path / "mine.txt").read_text() == "mine"


def test_options_that_cannot_be_are_refused(palm, tmp_path):
    with pytest.raises(OptionError, match=r"fps: must be an integer from 1 to 1000; got 29\.97"):
        Dataset(tmp_path / "set", palm, fps=29.97)
    with pytest.raises(SkinError, match="set: must have an episode; got none"):
        Dataset(tmp_path / "set", palm, fps=30).close()
    assert list(tmp_path.iterdir()) == []


def test_large_data_sets_go_on_in_further_files(palm, states, tmp_path, monkeypatch):
    monkeypatch.setattr("skin.io.export.lerobot_files.FILE_MB", 0)
    with Dataset(tmp_path / "set", palm, fps=30) as grasps:
        for _ in range(2):
            grasps.add_episode(states, [Frame(states[20].stamp_ns)], "none")
    files = sorted((tmp_path / "set/data/chunk-000").iterdir())
    assert [pq.read_table(file)["episode_index"].to_pylist() for file in files] == [[0], [1]]
    episodes = pq.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet")
    assert episodes["data/file_index"].to_pylist() == [0, 1]


def test_without_pillow_the_message_names_the_extra(palm, states, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    frame = Frame(states[0].stamp_ns, {"wrist": b""})
    with pytest.raises(LibraryError) as told:
        Dataset(tmp_path / "set", palm, fps=30).add_episode(states, [frame], "none")
    assert str(told.value) == (
        "camera: frame 0: 'wrist': must have Pillow to be read; not installed: "
        "pip install 'f3t-skin[data]'"
    )


def test_lerobot_itself_reads_every_window(folder, states):
    lerobot = pytest.importorskip(
        "lerobot.datasets.lerobot_dataset", reason="lerobot is not installed"
    )
    read = lerobot.LeRobotDataset("local/grasps", root=folder)
    assert (read.num_episodes, read.num_frames, read.fps) == (3, 75, 30)
    force = column(folder, "observation.tactile.force_window").to_pylist()
    for row, frame in enumerate(camera(states)):
        item = read[row]
        told = item["observation.tactile.force_window"].numpy()
        np.testing.assert_array_equal(told, np.array(force[row], np.float32))
        image = np.rint(255 * item["observation.images.wrist"].numpy())
        np.testing.assert_array_equal(image, frame.images["wrist"].transpose(2, 0, 1))
        assert item["task"] == "slide over the palm"


def test_the_command_takes_a_table_of_frames(log, states, tmp_path, capsys):
    frames = list(camera(states, 12))
    rows = ["stamp_ns,wrist,action.grip"]
    for k, frame in enumerate(frames):
        image_library.fromarray(frame.images["wrist"]).save(tmp_path / f"{k}.png")
        rows.append(f"{frame.stamp_ns - 2_000_000},{k}.png,{k / 4}")
    (tmp_path / "frames.csv").write_text("\n".join(rows))
    given = ["export", "lerobot", str(log), "--topology", "palm", "--frames",
             str(tmp_path / "frames.csv"), "-o", str(tmp_path / "set"), "--task", "slide",
             "--window", "2", "--offset-s", "0.002", "--json"]  # fmt: skip
    assert main(given) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (report["frames"], report["alignment"][0]["without_sample"]) == (12, 0)
    table = pq.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    assert table["action"].to_pylist() == [k / 4 for k in range(12)]
    assert table["camera.stamp_ns"].to_pylist() == [frame.stamp_ns for frame in frames]
    first = table["observation.images.wrist"].to_pylist()[0]
    assert first["bytes"] == (tmp_path / "0.png").read_bytes()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "time,wrist\n1,a.png\n",
            "1: must have a column stamp_ns or time_s; got ['time', 'wrist']",
        ),
        ("time_s,grip\n1,2\n2,x\n", "3: grip: must be a number, or the name of an image; got 'x'"),
        ("time_s,grip\n1,2,3\n", "2: must have 2 cells; got 3"),
        ("stamp_ns,grip\n1.5,2\n", "2: stamp_ns: must be an integer; got '1.5'"),
    ],
)
def test_tables_of_frames_are_refused_by_line(text, message, log, tmp_path, capsys):
    file = tmp_path / "frames.csv"
    file.write_text(text)
    given = ["export", "lerobot", str(log), "--topology", "palm", "--frames", str(file), "-o",
             str(tmp_path / "set"), "--task", "slide"]  # fmt: skip
    assert main(given) == 2
    assert capsys.readouterr().err.strip().endswith(f"{file}:{message}")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["frames.csv"]
