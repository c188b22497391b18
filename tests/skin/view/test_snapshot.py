"""Snapshots: a copy of what a state says, as often as an eye follows, never in the way."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import skin
from skin.contact.record import Flag
from skin.io.messages.record import COUNTERS, contacts_of
from skin.options import Options
from skin.pipeline import Pipeline
from skin.state import Status, if_wanted
from skin.view import snapshot
from skin.view.colour import QUANTITIES
from skin.view.drawing import contact_labels
from skin.view.health import Health, flagged
from skin.view.snapshot import Snapshots, snapshot_dtype
from skin.view.unit_folder import History
from skin.worker import RingBuffer, described
from tests.fixtures.robots import write_gripper
from tests.fixtures.shown import Shown
from tests.naive.record import fill, snapshots
from topology import load


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test sets, in seconds."""
    now = [100.0]
    monkeypatch.setattr(snapshot.time, "monotonic_ns", lambda: round(1e9 * now[0]))
    return now


def watched(shown, slots=8):
    ring = RingBuffer(snapshot_dtype(shown.topology, 16), slots)
    taken = Snapshots(ring, shown.pipeline, shown.timing)
    shown.attach(SimpleNamespace(state=taken.look))
    return ring, taken


def drained(ring):
    records = ring.unread().copy()
    ring.release(records.size)
    return records


@pytest.mark.parametrize("want", [None, {"temperature"}, {"force", "sigma"}])
def test_a_snapshot_says_what_the_state_says(want, clock):
    with skin.open("palm", simulate="press", pace=False, want=want) as palm:
        ring = RingBuffer(snapshot_dtype(palm.topology, 16), 8)
        taken = Snapshots(ring, palm.pipeline, palm.timing, palm.transports)
        for count, _ in enumerate(palm):
            state = palm.pipeline.now
            if count == 5 if want else state.contacts and state.contacts[0].load > 5.0:
                break
        assert taken.look(state)
        one, expected = drained(ring)[1:], np.zeros(1, ring.dtype)
        fill(expected, state)
        given = palm.pipeline.counts.copy()
    names = ("stamp_ns", "cycle", "counters", "force", "force_sigma", "temperature", "test_ratio",
             "status", "contact", "wrench", "contact_count")  # fmt: skip
    for name in names:
        np.testing.assert_array_equal(one[name], expected[name], name)
    assert [a.tobytes() for a in contacts_of(one[0])] == [
        a.tobytes() for a in contacts_of(expected[0])
    ]
    np.testing.assert_array_equal(one["counts"][0], given)
    assert one["whole"].all()
    assert len(contact_labels(one[0])) == len(if_wanted(state, "contacts") or ())
    rows = dict(Health(palm.topology.unit_names, 250.0).rows(one[0]))
    assert ("test ratio" in rows) == (if_wanted(state.units, "test_ratio") is not None)


def test_contacts_and_a_wrench_that_are_not_whole_say_so():
    with skin.open("palm", simulate="press", pace=False) as palm:
        state = next(state for state in palm if state.contacts).copy()
    record = snapshots(1, palm.topology.n)
    fill(record, state)
    assert [text.endswith("   not whole") for text in contact_labels(record[0])] == [False]
    state.whole = False
    state.contacts[0].record["flags"] |= int(Flag.UNSEEN)
    fill(record, state)
    assert [text.endswith("   not whole") for text in contact_labels(record[0])] == [True]
    rows = dict(Health(palm.topology.unit_names, 250.0).rows(record[0]))
    assert rows["wrench"].startswith("not whole")


def test_the_other_process_reads_the_same_record():
    dtype = snapshots(1, 7).dtype
    assert np.dtype([(name, kind, tuple(shape)) for name, kind, shape in described(dtype)]) == dtype


def test_there_are_30_snapshots_a_second_at_most(clock):
    shown = Shown()
    ring, counted = watched(shown, 64)
    for _ in range(250):
        clock[0] += 0.004
        shown.show()
    assert counted.taken == 30
    records = drained(ring)[1:]
    assert np.diff(records["cycles"]).tolist()[:4] == [9, 8, 8, 9]
    assert records["works"].sum() == records["cycles"][-1]
    assert (records["work_us"][0, :1] == 50.0).all()


def test_a_late_loop_takes_no_snapshots_in_a_row_to_catch_up(clock):
    shown = Shown()
    _, counted = watched(shown, 64)
    shown.show()
    clock[0] += 10.0
    for _ in range(5):
        shown.show()
        clock[0] += 0.001
    assert counted.taken == 2


def test_where_the_view_hangs_the_loop_goes_on_and_counts(clock):
    shown = Shown()
    _, counted = watched(shown, 4)
    for _ in range(10):
        clock[0] += 0.1
        shown.show()
    assert (counted.taken, counted.missed) == (3, 7)  # one slot has the poses


def test_before_the_first_cycle_units_stand_there_unheard():
    shown = Shown()
    first = drained(watched(shown)[0])[0]
    assert (first["status"] == Status.NEVER).all()
    np.testing.assert_array_equal(first["pose"][:3], shown.poses[0])


def test_poses_come_when_they_change(clock):
    shown = Shown()
    ring, _ = watched(shown)
    for move in (0.0, 0.0, 0.5, 0.0):
        if move:
            shown.poses = shown.poses[0] + move, shown.poses[1]
        clock[0] += 0.1
        shown.show()
    records = drained(ring)
    np.testing.assert_allclose(np.diff(records["pose"][:, 0, 0]), [0.0, 0.0, 0.5, 0.0], atol=1e-6)
    assert np.diff(records["moved"]).tolist() == [0, 0, 1, 0]


