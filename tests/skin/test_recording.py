"""Recordings of live skins and of simulated units, and what is decoded from them."""

from __future__ import annotations

import json
import threading

import pytest

import skin
import topology
from bus.logs import Recording, buses_of
from bus.logs.channels import names_of
from skin.cli import main
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import frames_of


def test_a_skin_that_another_thread_closes_leaves_a_whole_log(tmp_path):
    log = tmp_path / "run.log"
    with skin.open("strip", simulate=True, pace=False, record=log) as strip:
        closing = threading.Timer(0.05, strip.close)
        for state in strip:
            if state.cycle == 0:
                closing.start()
        closing.join()
    decoded = skin.decode_log("strip", log)
    assert list(decoded)
    assert decoded.faults == []


@long_after_first(
    "command",
    [
        ["run", "hand", "--simulate", "--seconds", "1.0"],
        ["run", "hand", "--simulate", "press", "--seconds", "1.0"],
        ["sim", "hand", "press", "--seconds", "1.0"],
    ],
)
def test_logs_of_the_commands_are_decoded_as_they_are(command, tmp_path, capsys):
    log = tmp_path / "run.log"
    assert main([*command, "--record", str(log)]) == 0
    capsys.readouterr()
    assert main(["decode", "hand", str(log), "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["cycles"] >= 3  # on a loaded machine
    assert report["logs"][0]["valid_share"] > 0.9
    assert report["faults"] == []


def test_simulated_units_on_a_bus_that_others_reach_record_nothing(tmp_path, capsys):
    log = tmp_path / "sim.log"
    assert main(["sim", "strip", "--bus", "virtual:recorded", "--record", str(log)]) == 2
    assert "--record: must be absent on a bus that others reach" in capsys.readouterr().err
    assert not log.exists()


def test_names_of_channels_follow_the_topology():
    hand = topology.load("hand")
    assert names_of(hand) == ["hand-palm", "hand-fingers"]
    for channel, names, numbers in (
        ("can3,can1", ["can3", "can1"], {"can3": 0, "can1": 1}),
        ("239.0.0.1,239.0.0.2", ["239.0.0.1", "239.0.0.2"], {"239.0.0.1": 0, "239.0.0.2": 1}),
    ):
        there = hand.on(interface="socketcan", channel=channel)
        assert names_of(there) == names
        assert buses_of(there) == {name: i for i, name in enumerate(names)}
        assert buses_of(there, "run.blf") == numbers


def test_a_full_disk_is_told_with_the_name_of_the_log(tmp_path):
    log = tmp_path / "run.log"
    log.symlink_to("/dev/full")
    frames = frames_of("strip", "press", 2000)
    with pytest.raises(OSError, match="No space left on device") as caught:
        recorded(log, frames)
    assert caught.value.filename == str(log)


def recorded(log, frames):
    recording = Recording(log, topology.load("strip"))
    try:
        recording.write(frames)
    finally:
        recording.close()
