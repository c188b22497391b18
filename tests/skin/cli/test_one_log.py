"""One log by every way that decodes it: the same forces, and the options stated in the file."""

from __future__ import annotations

import csv
import itertools
import json

import numpy as np
import pytest

import skin
from bus.logs import write
from skin.cli import main
from tests.fixtures.live import frames_of

CYCLES = 350
AXES = ("x", "y", "z")
GIVEN = [{}, {"sweeps": 2}]
"""Options of a command: none, and another one than the defaults."""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Bodies that press a palm, with neighbours that feel each other's films."""
    path = tmp_path_factory.mktemp("log") / "run.log"
    write(path, frames_of("palm", "press", CYCLES))
    return path


@pytest.fixture(scope="module", params=GIVEN, ids=["defaults", "given"])
def case(request, log):
    """Words of the command, and what `decode_log` says: stamps, (t,), forces, (t, 3, n), NaN where
    they are not valid, flags, (t, n), and its options."""
    words = [text for name, value in request.param.items() for text in (f"--{name}", str(value))]
    decoded = skin.decode_log("palm", log, **request.param)
    stamps, forces, flags, valid = [], [], [], []
    for state in decoded:
        stamps.append(state.stamp_ns)
        forces.append(state.units.force.copy())
        flags.append(state.units.status.copy())
        valid.append(state.units.valid.copy())
    force = np.stack(forces)
    assert force.dtype == request.param.get("dtype", "float32")
    assert np.nanmax(force[:, 2]) > 1.0, "nothing was pressed"
    return (
        words,
        np.array(stamps),
        force,
        np.stack(flags),
        np.stack(valid),
        decoded.pipeline.options,
    )


def stated(text, options):
    """Whether a file states the options by which it was decoded, but for what was wanted."""
    found, expected = json.loads(text), options.report()
    assert "force" in found["want"]
    assert {**found, "want": 0} == {**expected, "want": 0}
    return True


def decoded(log, words, output, capsys):
    assert main(["decode", "palm", str(log), "-o", str(output), "--json", *words]) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_a_file_of_arrays_has_the_forces_of_decode_log(case, log, tmp_path, capsys):
    words, _, force, flags, _, options = case
    report = decoded(log, words, tmp_path / "a.npz", capsys)
    assert stated(json.dumps(report["options"]), options)
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays["force_n"].dtype == force.dtype
        np.testing.assert_array_equal(arrays["force_n"], force)
        np.testing.assert_array_equal(arrays["status"], flags)
        assert stated(str(arrays["_options"]), options)


@pytest.mark.long
def test_numbers_are_of_the_type_that_is_asked_for(log, tmp_path, capsys):
    decoded(log, ["--dtype", "float64"], tmp_path / "a.npz", capsys)
    expected = [state.units.force.copy() for state in skin.decode_log("palm", log, dtype="float64")]
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays["force_n"].dtype == np.float64
        np.testing.assert_array_equal(arrays["force_n"], np.stack(expected))


def test_a_table_has_the_forces_of_decode_log(case, log, tmp_path, capsys):
    words, _, force, _, _, options = case
    report = decoded(log, words, tmp_path / "a.csv", capsys)
    assert stated(json.dumps(report["options"]), options)
    with (tmp_path / "a.csv").open(newline="") as file:
        rows = [[row[f"f{axis}_n"] for axis in AXES] for row in csv.DictReader(file)]
    expected = [
        [f"{value:.4f}" for value in unit] for unit in force.transpose(0, 2, 1).reshape(-1, 3)
    ]
    assert rows == expected