def test_joints_come_with_the_poses_that_they_are_of(tmp_path, clock):
    """NaN where poses were set without joints, as a replay does."""
    gripper = load(write_gripper(tmp_path))
    pipeline = Pipeline(gripper, Options(want={"temperature"}))
    ring = RingBuffer(snapshot_dtype(gripper, 16), 8)
    taken = Snapshots(ring, pipeline, None)
    assert drained(ring)["q"].tolist() == [[0.0]]
    expected = []
    for act, q in (
        (lambda: pipeline.move_joints({"close": 0.02}), 0.02),
        (lambda: pipeline.move(gripper.position, gripper.rotation), np.nan),
        (lambda: pipeline.move_joints([0.03]), 0.03),
    ):
        act()
        clock[0] += 1.0
        assert taken.look(pipeline.now)
        expected.append([q])
    np.testing.assert_array_equal(drained(ring)["q"], expected)


def test_joints_are_known_although_a_recorder_has_the_poses_set_again(tmp_path):
    class Recorder(skin.Sink):
        inline = True

        def moved(self, position, rotation):
            pass

    pipeline = Pipeline(load(write_gripper(tmp_path)), Options(want={"temperature"}))
    pipeline.attach(Recorder())
    pipeline.move_joints({"close": 0.01})
    assert pipeline.q.tolist() == [0.01]


def test_health_has_the_test_ratio_of_the_worst_unit_and_of_those_that_are_flagged():
    record = snapshots(1, 4)
    record["test_ratio"], record["whole"] = [0.2, np.nan, 3.456, 0.9], True
    record["status"][0, 1:3] = int(Status.NEVER), int(Status.MAGNETIC_ANOMALY)
    health = Health("abcd", 250.0)
    rows = dict(health.rows(record[0]))
    assert rows["test ratio"] == "3.46 at most (c); 1 is the limit"
    assert "wrench" not in rows
    assert flagged(record["status"][0], "abcd", record["test_ratio"][0]) == [
        ("b", "never"), ("c", "magnetic_anomaly, test ratio 3.46")
    ]  # fmt: skip
    assert "magnetic_anomaly, test ratio 3.46" in health.html(record[0])
    assert QUANTITIES["test ratio"].values(record[0])[2] == np.float32(3.456)


def records_of(count, step_s=0.034, n=4):
    records = snapshots(count, n)
    records["stamp_ns"] = 10**18 + np.round(1e9 * step_s * np.arange(count)).astype(np.int64)
    records["cycle"] = records["cycles"] = np.arange(count)
    return records


def test_plots_show_the_last_seconds_of_the_skin_and_of_a_unit():
    history, records = History(), records_of(1000)
    records["wrench"][:, :3] = np.outer(np.arange(1000), [0.0, 3.0, 4.0])
    records["contact_count"] = np.arange(1000) % 3
    records["force"][:, :, 2] = np.outer(np.arange(1000), [3.0, 4.0, 7.0])
    records["force_sigma"][:, 2, 2] = np.nan
    for record in records:
        history.add(record)
    time_s, force, contacts = history.skin()
    assert time_s[-1] == 0.0
    assert -20.0 < time_s[0] < -19.9
    np.testing.assert_allclose(force[-5:], 5.0 * np.arange(995, 1000))
    assert contacts[-3:].tolist() == [1.0, 2.0, 0.0]
    seen_s, normal, sigma, shear, _ = history.unit(2)
    np.testing.assert_array_equal(seen_s, time_s)
    np.testing.assert_allclose(normal[-2:], [6986.0, 6993.0])
    np.testing.assert_allclose(shear[-2:], [4990.0, 4995.0])
    assert (sigma == 0.0).all()


def test_health_names_units_and_why():
    status = np.zeros(30, np.uint16)
    status[3], status[10:] = int(Status.NEVER), int(Status.STALE | Status.UNTARED)
    names = [f"a<b>{i}" for i in range(30)]
    assert flagged(status, names)[:2] == [("a<b>3", "never"), ("a<b>10", "stale")]
    health, records = Health(names, 250.0), snapshots(60, 30)
    records["stamp_ns"] = 10**18 + 40_000_000 * np.arange(60)
    records["cycles"], records["cycle"] = 10 * np.arange(60), 10 * np.arange(60)
    records["counters"][:, COUNTERS.index("data")] = 100 * np.arange(60)
    records["counters"][:, COUNTERS.index("lost")] = 17
    records["works"], records["work_us"][:, 0] = 1, np.arange(60)
    records["status"] = status
    for record in records:
        health.add(record)
    rows = dict(health.rows(records[-1]))
    assert rows["units"] == "9 of 30 valid"
    assert rows["losses"] == "lost 17"
    assert rows["frames"] == "5900, 2500/s"
    assert rows["cycles"] == "591, 250 Hz of 250, 25 Hz shown"
    p50, p99 = np.percentile(np.arange(60), [50, 99])
    assert rows["cycle time"] == f"{p50:.0f} µs p50, {p99:.0f} µs p99"
    page = health.html(records[-1])
    assert "a&lt;b&gt;3" in page
    assert "and 9 more units" in page
