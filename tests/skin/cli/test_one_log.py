"""Recordings are decoded as logs are; what is silent makes a wrench and a contact not whole."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest

import skin
from skin.cli import main
from skin.io.bulk import decode_logs
from tests.fixtures.live import frames_of
from tests.fixtures.logs import write

parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")

CYCLES = 350


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Bodies that press a palm, with neighbours that feel each other's films."""
    path = tmp_path_factory.mktemp("log") / "run.log"
    write(path, frames_of("palm", "press", CYCLES))
    return path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording of a run, and the forces that it had."""
    pytest.importorskip("mcap", reason="mcap is not installed")
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    how = skin.Options(false_contacts_per_day=0.5)
    with skin.open("strip", simulate="press", pace=False, record=path, options=how) as strip:
        force = np.stack([state.units.force for state in itertools.islice(strip, 120)])
    return path, force


@pytest.mark.parametrize("first", [[], ["strip"]], ids=["by its own topology", "by a given one"])
def test_a_recording_is_decoded_as_a_log_is(first, recorded, tmp_path, capsys):
    path, force = recorded
    assert main(["decode", *first, str(path), "-o", str(tmp_path / "run.npz"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    other = decode_logs("strip", [path], tmp_path / "out", format="npz", auto_tare=False)
    for one, tares in ((report, True), (other, False)):
        assert (one["topology"], one["cycles"], one["faults"]) == ("strip", 120, [])
        options = one["logs"][0]["options"]  # of its run, but for those that are given
        assert (options["false_contacts_per_day"], options["auto_tare"]) == (0.5, tares)
    with np.load(tmp_path / "run.npz") as found:
        np.testing.assert_array_equal(found["force"], force)


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
