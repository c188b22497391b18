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
from bus.assemble import Assembler
from skin.errors import LibraryError, OptionError, SkinError
from skin.io.export.lerobot import Dataset, Frame
from skin.io.export.lerobot_files import statistics, together
from skin.io.export.provenance import calibration_hashes
from skin.options import Options
from tests.fixtures.logs import read_all

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
image_library = pytest.importorskip("PIL.Image", reason="Pillow is not installed")

WINDOW = 8
PERIOD_NS = 4_000_000
EPISODES = ((40, 0, "slide over the palm"), (25, 1, "slide again"), (10, 2, "slide over the palm"))


def camera(states, count=40, seed=0):
    """Frames of a simulated camera at 30 fps, its clock a little off that of the skin."""
    rng = np.random.default_rng(seed)
    start_ns = states[0].stamp_ns + 60_000_000
    for k in range(count):
        stamp_ns = start_ns + round(k * 1e9 / 30) + int(rng.integers(-900_000, 900_000))
        pixels = rng.integers(0, 255, (12, 16, 3), np.uint8)
        yield Frame(stamp_ns, {"wrist": pixels}, {"action": np.array([k, -k], np.float32)})


@pytest.fixture(scope="module")
def folder(palm, log, states, tmp_path_factory):
    path = tmp_path_factory.mktemp("set") / "grasps"
    with Dataset(path, palm, fps=30, window=WINDOW) as grasps:
        for count, seed, task in EPISODES:
            grasps.add_episode(skin.decode_log(palm, log), camera(states, count, seed), task)
    return path


@pytest.fixture
def written(palm, pipeline, tmp_path):
    """A function: a data set of one episode of these states and frames."""

    def write(states, frames, task="none", **options):
        with Dataset(tmp_path / "set", palm, **{"fps": 30} | options) as one:
            return one.add_episode(states, frames, task, pipeline)

    return write


def column(folder, name):
    return pq.read_table(folder / "data")[name]


def seen(states):
    return [frame for count, seed, _ in EPISODES for frame in camera(states, count, seed)]


@pytest.mark.long
def test_every_window_is_that_of_the_states(folder, states):
    """Looked up state by state, by time alone."""
    stamps = np.array([state.stamp_ns for state in states])
    force = np.array(column(folder, "observation.tactile.force_window").to_pylist(), np.float32)
    newest = np.array(column(folder, "observation.tactile.force").to_pylist(), np.float32)
    valid = np.array(column(folder, "observation.tactile.valid_window").to_pylist())
    assert force.shape == (75, WINDOW, 64, 3)
    for row, frame in enumerate(seen(states)):
        last = int(np.flatnonzero(stamps <= frame.stamp_ns)[-1])
        for back in range(WINDOW):
            units = states[last - back].units
            expected = np.where(units.valid, units.force, np.nan).T
            np.testing.assert_array_equal(force[row, WINDOW - 1 - back], expected)
            assert valid[row, WINDOW - 1 - back].tolist() == units.valid.tolist()
        np.testing.assert_array_equal(newest[row], force[row, -1])
    ages = column(folder, "tactile.age_s").to_pylist()
    told = column(folder, "tactile.stamp_ns").to_pylist()
    for age, skin_ns, frame in zip(ages, told, seen(states), strict=True):
        assert age == np.float32(1e-9 * (frame.stamp_ns - skin_ns))
        assert 0 <= frame.stamp_ns - skin_ns < PERIOD_NS


def test_other_features_are_those_of_the_newest_sample(folder, palm, log, states):
    by_stamp = {state.stamp_ns: state for state in states}
    wire = {one.stamp_ns: one.counts.copy() for one in Assembler(palm).feed(read_all(log))}
    info = json.loads((folder / "meta/tactile.json").read_text())
    at = {name: i for i, name in enumerate(info["contact_columns"])}
    assert info["count_channels"] == list(topology.CHANNELS)
    names = ("temperature", "wrench", "contacts", "valid", "counts")
    rows = zip(column(folder, "tactile.stamp_ns").to_pylist(),
               *(column(folder, f"observation.tactile.{name}").to_pylist() for name in names),
               strict=True)  # fmt: skip
    touched = 0
    for stamp_ns, temperature, wrench, contacts, valid, counts in rows:
        state = by_stamp[stamp_ns]
        np.testing.assert_array_equal(counts, wire[stamp_ns])
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
    assert touched


