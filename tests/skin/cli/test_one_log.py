"""One log by every way that decodes it: the same forces, and the options stated in the file."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest

import skin
from bus.logs import write
from skin.cli import main
from skin.io.bulk import WANT, decode_logs
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import frames_of

parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")

CYCLES = 350
GIVEN = [{}, {"sweeps": 2}, {"dtype": "float64"}]
"""Options: none, as of the commands, and others than the defaults."""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Bodies that press a palm, with neighbours that feel each other's films."""
    path = tmp_path_factory.mktemp("log") / "run.log"
    write(path, frames_of("palm", "press", CYCLES))
    return path


@pytest.fixture(scope="module", params=GIVEN, ids=str)
def case(request, log):
    """What is asked for, and what `decode_log` says: states and options."""
    decoded = skin.decode_log("palm", log, want=WANT, **request.param)
    states = [state.copy() for state in decoded]
    assert np.nanmax([state.units.force[2] for state in states]) > 1.0, "nothing was pressed"
    return request.param, states, decoded.pipeline.options.report()


def forces(path):
    """Forces in a table of cycles, shape (t, 3, n), and the options that it states."""
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            return arrays["force"], json.loads(str(arrays["_options"]))
    table = parquet.read_table(path)
    names = [name[:-3] for name in table.column_names if name.endswith(".fx")]
    names.remove("wrench")
    columns = [[table[f"{name}.f{axis}"].to_numpy() for name in names] for axis in "xyz"]
    return np.moveaxis(np.array(columns), 2, 0), json.loads(table.schema.metadata[b"options"])


@pytest.mark.parametrize("form", ["parquet", "npz"])
def test_a_file_and_a_folder_have_the_forces_of_decode_log(form, case, log, tmp_path, capsys):
    asked, states, options = case
    expected = np.stack([state.units.force for state in states])
    found = [decode_logs("palm", [log], tmp_path / "python", format=form, **asked)]
    files = [*(tmp_path / "python" / "cycles").rglob(f"*.{form}")]
    if not asked:
        for out, more in ((f"a.{form}", ()), ("out", ("--format", form))):
            assert (
                main(["decode", "palm", str(log), "-o", str(tmp_path / out), "--json", *more]) == 0
            )
            found.append(json.loads(capsys.readouterr().out.splitlines()[-1]))
        files += [tmp_path / f"a.{form}", *(tmp_path / "out" / "cycles").rglob(f"*.{form}")]
    assert [report["logs"][0]["options"] for report in found] == [options] * len(files)
    for file in files:
        forces_found, stated = forces(file)
        assert forces_found.dtype == expected.dtype
        np.testing.assert_array_equal(forces_found, expected)
        assert stated == options


@long_after_first("case", [{}], indirect=True)
def test_a_data_set_has_the_forces_of_decode_log(case, log, tmp_path, capsys):
    image_library = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    _, states, options = case
    (frames := tmp_path / "frames").mkdir()
    for state in states:
        image_library.new("RGB", (4, 3)).save(frames / f"{state.stamp_ns}.png")
    assert main(["export", "lerobot", str(log), "--topology", "palm", "--frames", str(frames),
                 "-o", str(tmp_path / "set"), "--task", "press", "--fps", "250"]) == 0  # fmt: skip
    capsys.readouterr()
    table = parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    found = np.array(table["observation.tactile.force"].to_pylist(), np.float32)
    expected = [np.where(state.units.valid, state.units.force, np.nan).T for state in states]
    np.testing.assert_array_equal(found, np.array(expected, np.float32))
    (told,) = json.loads((tmp_path / "set/meta/tactile.json").read_text())["provenance"]
    assert told["options"] == options


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording of a run, and the forces that it had."""
    pytest.importorskip("mcap", reason="mcap is not installed")
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    how = skin.Options(sweeps=0)
    with skin.open("strip", simulate="press", pace=False, record=path, options=how) as strip:
        force = np.stack([state.units.force for state in itertools.islice(strip, 120)])
    return path, force


@pytest.mark.parametrize("first", [[], ["strip"]], ids=["by its own topology", "by a given one"])
def test_a_recording_is_decoded_as_a_log_is(first, recorded, tmp_path, capsys):
    path, force = recorded
    assert main(["decode", *first, str(path), "-o", str(tmp_path / "run.npz"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    double = decode_logs("strip", [path], tmp_path / "out", format="npz", dtype="float64")
    for one, dtype in ((report, "float32"), (double, "float64")):
        assert (one["topology"], one["cycles"], one["faults"]) == ("strip", 120, [])
        options = one["logs"][0]["options"]  # of its run, but for those that are given
        assert (options["sweeps"], options["dtype"]) == (0, dtype)
    np.testing.assert_array_equal(forces(tmp_path / "run.npz")[0], force)


def test_a_wrench_and_a_contact_with_a_silent_unit_are_not_whole(log, tmp_path):
    lines = log.read_text().splitlines()
    cycle, kept = -1, []
    loads = np.array([s.units.force[2] for s in skin.decode_log("palm", log, want={"force"})])
    at = int((loads.max(axis=1) > 0.5 * loads.max()).argmax())  # while it is pressed in
    number = f"{0x100 + int(loads[at].argmax()) // 5:03X}##"
    for line in lines:
        frame = line.split()[2]
        cycle += frame.startswith("080#")
        if cycle < at or not frame.startswith(number):
            kept.append(line)
    (silenced := tmp_path / "silenced.log").write_text("\n".join(kept) + "\n")
    main(["decode", "palm", str(silenced), "-o", str(tmp_path / "a.npz")])
    with np.load(tmp_path / "a.npz") as of_cycles, np.load(tmp_path / "a.contacts.npz") as found:
        whole, cycles = of_cycles["whole"], found["cycle"] - of_cycles["cycle"][0]
        assert whole[:at].all()
        assert not whole[at : at + 8].any()
        assert found["whole"][cycles < at].all()
        assert not found["whole"][(cycles >= at) & (cycles < at + 8)].all()
