"""One command scores the detector and the usual ones on files of both kinds."""

import json

import numpy as np
import pytest

from benchmarks.recorded.__main__ import OURS, gather, main, measure, table
from benchmarks.recorded.detect import FIGURES, runs, watch
from benchmarks.recorded.recording import RecordingError
from tests.benchmarks.recorded.made import (
    MM_PER_READING,
    arq_group,
    depths_mm,
    first_slip_s,
    last_slip_s,
    log_text,
    pillar_rows,
    write_arq,
    write_plain,
)

LATEST_S = 0.15
"""Of the detector after the first spring of so gentle a slip."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Two grasps of an array of ARQ and two tables, of which one each slips, and a log."""
    pytest.importorskip("h5py")
    folder = tmp_path_factory.mktemp("recorded")
    groups = {
        "Pose1/Exp1": arq_group(seed=1),
        "Pose1/Exp2": arq_group(seed=2, slips=False),
        "Pose1/Exp3": {**arq_group(), "tactile_slips_label": np.full(540, 4)},
    }
    log = folder / "LOG.csv"
    log.write_text(log_text(pillar_rows(rate_hz=250.0)))
    return [
        write_arq(folder / "a.h5", groups),
        write_plain(folder / "slip.csv", pillar_rows(rate_hz=250.0, seed=3)),
        write_plain(folder / "stop.csv", pillar_rows(rate_hz=250.0, seed=4, slips=False)),
        log,
    ]


@pytest.fixture(scope="module")
def figures(files):
    return measure(*gather(files))


def test_recordings_are_scored_by_the_array_and_by_whose_word_the_labels_are(figures):
    assert {array: rows[OURS]["recordings"] for array, rows in figures["arrays"].items()} == {
        "PapillArray, labels of the file": 2,
        "PapillArray, the sensor's own word": 1,
        "uSkin 18, labels by hand": 2,
    }
    for rows in figures["arrays"].values():
        assert list(rows) == [OURS, *FIGURES]


def test_a_slip_that_is_plain_is_caught_in_time_and_a_hold_does_not_alarm(figures):
    depth = depths_mm(9, 3)
    gross_ms = 1e3 * (last_slip_s(depth) - first_slip_s(depth))
    for array, rows in figures["arrays"].items():
        ours = rows[OURS]
        assert ours["slips"] == 1, array
        assert ours["caught"]["rate"] == 1.0, array
        assert ours["latency_ms_median"]["median"] < 1e3 * LATEST_S < gross_ms
        assert ours["false_alarms_per_minute"]["rate"] == 0.0, array
    with_holds = figures["arrays"]["PapillArray, labels of the file"][OURS]
    assert with_holds["caught_before_gross"]["rate"] == 1.0
    assert with_holds["quiet_recordings_with_alarm"]["rate"] == 0.0


def test_usual_detectors_have_no_more_false_alarms_than_ours(figures):
    for rows in figures["arrays"].values():
        most = rows[OURS]["false_alarms_per_minute"]["rate"]
        for name in FIGURES:
            assert rows[name]["false_alarms_per_minute"]["rate"] <= most
    rows = figures["arrays"]["PapillArray, labels of the file"]
    assert rows["friction ratio"]["caught"]["rate"] == 1.0
    assert rows["light units' CUSUM"]["caught"]["rate"] == 1.0


def test_a_recording_without_a_rest_is_named(figures):
    (one,) = figures["left_out"]
    assert one["name"] == "a.h5:GGCNN2/brush/Pose1/Exp3"
    assert table(figures).splitlines()[-1] == f"left out: {one['name']}: {one['why']}"


def test_each_usual_figure_rises_when_the_springs_slip(files):
    recording = next(one for one in gather(files)[0] if one.name == "slip.csv:S0")
    time_s = recording.time_s
    held = (time_s > 1.5) & (time_s < 2.0)
    slid = time_s > last_slip_s(depths_mm(9, 3))
    for name in ("friction ratio", "light units' CUSUM"):
        figure = FIGURES[name](recording)
        assert figure[held].max() < 0.2 * figure[slid].max(), name
        assert figure.shape == time_s.shape


def test_shaking_that_begins_raises_the_power_of_its_band(files):
    recording = next(one for one in gather(files)[0] if one.name == "stop.csv:S0")
    time_s = recording.time_s
    shaken = recording.force.copy()
    late = time_s > 1.6
    shaken[late, 0] += np.sin(2 * np.pi * 50.0 * time_s[late])[:, np.newaxis].astype(np.float32)
    power = FIGURES["band power"](type(recording)(**{**vars(recording), "force": shaken}))
    before = power[(time_s > 1.2) & (time_s < 1.6)].max()
    assert power[(time_s > 1.6) & (time_s < 1.8)].max() > 3.0 * before


def test_the_order_of_the_taxels_does_not_matter_to_what_is_caught(files):
    recording = next(one for one in gather(files)[0] if one.name == "slip.csv:S0")
    order = np.random.default_rng(0).permutation(9)
    fields = {**vars(recording)}
    for name in ("force", "force_sigma", "displacement_mm", "displacement_sigma_mm",
                 "position_mm"):  # fmt: skip
        fields[name] = fields[name][..., order]
    first, second = watch(recording), watch(type(recording)(**fields))
    assert abs(int(np.argmax(first)) - int(np.argmax(second))) <= 2


def test_the_command_ends_with_one_object_and_takes_a_description(files, tmp_path, capsys):
    description = tmp_path / "array.toml"
    description.write_text(f"mm_per_reading = [{MM_PER_READING}, {MM_PER_READING}]\n")
    assert main([str(files[0]), "--array", str(description), "--json"]) == 0
    lines = capsys.readouterr().out.splitlines()
    found = json.loads(lines[-1])
    assert found["benchmark"] == "recorded"
    assert list(found["arrays"]) == ["uSkin 18, labels by hand"]
    assert found["left_out"][0]["name"] == "a.h5:GGCNN2/brush/Pose1/Exp3"
    assert lines[0] == "uSkin 18, labels by hand: 2 recordings, 1 slips, 0.07 minutes without"


def test_bad_input_is_told_on_the_error_stream_with_status_2(tmp_path, capsys):
    file = tmp_path / "a.csv"
    file.write_text("hello\n")
    assert main([str(file)]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err == (f"{file}:1: must be a line of a table of a PapillArray; got 'hello\\n'\n")


def test_files_of_which_none_can_be_scored_say_why(tmp_path):
    pytest.importorskip("h5py")
    group = {**arq_group(seconds=1.0), "tactile_slips_label": np.full(180, 4)}
    file = write_arq(tmp_path / "a.h5", {"Pose1/Exp1": group})
    with pytest.raises(RecordingError) as error:
        gather([file])
    assert str(error.value) == (
        f"{file}: must hold a recording that can be scored; got none\n"
        "  a.h5:GGCNN2/brush/Pose1/Exp1: its first 0.25 s, where zeros are taken, must be labelled "
        "0; got 4 (or tell rest by --array)"
    )


@pytest.mark.parametrize("on", [[], [True], [False, True, True], [True, False, True]])
def test_runs_cover_what_is_on_and_nothing_else(on):
    found = np.zeros(len(on), bool)
    for begin, end in runs(np.array(on, bool)):
        found[begin:end] = True
    assert found.tolist() == on
