"""What is replayed is what was live, to the bit, whatever happened to frames, time and poses."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import skin
import topology
from bus.errors import LogError
from bus.faults import FaultScript, FaultyTransport
from bus.faults import script as kinds
from bus.memory import MemoryTransport
from skin.contact.slip import SlipSettings
from skin.errors import OptionError
from skin.io.record.recorder import Recorder
from skin.io.record.replay import Pace
from skin.options import Options
from skin.pipeline import Pipeline
from skin.sim.node import SimulatedUnits
from skin.sim.scenes.load import open_scene
from skin.sinks import Ending
from skin.state import if_wanted
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import PERIOD_NS, frames_of, over
from tests.fixtures.robots import write_gripper

pytest.importorskip("mcap", reason="mcap is not installed")

FAULTS = (
    kinds.Drop(probability=0.03),
    kinds.Corrupt(probability=0.02),
    kinds.Duplicate(probability=0.01),
    kinds.Delay(probability=0.02, delay_s=0.006),
    kinds.Kill(units=["strip/r0c1"], from_s=0.3, to_s=0.6),
    kinds.Error(what="warning", at_s=0.4),
)


def same(live, replayed):
    """Assert that two states are the same, to the bit."""
    for name in ("cycle", "stamp_ns", "closed_by", "coverage", "overruns"):
        assert getattr(live, name) == getattr(replayed, name), name
    assert asdict(live.counters) == asdict(replayed.counters)
    for one, other, names in (
        (live, replayed, ("wrench", "wrench_sigma", "centroid", "centroid_covariance", "label",
                          "slip")),
        (live.units, replayed.units, live.units.__slots__[:-2]),
    ):  # fmt: skip
        for name in names:
            a, b = if_wanted(one, name), if_wanted(other, name)
            assert (a is None) == (b is None), name
            assert a is None or (a.dtype == b.dtype and a.tobytes() == b.tobytes()), name
    assert hasattr(live, "contacts") == hasattr(replayed, "contacts")
    for a, b in zip(*(if_wanted(one, "contacts") or () for one in (live, replayed)), strict=True):
        for name in a.record.dtype.names:
            assert a.record[name].tobytes() == b.record[name].tobytes(), name
        np.testing.assert_array_equal(a.units, b.units)


def check(file, live):
    """Assert that a recording gives these states, and knows that it does."""
    replay = skin.replay(file)
    count = 0
    for state, true in zip(replay, live, strict=True):
        same(true, state)
        count += 1
    assert replay.count == replay.same == count == len(live)
    assert replay.faults == []
    return replay


def faulty(loaded, scene="slide", faults=FAULTS, seed=5):
    """The host's end of a bus with faults, and the units at the other."""
    nodes = SimulatedUnits(loaded, open_scene(scene, loaded, seed=seed), seed=seed)
    script = FaultScript(faults=faults, seed=seed)
    return [FaultyTransport(end, script, topology=loaded) for end in nodes.in_process()], nodes


@long_after_first(
    "options",
    [
        {},
        {"estimator": "sine", "dtype": "float64", "sweeps": 2, "creep": False},
        {"want": {"temperature", "wrench"}, "skip": True, "ambient": False},
        {"slip": SlipSettings(friction=0.7), "false_contacts_per_day": 0.1, "auto_tare": False},
    ],
)
def test_a_scene_with_faults_is_replayed_to_the_bit(options, tmp_path):
    loaded, file = topology.load("strip"), tmp_path / "run.mcap"
    ends, nodes = faulty(loaded)
    with over(
        loaded, ends, record=file, deadline_s=0.001, pace=False,
        options=skin.Options(**options),
    ) as strip:  # fmt: skip
        live = [state.copy() for state in itertools.islice(strip, 250)]
    nodes.close()
    closed_by = {state.closed_by for state in live}
    assert {"complete", "deadline"} <= closed_by, "no fault had to be waited for"
    counters = live[-1].counters
    assert min(counters.lost, counters.late, counters.repeated, counters.error) > 0
    replay = check(file, live)
    assert replay.pipeline.options == strip.pipeline.options


