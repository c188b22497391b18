"""Several logs in processes: the same files as one after the other, whoever dies."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from skin.cli import main
from skin.errors import OptionError
from skin.io.bulk.progress import ProgressReport
from skin.io.bulk.run import run
from tests.fixtures.patience import LONG_S


@pytest.fixture(scope="module")
def logs(palm_frames, tmp_path_factory):
    """Three logs, each from another cycle on."""
    from bus.logs import write

    folder = tmp_path_factory.mktemp("logs")
    begins = [0, *(palm_frames["id"] == 0x80).nonzero()[0][[50, 100]]]
    found = []
    for k, begin in enumerate(begins):
        found.append(folder / f"run{k}.log")
        write(found[-1], palm_frames[begin:])
    return found


def children() -> set[int]:
    """Processes of this one."""
    return set(map(int, Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()))


def kill_a_child(known, job):
    """Kill a process that is not known, as soon as it has begun a log."""
    until = time.monotonic() + LONG_S
    while time.monotonic() < until:
        begun = (job.folder / "_logs").is_dir()
        for child in children() - known if begun else ():
            command = Path(f"/proc/{child}/cmdline").read_bytes()
            if b"spawn_main" in command:
                os.kill(child, signal.SIGKILL)
                return
        time.sleep(0.05)


@pytest.mark.long
def test_processes_give_the_files_of_one_even_if_one_dies(job, logs, contents):
    reports: list[ProgressReport] = []
    alone = run(job, logs, on_progress=reports.append)
    assert (alone["decoded"], alone["failed"], alone["faults"]) == (3, 0, [])
    assert reports[-1].logs_done == 3
    assert reports[-1].fraction == 1.0
    other = dataclasses.replace(job, folder=job.folder.parent / "other")
    killer = threading.Thread(target=kill_a_child, args=(children(), other))
    killer.start()
    together = run(other, logs, jobs=2)
    killer.join()
    assert (together["decoded"] + together["unchanged"], together["failed"]) == (3, 0)
    mine, theirs = contents(other.folder), contents(job.folder)
    assert mine.keys() == theirs.keys()
    assert [name for name in mine if mine[name] != theirs[name]] == []


def test_a_log_that_cannot_be_decoded_keeps_none_of_the_others_away(job, logs, tmp_path):
    (bad := tmp_path / "bad.log").write_text("no log at all\n")
    report = run(job, [bad, logs[0]])
    assert (report["decoded"], report["failed"]) == (2, 0)
    assert any(f"{bad}:1" in fault for fault in report["faults"])
    again = run(job, [bad, logs[0]])
    assert again["unchanged"] == 2
    assert again["faults"] == report["faults"]


def test_jobs_are_a_whole_number(job, logs):
    with pytest.raises(OptionError, match="jobs: must be"):
        run(job, logs, jobs=0)


def test_the_command_decodes_into_a_folder_and_tells_what_it_did(logs, tmp_path, capsys):
    folder = tmp_path / "out"
    given = ["decode", "palm", *map(str, logs), "-o", str(folder)]
    assert main([*given, "--shard", "2/3"]) == 0
    assert capsys.readouterr().out.count("decoded: ") == 1
    assert main(given) == 0
    shown = capsys.readouterr().out
    assert "2 decoded, 1 unchanged, 0 failed" in shown
    assert f"written: {folder}" in shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["palm"], "decode: must be given a topology and a log, or a recording; got palm"),
        (["palm", "a.log", "b.log"], "--output: must be a folder for several logs; got None"),
        (["palm", "a.log", "b.log", "-o", "x.csv"], "must be a folder for several logs; got x.csv"),
        (["palm", "none.log", "-o", "out"], "none.log: must be an existing file; got none"),
        (["palm", "a.log", "--want", "force"], "--want: must be given with a folder as --output"),
        (["palm", "a.log", "-o", "a.npz", "--format", "npz"], "--format: must be given with a fo"),
        (["palm", "a.log", "-o", "out", "--shard", "4/3"], "--shard: must be I/N with I from 1"),
    ],
)
def test_wrong_use_is_refused(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["decode", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


JOB = """
import signal
import sys
import time
from pathlib import Path
import topology
from skin.io.bulk.job import Job
from skin.io.bulk.run import run

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells let those behind ignore it
    folder, *logs = map(Path, sys.argv[1:])
    # it does not end by itself, however fast the machine is
    stay = lambda reports: time.sleep(3600.0)
    run(Job(topology.load("palm"), folder, partition_cycles=100), logs, jobs=2, on_progress=stay)
"""


@pytest.mark.parametrize("number", [
    pytest.param(signal.SIGTERM, marks=pytest.mark.long),
    pytest.param(signal.SIGINT, marks=pytest.mark.long),
    signal.SIGKILL,
])  # fmt: skip
def test_processes_end_with_the_one_that_started_them(number, logs, tmp_path):
    (script := tmp_path / "script.py").write_text(JOB)
    folder = tmp_path / "out"
    job = subprocess.Popen(
        [sys.executable, script, folder, *logs], start_new_session=True,
        stderr=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    until = time.monotonic() + LONG_S
    while not list(folder.rglob("part-*")):
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
    assert not list(folder.rglob(".part-*"))
