"""Snapshots: a copy of what a state says, as often as an eye follows, never in the way."""

from __future__ import annotations

import numpy as np
import pytest

import skin
from skin.contact.record import Flag
from skin.state import Status
from skin.view import snapshot
from skin.view.colour import QUANTITIES
from skin.view.drawing import contact_labels
from skin.view.health import Health, flagged, plotted
from skin.view.history import History
from skin.view.snapshot import COUNTERS, Snapshots, fill, snapshot_dtype
from skin.worker import RingBuffer, described
from tests.fixtures.shown import Shown


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test sets, in seconds."""
    now = [100.0]
    monkeypatch.setattr(snapshot.time, "monotonic_ns", lambda: round(1e9 * now[0]))
    return now


def watched(shown, slots=8):
    ring = RingBuffer(snapshot_dtype(shown.topology.n), slots)
    snapshots = Snapshots(ring, shown.pipeline, shown.timing)
    shown.watch(snapshots.look)
    return ring, snapshots


def drained(ring):
    records = ring.unread().copy()
    ring.release(records.size)
    return records


def test_a_snapshot_says_what_the_state_said():
    with skin.open("palm", simulate="press", pace=False) as palm:
        record = np.zeros(1, snapshot_dtype(palm.topology.n))
        for state in palm:
            if state.contacts and state.contacts[0].load > 5.0:
                break
        fill(record, state)
        one = record[0]
        np.testing.assert_array_equal(one["force"], state.units.force)
        np.testing.assert_array_equal(one["sigma"], state.units.force_sigma[2])
        np.testing.assert_array_equal(one["temperature"], state.units.temperature)
        np.testing.assert_array_equal(one["status"], state.units.status)
        np.testing.assert_array_equal(one["test_ratio"], state.units.test_ratio)
        assert np.isfinite(one["test_ratio"]).all()
        np.testing.assert_array_equal(one["label"], state.label)
        assert one["whole"]
        np.testing.assert_array_equal(one["wrench"], state.wrench)
        assert one["cycle"] == state.cycle
        assert one["stamp_ns"] == state.stamp_ns
        assert one["counters"][COUNTERS.index("data")] == state.counters.data > 0
        assert one["contacts"] == len(state.contacts)
        for k, contact in enumerate(state.contacts):
            assert one["contact_id"][k] == contact.id
            assert one["contact_slip"][k] == contact.slip
            assert one["contact_load"][k] == pytest.approx(contact.load)
            np.testing.assert_allclose(one["contact_centroid"][k], contact.centroid, rtol=1e-6)
            np.testing.assert_allclose(one["contact_normal"][k], contact.normal, rtol=1e-6)
            np.testing.assert_allclose(one["contact_wrench"][k], contact.wrench, rtol=1e-6)
        state.whole = False
        state.contacts[0].record["flags"] |= int(Flag.UNSEEN)
        fill(record, state)
        assert not one["whole"]
        assert [text.endswith("   not whole") for text in contact_labels(one)] == [True]
        assert dict(Health(palm.topology.unit_names, 250.0).rows(one))["wrench"].startswith("not w")


def test_what_is_not_wanted_is_nan():
    with skin.open("strip", simulate=True, pace=False, want={"temperature"}) as strip:
        record = np.zeros(1, snapshot_dtype(strip.topology.n))
        fill(record, next(iter(strip)))
    for name in ("force", "sigma", "wrench", "test_ratio"):
        assert np.isnan(record[name]).all()
    assert record["whole"].all()
    assert "test ratio" not in dict(Health(strip.topology.unit_names, 250.0).rows(record[0]))
    assert np.isfinite(record["temperature"]).all()
    assert (record["label"] == -1).all()


def test_the_other_process_reads_the_same_record():
    dtype = snapshot_dtype(7)
    assert np.dtype([(name, kind, tuple(shape)) for name, kind, shape in described(dtype)]) == dtype


def test_there_are_30_snapshots_a_second_at_most(clock):
    shown = Shown()
    ring, snapshots = watched(shown, 64)
    for _ in range(250):
        clock[0] += 0.004
        shown.show()
    assert snapshots.taken == 30
    records = drained(ring)[1:]
    assert np.diff(records["cycles"]).tolist()[:4] == [9, 8, 8, 9]
    assert records["works"].sum() == records["cycles"][-1]
    assert (records["work_us"][0, :1] == 50.0).all()


def test_a_late_loop_takes_no_snapshots_in_a_row_to_catch_up(clock):
    shown = Shown()
    _, snapshots = watched(shown, 64)
    shown.show()
    clock[0] += 10.0
    for _ in range(5):
        shown.show()
        clock[0] += 0.001
    assert snapshots.taken == 2


def test_where_the_view_hangs_the_loop_goes_on_and_counts(clock):
    shown = Shown()
    _, snapshots = watched(shown, 4)
    for _ in range(10):
        clock[0] += 0.1
        shown.show()
    assert (snapshots.taken, snapshots.missed) == (3, 7)  # one slot has the poses


def test_before_the_first_cycle_units_stand_there_unheard():
    shown = Shown()
    first = drained(watched(shown)[0])[0]
    assert (first["status"] == Status.NEVER).all()
    np.testing.assert_allclose(first["position"], shown.poses[0], rtol=1e-6)


def test_poses_come_when_they_change(clock):
    shown = Shown()
    ring, _ = watched(shown)
    history = History(ring.dtype, 100)
    for move in (0.0, 0.0, 0.5, 0.0):
        if move:
            shown.poses = shown.poses[0] + move, shown.poses[1]
        clock[0] += 0.1
        shown.show()
        for record in drained(ring):
            history.add(record)
    x = [history[i].pose.position[0, 0] - history[0].pose.position[0, 0] for i in range(5)]
    np.testing.assert_allclose(x, [0.0, 0.0, 0.0, 0.5, 0.5], atol=1e-6)
    assert history[1].pose is history[2].pose


def test_health_has_the_test_ratio_of_the_worst_unit_and_of_those_that_are_flagged():
    record = np.zeros(1, snapshot_dtype(4))
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
    records = np.zeros(count, snapshot_dtype(n))
    records["stamp_ns"] = 10**18 + np.round(1e9 * step_s * np.arange(count)).astype(np.int64)
    records["cycle"] = records["cycles"] = np.arange(count)
    return records


def test_the_history_keeps_the_newest_in_their_order():
    history = History(snapshot_dtype(4), 7)
    for i, record in enumerate(records_of(20)):
        history.add(record)
        kept = list(range(max(0, i - 6), i + 1))
        assert [int(history[k].record["cycle"]) for k in range(len(history))] == kept
        assert history.values("cycle").tolist() == kept
        assert history.values("cycle", 3).tolist() == kept[-3:]
        assert history[-1].record["cycle"] == i
    with pytest.raises(IndexError):
        history[7]


def test_going_back_in_time_finds_the_snapshot_of_then():
    history = History(snapshot_dtype(4), 60)
    for record in records_of(100, 0.1):
        history.add(record)
    for back_s, cycle in ((0.0, 99), (1.0, 89), (1.04, 89), (5.9, 40), (60.0, 40)):
        assert history.back(back_s).record["cycle"] == cycle
    stretch = history.stretch(history.back(2.0), 1.0)
    assert [int(one.record["cycle"]) for one in stretch] == list(range(69, 80))
    assert history.span_s == pytest.approx(5.9)


def test_plots_show_force_and_contacts_of_the_last_seconds():
    history, records = History(snapshot_dtype(4), 1800), records_of(1000)
    records["wrench"][:, :3] = np.outer(np.arange(1000), [0.0, 3.0, 4.0])
    records["contacts"] = np.arange(1000) % 3
    for record in records:
        history.add(record)
    time_s, force, contacts = plotted(history, 10.0)
    assert time_s[-1] == 0.0
    assert -10.0 < time_s[0] < -9.9
    np.testing.assert_allclose(force[-5:], 5.0 * np.arange(995, 1000))
    assert contacts[-3:].tolist() == [1.0, 2.0, 0.0]


def test_health_names_units_and_why():
    status = np.zeros(30, np.uint16)
    status[3], status[10:] = int(Status.NEVER), int(Status.STALE | Status.UNTARED)
    names = [f"a<b>{i}" for i in range(30)]
    assert flagged(status, names)[:2] == [("a<b>3", "never"), ("a<b>10", "stale")]
    health, records = Health(names, 250.0), np.zeros(60, snapshot_dtype(30))
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
