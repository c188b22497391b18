"""A log into partitions: what the live skin shows, resumed without a trace, made once."""

from __future__ import annotations

import dataclasses
import json
import os
import resource
import subprocess
import sys

import numpy as np
import pyarrow.parquet
import pytest

import skin
import topology
from bus.logs import write
from skin.errors import OptionError
from skin.io.bulk import decode_part as module
from skin.io.bulk.decode_part import decode_part
from skin.io.bulk.job import WANT, Job, parts_of
from tests.skin.io.bulk.conftest import CYCLES, PARTITION


def done(job, log):
    (part,) = parts_of([log])
    return decode_part(job, part)


def column(job, table, name):
    return pyarrow.parquet.read_table(job.folder / table, columns=[name])[name].to_numpy()


def test_tables_hold_what_the_live_skin_shows(job, log):
    summary = done(job, log)
    assert (summary["state"], summary["faults"], summary["damage"]) == ("decoded", [], None)
    assert summary["cycles"] == CYCLES
    assert summary["partitions"] == -(-CYCLES // PARTITION)
    names = job.topology.unit_names
    table = pyarrow.parquet.read_table(job.folder / "cycles")
    force = np.stack([table[f"{name}.fz"].to_numpy() for name in names])
    wrench = table["wrench.mz"].to_numpy()
    loads, slips = column(job, "contacts", "load"), column(job, "contacts", "slip")
    times = column(job, "cycles", "time").astype(np.int64)
    at = 0
    for t, state in enumerate(skin.decode_log("palm", log, want=WANT)):
        assert times[t] == state.stamp_ns
        assert force[:, t].tobytes() == state.units.force[2].tobytes()
        assert wrench[t] == state.wrench[5]
        for contact in state.contacts:
            assert (loads[at], slips[at]) == (contact.load, contact.slip.name.lower())
            at += 1
    assert at == loads.size > 50


def test_where_files_end_changes_no_value(job, log, contents):
    done(job, log)
    whole = dataclasses.replace(job, folder=job.folder / "whole", partition_cycles=None)
    done(whole, log)
    for table in ("cycles", "contacts"):
        one, other = (pyarrow.parquet.read_table(folder / table)
                      for folder in (job.folder, whole.folder))  # fmt: skip
        assert one.column_names == other.column_names
        for mine, theirs in zip(one.columns, other.columns, strict=True):
            np.testing.assert_array_equal(mine.to_numpy(), theirs.to_numpy())


def test_threads_change_nothing(palm_frames, job, contents, tmp_path):
    write(whole := tmp_path / "run.blf", palm_frames)
    (damaged := tmp_path / "cut.blf").write_bytes(whole.read_bytes()[:-5000])
    for log in (whole, damaged):
        found = []
        for threads in (True, False):
            one = dataclasses.replace(job, folder=tmp_path / f"{log.stem}-{threads}")
            (part,) = parts_of([log])
            summary = decode_part(one, part, threads=threads)
            found.append(({**summary, "wall_s": 0.0}, contents(one.folder)))
        assert found[0] == found[1]
        assert bool(found[0][0]["damage"]) == (log is damaged)


def test_a_job_that_is_killed_goes_on_to_the_same_files(job, log, contents, tmp_path):
    after = int(np.random.default_rng().integers(0, 4))
    killed = dataclasses.replace(job, folder=tmp_path / "killed")
    command = [
        sys.executable,
        "-m",
        "tests.skin.io.bulk.killed",
        log,
        killed.folder,
        PARTITION,
        after,
    ]
    ended = subprocess.run([str(one) for one in command], check=False, env=os.environ | {
        "PYTHONPATH": os.pathsep.join(sys.path)})  # fmt: skip
    assert ended.returncode == -9
    left = {file: file.stat().st_mtime_ns for file in killed.folder.rglob("part-*.parquet")}
    assert len({file.name for file in left}) == after
    assert done(killed, log)["state"] == "decoded"
    for file, stamp_ns in left.items():
        assert file.stat().st_mtime_ns == stamp_ns  # written once
    done(job, log)
    assert contents(killed.folder) == contents(job.folder)


def test_a_log_is_not_decoded_twice(job, log, contents):
    done(job, log)
    before = contents(job.folder)
    again = done(job, log)
    assert (again["state"], again["cycles"]) == ("unchanged", CYCLES)
    assert contents(job.folder) == before


def changed(job, log, what):
    """The job and the log with something that is not as before."""
    if what == "calibration":
        parameters = dict(job.topology.parameters)
        parameters["frequency_rest_hz"] = parameters["frequency_rest_hz"] + 1.0
        return dataclasses.replace(
            job, topology=dataclasses.replace(job.topology, parameters=parameters)
        ), log
    if what == "topology":
        moved = dataclasses.replace(job.topology, position=job.topology.position + 0.001)
        return dataclasses.replace(job, topology=moved), log
    if what == "options":
        return dataclasses.replace(job, options={"want": ("force",)}), log
    if what == "log":
        (other := log.parent / "other").mkdir(exist_ok=True)
        (other / log.name).write_bytes(log.read_bytes()[:-2000].rpartition(b"\n")[0] + b"\n")
        return job, other / log.name
    return dataclasses.replace(job, force=True), log


@pytest.mark.long_but_first
@pytest.mark.parametrize("what", ["calibration", "topology", "options", "log", "force"])
def test_a_log_is_decoded_again_where_something_changed(job, log, what):
    done(job, log)
    job, log = changed(job, log, what)
    assert done(job, log)["state"] == "decoded"
    told = pyarrow.parquet.read_schema(next(job.folder.rglob("part-00000.parquet"))).metadata
    (part,) = parts_of([log])
    assert {key.decode(): value.decode() for key, value in told.items()} == job.provenance(part)


def test_a_log_that_is_damaged_is_decoded_but_for_the_damage_and_says_so(job, log, tmp_path):
    lines = log.read_bytes().splitlines(keepends=True)
    lines[len(lines) // 2] = b"(17000000.0) palm 1G4#\n"
    (torn := tmp_path / "torn.log").write_bytes(b"".join(lines))
    summary = done(job, torn)
    assert summary["state"] == "decoded"
    assert f"{torn}:{len(lines) // 2 + 1}: column " in summary["damage"]
    assert abs(summary["cycles"] - CYCLES) < 3
    assert column(job, "cycles", "cycle").size == summary["cycles"]


def test_a_clock_that_jumps_back_is_told(job, palm_frames, tmp_path):
    frames = palm_frames.copy()
    frames["stamp_ns"][frames.size // 2 :] -= 3_600_000_000_000
    write(tmp_path / "back.log", frames)
    summary = done(job, tmp_path / "back.log")
    assert summary["cycles"] == CYCLES
    (fault,) = summary["faults"]
    assert "must not be older than the frames before it" in fault


def test_a_log_of_another_skin_is_told(log, tmp_path):
    summary = done(Job(topology.load("strip"), tmp_path / "out"), log)
    *_, fault = summary["faults"]
    assert fault.startswith(f"{log}: must be a log of the skin 'strip'; got ")


def test_a_log_that_grows_is_told_and_decoded_again(job, log, tmp_path):
    whole = log.read_bytes()
    half = whole[: len(whole) // 2].rpartition(b"\n")[0] + b"\n"
    (growing := tmp_path / "growing.log").write_bytes(half)
    (part,) = parts_of([growing])
    growing.write_bytes(whole)
    summary = decode_part(job, part)
    assert any("must keep its size while it is read" in fault for fault in summary["faults"])
    (later,) = parts_of([growing])
    assert later.key == part.key
    again = decode_part(job, later)
    assert (again["state"], again["cycles"], again["faults"]) == ("decoded", CYCLES, [])


def test_a_disk_that_fills_leaves_whole_files_and_a_second_call_goes_on(job, log, contents):
    done(whole := dataclasses.replace(job, folder=job.folder / "whole"), log)
    sizes = sorted(file.stat().st_size for file in whole.folder.rglob("*.parquet"))
    limit, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    full = dataclasses.replace(job, folder=job.folder / "full")
    resource.setrlimit(resource.RLIMIT_FSIZE, (sizes[-1] - 1, hard))
    try:
        summary = done(full, log)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    assert summary["state"] == "failed"
    assert summary["error"].startswith(f"{full.folder}/")
    assert summary["error"].endswith(".parquet: File too large")
    assert not list(full.folder.rglob("*.part"))
    for file in full.folder.rglob("*.parquet"):
        pyarrow.parquet.ParquetFile(file).read()
    assert done(full, log)["state"] == "decoded"
    assert contents(full.folder) == contents(whole.folder)


def test_arrays_hold_the_same_as_tables(job, log, tmp_path):
    done(job, log)
    arrays = dataclasses.replace(job, folder=tmp_path / "arrays", format="npz")
    done(arrays, log)
    loads, forces = [], []
    for file in sorted(arrays.folder.rglob("contacts/**/part-*.npz")):
        loads.append(np.load(file)["load_n"])
    for file in sorted(arrays.folder.rglob("cycles/**/part-*.npz")):
        forces.append(np.load(file)["force_n"])
    np.testing.assert_array_equal(np.concatenate(loads), column(job, "contacts", "load"))
    name = job.topology.unit_names[7]
    got = np.concatenate(forces)[:, 2, 7]
    np.testing.assert_array_equal(got, column(job, "cycles", f"{name}.fz"))


def test_units_in_trouble_are_told_by_spells(job, palm_frames, tmp_path):
    """A board that falls silent, over the end of a partition: one row for each of its units."""
    frames = palm_frames.copy()
    cycle = np.cumsum(frames["id"] == 0x80) - 1
    board = frames["id"][3]
    silent = (frames["id"] == board) & (cycle >= 100) & (cycle < 180)
    write(tmp_path / "silent.log", frames[~silent])
    done(job, tmp_path / "silent.log")
    found = pyarrow.parquet.read_table(job.folder / "trouble").to_pylist()
    index = int(np.flatnonzero(job.topology.frames.can_id == board)[0])
    units = job.topology.frames.units[index]
    names = {job.topology.unit_names[i] for i in units[units >= 0]}
    late = [row for row in found if "STALE" in row["flags"].split()]
    assert {row["unit"] for row in found} == names
    assert {row["unit"] for row in late} == names
    assert {row["last_cycle"] for row in late} == {179}


def test_a_recording_is_decoded_as_it_was(job, palm_frames, record):
    file, count = record(palm_frames[: palm_frames.size // 4])
    summary = done(job, file)
    assert (summary["state"], summary["cycles"], summary["faults"]) == ("decoded", count, [])
    assert json.loads(job.manifest_of(parts_of([file])[0]).read_text())["complete"]


def test_a_recording_is_decoded_anew_by_another_calibration_and_for_other_wants(job, log, record):
    file, _ = record()
    done(job, file)
    before = column(job, "cycles", "wrench.fz")
    force, _ = changed(job, log, "calibration")
    assert (done(force, file)["state"], done(force, file)["state"]) == ("decoded", "unchanged")
    after = column(job, "cycles", "wrench.fz")
    by_log = [state.wrench[2] for state in skin.decode_log(force.topology, log, want=WANT)]
    np.testing.assert_array_equal(after, by_log)
    assert not np.array_equal(before, after)
    few = dataclasses.replace(force, options={"want": ("force",)})
    assert (done(few, file)["state"], done(few, file)["faults"]) == ("decoded", [])
    assert not (job.folder_of("contacts", parts_of([file])[0]) / "part-00000.parquet").exists()


def test_a_recording_of_another_skin_is_refused_and_leaves_what_is_there(
    job, palm_frames, contents, record
):
    file, _ = record(palm_frames[:2000], ("force",))
    done(job, file)
    before = contents(job.folder)
    moved, _ = changed(job, file, "topology")
    summary = done(moved, file)
    assert summary["state"] == "failed"
    assert "must be recorded with 'palm' as it is now; got differences in pos" in summary["error"]
    assert contents(job.folder) == before


def test_options_are_checked_before_anything_is_written(tmp_path):
    palm = topology.load("palm")
    with pytest.raises(OptionError, match="want"):
        Job(palm, tmp_path, {"want": ("frce",)})
    with pytest.raises(OptionError, match="format"):
        Job(palm, tmp_path, format="csv")
    with pytest.raises(OptionError, match="partition_cycles: must be"):
        Job(palm, tmp_path, partition_cycles=0)
    with pytest.raises(OptionError, match="logs: must be at least one; got none"):
        parts_of([])


def test_empty_logs_and_logs_with_the_same_head_are_told_apart(log, tmp_path):
    text = log.read_bytes()
    found = []
    for k, content in enumerate((b"", b"", text[:136] + b"began 1." + text[144:],
                                 text[:136] + b"began 2." + text[144:])):  # fmt: skip
        (folder := tmp_path / f"day{k}").mkdir()
        found.append(folder / "run.log")
        found[-1].write_bytes(content)
    assert len({part.key for part in parts_of(found)}) == len(found)


def test_the_same_log_is_not_taken_twice(log, tmp_path):
    (tmp_path / log.name).write_bytes(log.read_bytes())
    with pytest.raises(OptionError, match="must be another log than"):
        parts_of([log, tmp_path / log.name])


def test_the_writer_is_closed_where_decoding_ends_early(job, log, monkeypatch):
    def fail(*_given):
        raise OSError(5, "Input/output error", "disk")

    monkeypatch.setattr(module._Sums, "add", fail)
    summary = done(job, log)
    assert (summary["state"], summary["error"]) == ("failed", "disk: Input/output error")
    assert not [file for file in job.folder.rglob("*") if ".part" in file.name]