def of_parquet(path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    table = parquet.read_table(path)
    names = [name[:-3] for name in table.column_names if name.endswith(".fx")]
    names.remove("wrench")
    columns = [[table[f"{name}.f{axis}"].to_numpy() for name in names] for axis in AXES]
    return np.moveaxis(np.array(columns), 2, 0), table.schema.metadata


def test_a_parquet_file_has_the_forces_of_decode_log(case, log, tmp_path, capsys):
    words, _, force, _, _, options = case
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    decoded(log, words, tmp_path / "a.parquet", capsys)
    found, metadata = of_parquet(tmp_path / "a.parquet")
    assert found.dtype == force.dtype
    np.testing.assert_array_equal(found, force)
    assert stated(metadata[b"options"], options)


@pytest.mark.parametrize("form", ["parquet", "npz"])
def test_a_folder_has_the_forces_of_decode_log(form, case, log, tmp_path, capsys):
    words, _, force, _, _, options = case
    if form == "parquet":
        pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    report = decoded(log, [*words, "--format", form], tmp_path / "out", capsys)
    assert stated(json.dumps(report["logs"][0]["options"]), options)
    (file,) = (tmp_path / "out" / "cycles").rglob(f"*.{form}")
    if form == "parquet":
        found, metadata = of_parquet(file)
        text = metadata[b"options"]
    else:
        with np.load(file) as arrays:
            found, text = arrays["force_n"], str(arrays["_options"])
    assert found.dtype == force.dtype
    np.testing.assert_array_equal(found, force)
    assert stated(text, options)
    (manifest,) = (tmp_path / "out" / "_logs").glob("*.json")
    assert stated(json.loads(manifest.read_text())["told"]["options"], options)


def test_a_data_set_has_the_forces_of_decode_log(case, log, tmp_path, capsys):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    words, stamps, force, _, valid, options = case
    frames = tmp_path / "frames.csv"
    frames.write_text("\n".join(["stamp_ns,action.grip", *(f"{one},1" for one in stamps.tolist())]))
    assert main(["export", "lerobot", str(log), "--topology", "palm", "--frames", str(frames),
                 "-o", str(tmp_path / "set"), "--task", "press", "--fps", "250",
                 *words]) == 0  # fmt: skip
    capsys.readouterr()
    table = parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    found = np.array(table["observation.tactile.force"].to_pylist(), np.float32)
    expected = np.where(valid[:, np.newaxis], force, np.nan).astype(np.float32)
    np.testing.assert_array_equal(found, expected.transpose(0, 2, 1))
    (told,) = json.loads((tmp_path / "set/meta/tactile.json").read_text())["options"]
    assert stated(json.dumps(told), options)


def test_a_recording_keeps_the_options_of_its_run_that_are_not_given(tmp_path, capsys):
    pytest.importorskip("mcap", reason="mcap is not installed")
    file = tmp_path / "run.mcap"
    with skin.open(
        "strip", simulate=True, pace=False, record=file, options=skin.Options(sweeps=0)
    ) as strip:
        for _, _ in zip(strip, range(30), strict=False):
            pass
    arguments = ["decode", "strip", str(file), "-o", str(tmp_path / "out"), "--format", "npz"]
    for words, dtype in (([], "float32"), (["--dtype", "float64"], "float64")):
        assert main([*arguments, "--json", *words]) == 0
        report = json.loads(capsys.readouterr().out.splitlines()[-1])
        options = report["logs"][0]["options"]
        assert (options["sweeps"], options["dtype"]) == (0, dtype)


@pytest.mark.parametrize("words", [["--sweeps", "3"], ["--dtype", "float16"]])
def test_options_that_cannot_be_are_refused(words, log, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["decode", "palm", str(log), "-o", str(tmp_path / "a.npz"), *words])
    assert stopped.value.code == 2
    assert words[0] in capsys.readouterr().err


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording of a run, and the forces that it had."""
    pytest.importorskip("mcap", reason="mcap is not installed")
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    with skin.open("strip", simulate="press", pace=False, record=path) as strip:
        force = np.stack([state.units.force for state in itertools.islice(strip, 120)])
    return path, force


@pytest.mark.parametrize("first", [[], ["strip"]], ids=["by its own topology", "by a given one"])
@pytest.mark.parametrize("suffix", ["npz", "csv", "parquet"])
def test_a_recording_goes_into_one_file_as_a_log_does(first, suffix, recorded, tmp_path, capsys):
    path, force = recorded
    out = tmp_path / f"run.{suffix}"
    if suffix == "parquet":
        pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    assert main(["decode", *first, str(path), "-o", str(out), "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (report["topology"], report["cycles"]) == ("strip", len(force))
    assert report["faults"] == []
    if suffix == "npz":
        with np.load(out) as arrays:
            np.testing.assert_array_equal(arrays["force_n"], force)
    assert out.stat().st_size > 1000


def test_recordings_go_into_a_folder_by_their_own_topology(recorded, tmp_path, capsys):
    given = ["decode", str(recorded[0]), "-o", str(tmp_path / "out"), "--format", "npz", "--json"]
    assert main(given) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (report["decoded"], report["failed"]) == (1, 0)
