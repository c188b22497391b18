"""Many logs into tables: what the live skin shows, finished once, by any executor."""

from __future__ import annotations

import dataclasses
import itertools
import os
import signal
import subprocess
import sys
import time
import warnings
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest

import skin
import topology
from bus.errors import ChannelError, LogError
from skin.cli import main
from skin.contact.record import CONTACT
from skin.errors import OptionError
from skin.io.bulk import _Tally, decode_logs
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import frames_of
from tests.fixtures.logs import write
from tests.fixtures.patience import LONG_S

parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")

CYCLES = 600


@pytest.fixture(scope="module")
def frames():
    """A sphere that presses and slides."""
    return frames_of("palm", "slide", CYCLES)


@pytest.fixture(scope="module")
def logs(frames, tmp_path_factory):
    """Three logs, each from another cycle on."""
    folder = tmp_path_factory.mktemp("logs")
    begins = [0, *(frames["id"] == 0x80).nonzero()[0][[50, 100]]]
    for k, begin in enumerate(begins):
        write(folder / f"run{k}.log", frames[begin:])
    return sorted(folder.iterdir())


def contents(folder: Path) -> dict[str, bytes]:
    """All that stands in a folder of tables, by file."""
    return {str(file.relative_to(folder)): file.read_bytes()
            for file in sorted(folder.rglob("*")) if file.is_file()}  # fmt: skip


def column(folder, table, name):
    return parquet.read_table(folder / table, columns=[name])[name].to_numpy()


@long_after_first("how", ["threads", "a cluster"])
def test_an_executor_gives_the_same_files(how, logs, tmp_path):
    decode_logs("palm", logs, tmp_path / "alone")
    with executor_of(how) as executor:
        report = decode_logs("palm", logs, tmp_path / "spread", executor=executor)
    assert [Path(one["log"]).name for one in report["logs"]] == [log.name for log in logs]
    assert (report["decoded"], report["faults"]) == (3, [])
    assert contents(tmp_path / "spread") == contents(tmp_path / "alone")