def test_images_come_back_without_loss(folder, states):
    files = column(folder, "observation.images.wrist").to_pylist()
    for file, frame in zip(files, seen(states), strict=True):
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
    assert episodes["data/file_index"].to_pylist() == [0, 1, 2]
    tasks = pq.read_table(folder / "meta/tasks.parquet")
    assert tasks["task_index"].to_pylist() == [0, 1]
    assert tasks["__index_level_0__"].to_pylist() == ["slide over the palm", "slide again"]
    assert column(folder, "task_index").to_pylist() == [0] * 40 + [1] * 25 + [0] * 10
    assert column(folder, "index").to_pylist() == list(range(75))
    assert column(folder, "frame_index").to_pylist() == [*range(40), *range(25), *range(10)]
    np.testing.assert_allclose(
        column(folder, "timestamp").to_pylist()[40:65], np.arange(25) / 30, rtol=1e-6
    )
    table = pq.read_table(folder / "data/chunk-000/file-001.parquet")
    assert list(info["features"]) == table.column_names
    assert info["features"]["observation.tactile.force_window"]["shape"] == [WINDOW, 64, 3]
    assert info["features"]["observation.tactile.counts"]["dtype"] == "int16"


def test_statistics_are_those_of_all_frames(folder):
    stats = json.loads((folder / "meta/stats.json").read_text())
    warm = np.array(column(folder, "observation.tactile.temperature").to_pylist())
    told = stats["observation.tactile.temperature"]
    np.testing.assert_allclose(told["mean"], warm.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(told["std"], warm.std(axis=0), rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(told["max"], warm.max(axis=0))
    assert told["count"] == [75]
    image = stats["observation.images.wrist"]
    assert np.shape(image["mean"]) == (3, 1, 1)
    assert np.ravel(image["mean"]) == pytest.approx(0.5, abs=0.05)


def test_statistics_leave_out_what_is_not_finite_and_add_up():
    found = statistics(np.array([[1.0, np.nan], [np.nan, np.nan], [3.0, np.nan]]), False)
    assert (found["mean"].tolist(), found["min"].tolist()) == ([2.0, 0.0], [1.0, 0.0])
    assert (found["q50"].tolist(), found["count"].tolist()) == ([2.0, 0.0], [3])
    values = np.random.default_rng(2).normal(0.0, 1.0, (90, 3)) + np.arange(90)[:, np.newaxis]
    told = together([statistics(part, False) for part in np.split(values, [20, 50])])
    np.testing.assert_allclose(told["mean"], values.mean(axis=0))
    np.testing.assert_allclose(told["std"], values.std(axis=0))
    np.testing.assert_array_equal(told["max"], values.max(axis=0))
    assert told["count"].tolist() == [90]


def test_the_layout_the_provenance_and_the_alignment_stand_beside(folder, palm):
    told = json.loads((folder / "meta/tactile.json").read_text())
    assert told["units"] == list(palm.unit_names)
    np.testing.assert_array_equal(np.array(told["position_m"]).T, palm.position)
    np.testing.assert_array_equal(
        np.moveaxis(np.array(told["rotation_skin_unit"]), 0, 2), palm.rotation
    )
    assert len(told["provenance"]) == 3
    for one in told["provenance"]:
        assert one["serials"] == list(palm.serials)
        assert one["options"] == Options().report()
        assert one["calibration_sha256_of_units"] == calibration_hashes(palm)
        assert {"topology_sha256", "calibration_sha256", "version"} <= one.keys()
    first = told["alignment"][0]
    assert (first["frames"], first["without_sample"], first["window_gaps"]) == (40, 0, 0)
    assert first["age_s_max"] < 0.004
    assert 1e-4 < first["camera_jitter_s"] < 2e-3


def test_a_unit_of_another_calibration_has_another_hash(palm):
    parameters = {name: values.copy() for name, values in palm.parameters.items()}
    parameters["frequency_rest_hz"][3] += 1.0
    one, other = (calibration_hashes(at) for at in (palm, replace(palm, parameters=parameters)))
    assert [i for i in range(palm.n) if one[i] != other[i]] == [3]


def test_gaps_of_the_skin_are_not_filled(states, written, tmp_path):
    cut = [state for state in states if not 60 <= state.cycle - states[0].cycle < 70]
    lost = states[0].stamp_ns + 60 * PERIOD_NS
    frames = [Frame(lost + at * PERIOD_NS + 1) for at in (-1, 3, 8, 9, 12, 17, 18)]
    told = written(cut, frames, fps=79, window=WINDOW)
    # the second and third frame are over two periods from any sample
    assert told.without_sample == 3
    valid = np.array(column(tmp_path / "set", "observation.tactile.valid_window").to_pylist())
    assert np.array([state.units.valid.all() for state in states]).all()
    rows = valid.all(axis=2).astype(int).tolist()
    assert rows == [[1] * 8, [0] * 8, [0] * 8, [0] * 8, [0] * 5 + [1] * 3, [1] * 8, [1] * 8]
    force = np.array(column(tmp_path / "set", "observation.tactile.force_window").to_pylist())
    assert (np.isnan(force).all(axis=(2, 3)) == ~valid.all(axis=2)).all()
    assert np.isnan(column(tmp_path / "set", "tactile.age_s").to_pylist()[1:4]).all()
    assert told.window_gaps == 3 * 8 + 5


def test_units_that_are_not_valid_are_not_filled(states, written, tmp_path):
    valid = states[20].units.valid.copy()
    valid[5] = False
    dead = replace(states[20], units=replace(states[20].units, valid=valid))
    written([dead], [Frame(dead.stamp_ns)], window=1, fill=-1.0)
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
    states, written, tmp_path, stamps, message
):
    frames = [Frame(states[0].stamp_ns + 1_000_000 * at) for at in stamps]
    with pytest.raises(SkinError, match=message):
        written(states, frames)
    assert list(tmp_path.iterdir()) == []


def test_states_that_cannot_be_an_episode_are_refused(states, written, tmp_path):
    with pytest.raises(SkinError, match="must come after cycle"):
        written([states[9], states[3]], [Frame(states[9].stamp_ns), Frame(states[9].stamp_ns + 1)])
    with pytest.raises(SkinError) as told:
        written([replace(states[0], wrench=None, contacts=None)], [Frame(states[9].stamp_ns)])
    assert str(told.value) == (
        f"skin: cycle {states[0].cycle}: must have temperature, force, wrench, contacts "
        "(want=…); got a state without wrench, contacts"
    )
    strip = skin.Pipeline(topology.load("strip"), Options(want={"force"}))
    with (
        pytest.raises(SkinError, match="must be of the 10 units of the topology; got 64"),
        Dataset(tmp_path / "set", strip.topology, fps=30) as one,
    ):
        one.add_episode(states, [Frame(states[9].stamp_ns)], "none", strip)
    assert list(tmp_path.iterdir()) == []


def test_a_data_set_with_an_episode_that_failed_is_refused(palm, states, pipeline, tmp_path):
    frame = Frame(states[9].stamp_ns)
    for frames, got in (([], "none"), ([frame, frame], "one that failed")):
        one = Dataset(tmp_path / "set", palm, fps=30).__enter__()
        if frames:
            one.add_episode(states, [frame], "none", pipeline)
            with pytest.raises(SkinError, match="must be later"):
                one.add_episode(states, frames, "none", pipeline)
        with pytest.raises(SkinError, match=f"must have whole episodes; got {got}"):
            one.__exit__(None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("task", ["", " ", 3, "slide \udcff"])
def test_a_task_is_words(states, written, task):
    with pytest.raises(OptionError) as told:
        written(states, [], task)
    assert str(told.value) == f"task: must be words in UTF-8; got {task!r}"


def test_features_of_the_user_are_numbers_whatever_their_names(states, written, tmp_path):
    given = {"gripper.valid_share": [0.5], "arm_stamp_ns": [1 << 24, 0.25], "is.valid": True,
             "half": np.array([0.5, 65504.0], np.float16), "none": np.nan}  # fmt: skip
    written(states, [Frame(states[0].stamp_ns, values=given)])
    told = {name: column(tmp_path / "set", name).to_pylist()[0] for name in given}
    assert np.isnan(told.pop("none"))
    assert told == {
        "gripper.valid_share": 0.5, "arm_stamp_ns": [16777216.0, 0.25], "is.valid": 1.0,
        "half": [0.5, 65504.0],
    }  # fmt: skip
    info = json.loads((tmp_path / "set/meta/info.json").read_text())["features"]
    assert {info[name]["dtype"] for name in given} == {"float32"}
    assert info["observation.tactile.valid_window"]["dtype"] == "bool"
    assert info["camera.stamp_ns"]["dtype"] == info["tactile.stamp_ns"]["dtype"] == "int64"


def noise(mode="RGB", kind="PNG", share=1.0):
    """The file of an image of noise, or its beginning."""
    out, rgb = io.BytesIO(), np.random.default_rng(7).integers(0, 255, (40, 50, 3), np.uint8)
    image_library.fromarray(rgb).convert(mode).save(out, format=kind)
    return out.getvalue()[: int(share * out.tell())]


PIXELS = np.zeros((4, 6, 3), np.uint8)
EXACT = "'action': must be a number that float32 holds exactly, where it is beyond 16777216; got "
NAME = "must have names without '/' that no other feature has; got "


@pytest.mark.parametrize(
    ("kind", "good", "bad", "message"),
    [
        *(("name", "mine", name, f"{NAME}{name!r}") for name in
          ("index", "timestamp", "action/grip", "tactile.age_s", "", 3, "\udcff")),
        ("value", [1.0], np.zeros(0), "'action': must have numbers; got none, shape (0,)"),
        ("value", [1.0], "x", "'action': must be an array of numbers; got 'x'"),
        ("value", [1.0], [[1.0], [1.0, 2.0]], "'action': must be an array of numbers; got [[1.0]"),
        ("value", [1.0], np.float64(1e39), f"{EXACT}9.9999999999999994e+38"),
        ("value", [1.0], 1_700_000_000_123_456_789, f"{EXACT}1.7000000001234568e+18"),
        ("image", PIXELS, np.zeros((4, 7, 3), np.uint8), "observation.images.wrist: must be of "
         "shape (4, 6, 3), as in the first frame; got (4, 7, 3)"),
        ("image", PIXELS, "a.png", "'wrist': must be pixels or the bytes of a file; got 'a.png'"),
        ("image", PIXELS, PIXELS[:0], "'wrist': must be pixels, shape (h, w, 3), uint8; got (0, 6"),
        *(("image", noise(), noise(mode), "'wrist': must be an image of RGB; got one of " + mode)
          for mode in ("L", "RGBA", "P")),
        *(("image", noise(), noise("RGB", kind, share), "'wrist': must be a")
          for kind in ("PNG", "JPEG") for share in (0.0, 0.2, 0.9)),
    ],
)  # fmt: skip
def test_a_frame_that_cannot_be_is_refused_wherever_it_comes(
    states, written, kind, good, bad, message
):
    frames = []
    for state, one in zip(states, [*[good] * 3, bad], strict=False):
        images = {"wrist": one} if kind == "image" else {}
        values = {one if kind == "name" else "action": one if kind == "value" else [1.0]}
        frames.append(Frame(state.stamp_ns, images, values))
    with pytest.raises((OptionError, SkinError)) as told:
        written(states, frames)
    assert str(told.value).startswith(f"camera: frame 3: {message}")


def test_images_need_their_library(states, written, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(LibraryError, match=r"'wrist': must have PIL; not installed: pip install"):
        written(states, [Frame(states[0].stamp_ns, {"wrist": b""})])


def test_options_and_folders_that_cannot_be_are_refused(palm, tmp_path):
    with pytest.raises(OptionError, match=r"fps: must be an integer from 1 to 1000; got 29\.97"):
        Dataset(tmp_path / "set", palm, fps=29.97)
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(SkinError, match="must be a new or empty folder; got one with files in it"):
        Dataset(tmp_path, palm, fps=30)
    assert (tmp_path / "mine.txt").read_text() == "mine"


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