@pytest.mark.long
def test_poses_that_move_are_replayed(tmp_path):
    file, live = tmp_path / "run.mcap", []
    with skin.open("strip", simulate=True, pace=False, record=file) as strip:
        name = strip.topology.patch_names[0]
        for state in itertools.islice(strip, 300):
            live.append(state.copy())
            angle = 0.003 * state.cycle
            turn = np.array(
                [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
            )
            strip.move_patch(name, turn, [0.001 * state.cycle, 0.0, 0.0])
    centres = [state.contacts[0].centroid for state in live if state.contacts]
    assert np.nanmax(centres, axis=0)[0] > np.abs(strip.topology.position[0]).max() + 0.05
    check(file, live)


def test_joints_that_move_are_replayed_with_the_poses(tmp_path):
    file, live = tmp_path / "run.mcap", []
    with skin.open(write_gripper(tmp_path), simulate=True, pace=False, record=file) as gripper:
        for state in itertools.islice(gripper, 30):
            live.append(state.copy())
            gripper.move_joints({"close": 0.001 * len(live)})
    replay, told = skin.replay(file), []
    for state, true in zip(replay, live, strict=True):
        same(true, state)
        told.append(replay.pipeline.q.tolist())
    assert told == [[pytest.approx(0.001 * k)] for k in range(30)]
    assert replay.faults == []


def test_a_loop_that_ends_within_a_batch_and_goes_on_is_replayed(tmp_path):
    file, live = tmp_path / "run.mcap", []
    with skin.open("strip", simulate=True, pace=False, record=file) as strip:
        for _ in range(20):
            live += [state.copy() for state in itertools.islice(strip, 3)]
    check(file, live)


def recorded(loaded, file, deadline_s=None):
    """A recorded pipeline whose clock is told, and that clock."""
    now = [10**12]
    pipeline = Pipeline(loaded, Options(), deadline_s=deadline_s)
    pipeline.sinks.attach(Recorder(file, pipeline))
    pipeline.assembler._clock = lambda: now[0]
    return pipeline, now


def test_silence_of_the_host_that_sends_sync_is_replayed(tmp_path):
    file, live = tmp_path / "run.mcap", []
    pipeline, now = recorded(topology.load("strip"), file)
    rng = np.random.default_rng(3)
    for _ in range(80):
        now[0] += int(rng.integers(0, 3 * PERIOD_NS))
        for by in (Ending.EXPIRED, Ending.SILENT):
            state = pipeline.end(by, now[0])
            if state is not None:
                live.append(state.copy())
    pipeline.sinks.stop()
    assert len(live) > 40
    assert np.ptp(np.diff([state.cycle for state in live])) > 0
    check(file, live)


def test_units_without_sync_are_replayed(tmp_path):
    file, live, loaded = tmp_path / "run.mcap", [], topology.load("strip")
    frames = frames_of("strip", "press", 80)
    frames = frames[frames["id"] != loaded.sync_id]
    free = dataclasses.replace(loaded, sync_id=None)
    pipeline, now = recorded(free, file)
    rng = np.random.default_rng(4)
    for part in np.array_split(frames, 100):
        now[0] += int(rng.integers(0, 2 * PERIOD_NS))
        state = pipeline.end(Ending.EXPIRED, now[0])
        live += [] if state is None else [state.copy()]
        live += [state.copy() for state in pipeline.feed(part)]
    state = pipeline.end(Ending.FLUSHED)
    live += [] if state is None else [state.copy()]
    pipeline.sinks.stop()
    assert len(live) > 30
    assert {state.closed_by for state in live} == {"deadline", "end"}
    check(file, live)


def test_a_batch_that_no_slot_has_room_for_is_replayed(tmp_path):
    file, loaded = tmp_path / "run.mcap", topology.load("strip")
    log = tmp_path / "run.log"
    with skin.open(loaded, simulate=True, pace=False, record=log) as strip:
        states = sum(1 for _ in itertools.islice(strip, 60))
    frames = np.concatenate([b.frames.copy() for b in skin.offline.read(log)])
    pipeline = Pipeline(loaded)
    pipeline.sinks.attach(Recorder(file, pipeline))
    live = [state.copy() for state in pipeline.feed(frames)]
    pipeline.sinks.stop()
    assert len(live) >= states - 1
    check(file, live)


def test_a_log_is_replayed_as_it_is_decoded(tmp_path):
    log = tmp_path / "run.log"
    with skin.open("strip", simulate=True, pace=False, record=log) as strip:
        live = [state.copy() for state in itertools.islice(strip, 30)]
    replay = skin.replay(log, "strip", dtype="float32")
    for state, true in zip(replay, live, strict=True):
        np.testing.assert_array_equal(state.units.force, true.units.force)
    assert replay.faults == []
    with pytest.raises(OptionError, match=r"run.log: topology: must be given with a log; got none"):
        skin.replay(log)


@pytest.mark.parametrize("name", ["view.png", "hand.toml", "notes", "run.txt.gz"])
def test_what_is_no_recording_and_no_log_is_said_to_be_none(name, tmp_path):
    (tmp_path / name).write_text("x")
    with pytest.raises(LogError) as raised:
        skin.replay(tmp_path / name)
    assert str(raised.value) == (
        f"{tmp_path / name}: must be a recording (.mcap) or a log (.asc, .blf, .csv, .db, .log, "
        f".trc); got {Path(name).suffix or 'no suffix'!r}"
    )


def test_a_pace_waits_as_long_as_it_was_between_states(monkeypatch):
    now, slept = [5.0], []

    def sleep(seconds):
        slept.append(seconds)
        now[0] += seconds

    monkeypatch.setattr("skin.io.record.replay.time.sleep", sleep)
    monkeypatch.setattr("skin.io.record.replay.time.monotonic", lambda: now[0])
    pace = Pace(2.0)
    for stamp_s in (100.0, 100.5, 101.5, 101.0, 3000.0):
        pace.wait(int(stamp_s * 1e9))
        now[0] += 0.01
    np.testing.assert_allclose(slept, [0.24, 0.49, 4.98], atol=1e-6)
    Pace(None).wait(10**18)
    assert len(slept) == 3


def test_units_of_a_bus_in_memory_may_be_listened_to(tmp_path):
    file = tmp_path / "run.mcap"
    near, far = MemoryTransport.pair()
    with far, over("strip", [near], sync="bus", record=file) as strip:
        live = [state.copy() for state in itertools.islice(strip, 3)]
    assert not live[0].units.valid.any()
    check(file, live)