def executor_of(how) -> Executor:
    if how == "threads":
        return ThreadPoolExecutor(2)
    distributed = pytest.importorskip("distributed", reason="distributed is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own, about ports
        client = distributed.Client(processes=False, n_workers=2, threads_per_worker=1,
                                    dashboard_address=None)  # fmt: skip
        return client.get_executor()


def test_a_finished_log_is_left_out_and_reported_again(logs, tmp_path):
    torn = tmp_path / "torn.log"
    torn.write_bytes(logs[0].read_bytes() + b"(17000000.0) palm 1G4#\n")
    out, seen = tmp_path / "out", []
    first = decode_logs("palm", [torn, logs[1]], out, on_log=seen.append)
    before = contents(out)
    assert seen == first["logs"]
    began = column(out, "contacts", "slip_began")
    assert sum(one["slips"] for one in seen) == np.count_nonzero(began) > 0
    again = decode_logs("palm", [torn, logs[1]], out)
    assert (first["decoded"], again["unchanged"]) == (2, 2)
    assert again["faults"] == first["faults"]
    assert f"{torn}:" in first["faults"][0]
    assert contents(out) == before
    (out / "faults/skin=palm").rename(out / "faults/skin=gone")  # of a call that was ended
    assert decode_logs("palm", [torn, logs[1]], out)["decoded"] == 2


def test_a_slip_counts_once_as_it_begins_and_a_force_without_its_torque():
    block = MagicMock(contacts=np.zeros(4, CONTACT), overruns=[0], wrench=np.full((1, 6), 9.0))
    block.contacts["onset_ns"], block.contacts["seen_ns"] = (0, 20, 20, 20), (10, 20, 30, 40)
    block.wrench[0, :3] = 3.0, 4.0, 0.0
    tally = _Tally(topology.load("palm"))
    tally.add(block)
    report = tally.report()
    assert (report["slips"], report["peak_force_n"]) == (1, 5.0)


def changed(palm, what):
    """The palm, and options, with something that is not as before."""
    if what == "calibration":
        parameters = dict(palm.parameters)
        parameters["frequency_rest_hz"] = parameters["frequency_rest_hz"] + 1.0
        return dataclasses.replace(palm, parameters=parameters), {}
    if what == "topology":
        return dataclasses.replace(palm, position=palm.position + 0.001), {}
    return palm, {"want": ("force",)} if what == "options" else {}


@long_after_first("what", ["calibration", "topology", "options", "log"])
def test_a_log_is_decoded_again_where_something_changed(what, logs, tmp_path):
    log, out, palm = tmp_path / "run.log", tmp_path / "out", topology.load("palm")
    log.write_bytes(b"".join(logs[0].read_bytes().splitlines(keepends=True)[:1000]))
    decode_logs(palm, [log], out)
    other, options = changed(palm, what)
    if what == "log":
        log.write_bytes(logs[0].read_bytes())
    assert decode_logs(other, [log], out, **options)["decoded"] == 1
    assert decode_logs(other, [log], out, **options)["unchanged"] == 1
    (file,) = (out / "cycles").rglob("*.parquet")
    told = parquet.read_schema(file).metadata
    assert {b"topology_sha256", b"calibration_sha256", b"log_sha256", b"serials"} <= told.keys()
    assert bool(list((out / "contacts").rglob("*.parquet"))) == (what != "options")


@pytest.mark.parametrize("format", ["csv", "npz"])
def test_other_formats_are_decoded_each_time(format, logs, tmp_path):
    for _ in range(2):
        assert decode_logs("palm", logs[:1], tmp_path, format=format)["decoded"] == 1
    names = [file.name for file in sorted(tmp_path.rglob("*.*")) if file.is_file()]
    assert names == [f"{table}.{format}" for table in ("contacts", "cycles", "faults")]


def test_what_one_log_cannot_do_keeps_none_of_the_others_away(logs, frames, tmp_path):
    (bad := tmp_path / "bad.log").write_text("no log at all\n")
    back = frames.copy()
    back["stamp_ns"][back.size // 2 :] -= 3_600_000_000_000
    write(tmp_path / "back.log", back)
    strip = tmp_path / "strip.log"
    write(strip, frames_of("strip", "press", 50))
    report = decode_logs("palm", [bad, tmp_path / "back.log", strip, logs[2]], tmp_path / "out")
    told = [" ".join(one["faults"]) for one in report["logs"]]
    assert f"{bad}:1" in told[0]
    assert "must not be older than the frames before it" in told[1]
    assert f"{strip}: must hold" in told[2]
    assert told[3] == ""
    assert report["faults"] == [fault for one in report["logs"] for fault in one["faults"]]


class Dying(Executor):
    """Processes that die."""

    def submit(self, *given, **how):
        future = Future()
        future.set_exception(RuntimeError("out of memory"))
        return future


def test_a_worker_that_dies_fails_its_log(logs, tmp_path):
    report = decode_logs("palm", logs, tmp_path, executor=Dying())
    assert report["failed"] == 3
    assert f"{logs[0]}: must be decoded by a worker; got RuntimeError('out" in report["faults"][0]


def test_units_at_fault_are_told_by_intervals(frames, tmp_path):
    """A board that falls silent, over the end of a block: one row for each of its units."""
    cycle = np.cumsum(frames["id"] == 0x80) - 1
    silent = (frames["id"] == frames["id"][3]) & (cycle >= 100) & (cycle < 180)
    write(tmp_path / "silent.log", frames[~silent])
    decode_logs("palm", [tmp_path / "silent.log"], tmp_path / "out")
    found = parquet.read_table(tmp_path / "out" / "faults").to_pylist()
    palm = topology.load("palm")
    units = palm.frames.units[int(np.flatnonzero(palm.frames.can_id == frames["id"][3])[0])]
    late = [row for row in found if "STALE" in row["flags"].split()]
    assert {row["unit"] for row in late} == {palm.unit_names[i] for i in units[units >= 0]}
    assert {row["last_cycle"] for row in late} == {179}


@pytest.fixture
def recording(tmp_path):
    pytest.importorskip("mcap", reason="mcap is not installed")
    with skin.open("palm", simulate="press", pace=False, record=tmp_path / "run.mcap") as palm:
        for _ in itertools.islice(palm, 200):
            pass
    return tmp_path / "run.mcap", palm.topology


def test_a_recording_is_decoded_as_it_was_or_by_another_calibration(recording, tmp_path):
    file, palm = recording
    first = decode_logs(palm, [file], tmp_path / "out")
    assert (first["decoded"], first["cycles"], first["faults"]) == (1, 200, [])
    before = column(tmp_path / "out", "cycles", "palm/r3c3.fz")
    other, _ = changed(topology.load("palm"), "calibration")
    assert decode_logs(other, [file], tmp_path / "out")["decoded"] == 1
    assert not np.array_equal(before, column(tmp_path / "out", "cycles", "palm/r3c3.fz"))
    assert decode_logs(other, [file], tmp_path / "out", recalibrate=False)["decoded"] == 1
    assert np.array_equal(before, column(tmp_path / "out", "cycles", "palm/r3c3.fz"))
    moved, _ = changed(topology.load("palm"), "topology")
    kept = contents(tmp_path / "out")
    (fault,) = decode_logs(moved, [file], tmp_path / "out")["faults"]
    assert "must be recorded with 'palm' as it is now; got differences in pos" in fault
    assert contents(tmp_path / "out") == kept


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"logs": []}, OptionError, "logs: must be at least one; got none"),
        ({"logs": ["none.log"]}, LogError, "none.log: must be an existing file"),
        ({"want": ("frce",)}, OptionError, "want"),
        ({"format": "mcap"}, OptionError, "format: must be"),
        ({"channels": {"1": "mian"}}, ChannelError, "must be a bus of 'palm'"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_written(
    given, error, message, logs, tmp_path
):
    with pytest.raises(error, match=message):
        decode_logs("palm", **{"logs": logs, "out": tmp_path / "out"} | given)
    with pytest.raises(OptionError, match="must be another log than"):
        decode_logs("palm", [logs[0], logs[0]], tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_logs_of_several_days_may_have_the_same_name(logs, tmp_path):
    for k in range(2):
        (tmp_path / f"day{k}").mkdir()
        (tmp_path / f"day{k}" / "run.log").write_bytes(logs[k].read_bytes())
    report = decode_logs("palm", tmp_path.glob("*/run.log"), tmp_path / "out")
    assert report["decoded"] == len(list((tmp_path / "out/cycles").rglob("*.parquet"))) == 2


# -- the command -----------------------------------------------------------------------------------


@pytest.mark.long
def test_processes_give_the_same_files_and_the_command_says_what_it_did(logs, tmp_path, capsys):
    given = ["decode", "palm", *map(str, logs), "-o"]
    assert main([*given, str(tmp_path / "two"), "--jobs", "2"]) == 0
    shown = capsys.readouterr().out
    lines = [line.split() for line in shown.splitlines()]
    assert ["decoded", "3"] in lines
    assert [line[1] for line in lines[-3:]] == 3 * ["decoded"]
    assert main([*given, str(tmp_path / "one")]) == 0
    assert str(tmp_path / "one") in capsys.readouterr().out
    assert contents(tmp_path / "two") == contents(tmp_path / "one")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["palm"], "decode: must be given a topology and a log, or a recording; got palm"),
        (["palm", "a.log", "b.log"], "--output: must be a folder for several logs; got None"),
        (["palm", "a.log", "b.log", "-o", "x.csv"], "must be a folder for several logs; got x.csv"),
        (["palm", "none.log", "-o", "out"], "none.log: must be an existing file; got none"),
        (["palm", "a.log", "-o", "a.npz", "--format", "npz"], "--format: must be given with a fo"),
        (["palm", "a.log", "-o", "out", "--jobs", "0"], "--jobs: must be an integer from 1"),
    ],
)
def test_wrong_use_is_refused(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["decode", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@long_after_first("number", [
    pytest.param(signal.SIGTERM, marks=pytest.mark.long), signal.SIGKILL,
])  # fmt: skip
def test_processes_end_with_the_one_that_started_them(number, logs, tmp_path):
    code = "import sys; from skin.cli import main; main(sys.argv[1:])"
    many = [str(tmp_path / f"{k}.log") for k in range(40)]
    for path in many:
        Path(path).write_bytes(logs[0].read_bytes())
    command = ["decode", "palm", *many, "-o", str(tmp_path / "out"), "--jobs", "2"]
    job = subprocess.Popen(
        [sys.executable, "-c", code, *command], start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    until = time.monotonic() + LONG_S
    while not list((tmp_path / "out").rglob("*.parquet")):
        assert job.poll() is None
        assert time.monotonic() < until
        time.sleep(0.05)
    os.kill(job.pid, number)
    assert job.wait(LONG_S) != 0
    until = time.monotonic() + LONG_S
    while time.monotonic() < until:
        try:
            os.killpg(job.pid, 0)
        except ProcessLookupError:
            break
        time.sleep(0.1)
    else:
        os.killpg(job.pid, signal.SIGKILL)
        pytest.fail("processes are left")
