"""A recording of `skin run`, and `skin replay`: from a run to the same run."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import skin
import topology
from skin.cli import main
from skin.view.terminal import LiveTable
from tests.fixtures.cases import long_after_first
from tests.fixtures.patience import LONG_S

pytest.importorskip("mcap", reason="mcap is not installed")


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A recording that the command has made."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    command = ["run", "strip", "--record", str(path), "--simulate", "press"]
    assert main([*command, "--seconds", "0.4"]) == 0
    return path


def last_line(capsys):
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_what_was_recorded_is_told(tmp_path, capsys):
    path = tmp_path / "run.mcap"
    command = ["run", "strip", "--simulate", "--seconds", "0.2", "--record", str(path), "--json"]
    assert main(command) == 0
    report = last_line(capsys)
    recorded = report["recorded"]
    assert recorded["cycles"] == report["cycles"] > 0
    assert recorded["bytes"] <= path.stat().st_size
    assert (recorded["lost_cycles"], recorded["lost_frames"], recorded["failure"]) == (0, 0, None)


def test_periods_that_this_machine_left_out_are_shown_live_at_the_end_and_in_the_replay(
    tmp_path, monkeypatch, capsys
):
    show, late = LiveTable.show, iter([0.0, 0.1])
    monkeypatch.setattr(
        LiveTable, "show", lambda *given: (show(*given), time.sleep(next(late, 0.0)))
    )
    path = tmp_path / "run.mcap"
    command = ["run", "strip", "--record", str(path), "--simulate", "--seconds", "0.3"]
    assert main(command) == 0
    shown = re.search(r"^overruns +(\d+)$", capsys.readouterr().out, re.M)
    assert shown is not None
    assert int(shown[1]) >= 0.1 * topology.load("strip").cycle_rate_hz - 2
    assert main(["replay", str(path), "--speed", "0", "--json"]) == 0
    report = last_line(capsys)
    assert report["overruns"] == int(shown[1])
    assert report["counters"]["lost"] == 0
    played = skin.replay(path, speed=None)
    *_, last = played
    assert f", {shown[1]} periods left out" in LiveTable(played.topology).lines(last)[0]


def test_a_log_is_replayed_with_its_topology(tmp_path, capsys):
    log = tmp_path / "run.log"
    assert main(["run", "strip", "--simulate", "--seconds", "0.2", "--record", str(log)]) == 0
    assert main(["replay", "strip", str(log), "--speed", "100", "--json"]) == 0
    report = last_line(capsys)
    assert (report["same"], report["faults"]) == (None, [])
    assert main(["replay", str(log)]) == 2
    assert "topology: must be given with a log; got none" in capsys.readouterr().err


def test_a_speed_is_not_negative(file, capsys):
    assert main(["replay", str(file), "--speed", "-1"]) == 2
    assert capsys.readouterr().err == "--speed: must be 0, or from 1e-06 to 1e+06; got -1\n"


@long_after_first(("number", "status"), [
    (signal.SIGINT, 0), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.long),
])  # fmt: skip
def test_a_run_that_is_interrupted_ends_its_recording_properly(tmp_path, number, status):
    """As Ctrl-C does it: the signal goes to the whole group of processes."""
    from mcap.reader import make_reader

    path = tmp_path / "run.mcap"
    # a job in the background of a shell ignores SIGINT, and so would its children
    anew = ["env", "--default-signal=INT", sys.executable, "-m", "skin"]
    running = subprocess.Popen(
        [*anew, "run", "strip", "--record", str(path), "--simulate", "--json"],
        cwd=Path(__file__).parents[3], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    try:
        until = time.monotonic() + LONG_S
        while not path.exists() or path.stat().st_size < 100_000:
            assert running.poll() is None
            assert time.monotonic() < until
            time.sleep(0.02)
        os.killpg(running.pid, number)
        out, err = running.communicate(timeout=LONG_S)
    finally:
        running.kill()
    assert running.returncode == status
    assert "Traceback" not in err
    with path.open("rb") as file:
        found = make_reader(file).get_summary()
        counts = found.statistics.channel_message_counts
        topics = {channel.topic: counts.get(n, 0) for n, channel in found.channels.items()}
    if status == 0:
        recorded = json.loads(out.splitlines()[-1])["recorded"]
        assert recorded["cycles"] == topics["/skin/state"]
        assert recorded["bytes"] <= path.stat().st_size
        assert (recorded["lost_cycles"], recorded["lost_frames"]) == (0, 0)
    replay = skin.replay(path)
    assert sum(1 for _ in replay) == topics["/skin/state"] == replay.same
    assert replay.faults == []
