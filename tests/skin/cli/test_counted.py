"""What commands and tables count: units that are switched off are no loss; wrong frames."""

from __future__ import annotations

import dataclasses
import itertools
import json
import re

import numpy as np
import pytest

import skin
import topology
from bus.cycle import WRONG_FRAMES, FrameCounters
from skin.cli import main
from skin.io.messages.record import COUNTERS
from skin.state import Status
from skin.view.health import Health, flagged
from skin.view.terminal import LiveTable
from tests.fixtures.cases import long_after_first
from tests.naive.record import snapshots


def last_json(capsys):
    return json.loads(capsys.readouterr().out.splitlines()[-1])


@pytest.fixture
def partly_off(tmp_path):
    """A palm of which a unit is switched off."""
    file = tmp_path / "palm.toml"
    text = topology.load("palm").path.read_text()
    file.write_text(text + '\n[[overrides]]\nunit = "palm/r0c0"\nenabled = false\n')
    assert not topology.load(file).enabled.all()
    return str(file)


@long_after_first("name", ["run", "publish"])
def test_a_unit_that_is_switched_off_is_no_loss(name, partly_off, tmp_path, capsys):
    if name == "publish":
        pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")
    scene = tmp_path / "nothing.toml"
    scene.write_text('format = 1\nname = "nothing"\nseconds = 60.0\n')
    command = [name, partly_off, "--simulate", str(scene), "--seconds", "0.3", "--json"]
    assert main(command) == 0
    report = last_json(capsys)
    assert (report["units"], report["units_enabled"], report["units_heard"]) == (64, 63, 63)
    assert report["silent_units"] == []
    # whole cycles alone: a host that is late may close one before its frames have come
    if report["complete_cycles"] == report["cycles"]:
        assert report["valid_share"] == 1.0


def test_a_log_of_a_skin_with_a_unit_off_is_all_valid(partly_off, tmp_path, capsys):
    log = tmp_path / "run.log"
    assert main(["sim", "palm", "press", "--seconds", "0.2", "--record",
                 str(log)]) == 0  # fmt: skip
    assert main(["decode", partly_off, str(log), "--json"]) == 0
    assert last_json(capsys)["logs"][0]["valid_share"] == 1.0
    out = str(tmp_path / "out")
    assert main(["decode", partly_off, str(log), "-o", out, "--format", "npz", "--json"]) == 0
    assert last_json(capsys)["logs"][0]["valid_share"] == 1.0


def test_live_views_name_no_unit_that_is_switched_off(partly_off):
    with skin.open(partly_off, simulate=True, pace=False) as palm:
        state = list(itertools.islice(palm, 3))[-1]
    names = palm.topology.unit_names
    assert state.units.status[0] & Status.DISABLED
    assert flagged(state.units.status, names) == []
    text = "\n".join(LiveTable(palm.topology).lines(state))
    assert "!" not in text
    record = snapshots(1, 64)[0]
    record["status"], record["whole"] = state.units.status, True
    assert dict(Health(palm.topology).rows(record))["units"] == "63 of 63 valid"


def test_live_views_name_all_frames_that_are_wrong(palm_state):
    """Each kind is either wrong, or one of those that a sound bus carries."""
    kinds = {field.name for field in dataclasses.fields(FrameCounters)}
    sound = {"data", "sync", "heartbeat", "configuration", "remote", "echo", "controller_overflow"}
    assert set(WRONG_FRAMES) == kinds - sound
    counters = FrameCounters(**{name: 11 + i for i, name in enumerate(sorted(kinds))})
    told = {f"{name} {getattr(counters, name)}" for name in WRONG_FRAMES}
    palm, state = palm_state
    totals = np.array(dataclasses.astuple(counters))
    text = "\n".join(LiveTable(palm).lines(dataclasses.replace(state, totals=totals)))
    (shown,) = re.findall(r"frames +\d+, (.*\w)", text)
    assert set(shown.split(", ")) == told
    record = snapshots(1, 64)[0]
    record["counters"] = [getattr(counters, name) for name in COUNTERS]
    losses = dict(Health(palm).rows(record))["losses"]
    assert set(losses.split(", ")) == told


@pytest.fixture
def palm_state():
    with skin.open("palm", simulate=True, pace=False) as palm:
        return palm.topology, next(iter(palm))
