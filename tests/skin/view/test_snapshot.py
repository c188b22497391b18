"""Snapshots: a copy of what a state says, as often as an eye follows, never in the way."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import skin
from skin.contact.record import Flag
from skin.io.messages.record import contacts_of
from skin.options import Options
from skin.pipeline import Pipeline
from skin.robot.joints import Joints
from skin.state import Status
from skin.view import snapshot
from skin.view.drawing import contact_label
from skin.view.health import Health
from skin.view.snapshot import Snapshots, snapshot_dtype
from skin.worker import RingBuffer
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


def test_contacts_and_a_wrench_that_are_not_whole_say_so():
    with skin.open("palm", simulate="press", pace=False) as palm:
        state = next(state for state in palm if state.contacts).copy()
    record = snapshots(1, palm.topology.n)
    fill(record, state)
    assert [contact_label(one).endswith("   not whole") for one in contacts_of(record[0])] == [
        False
    ]
    state.whole = False
    state.contacts[0].record["flags"] |= int(Flag.UNSEEN)
    fill(record, state)
    assert [contact_label(one).endswith("   not whole") for one in contacts_of(record[0])] == [True]
    assert "not whole" in Health(palm.topology).banner_html(record[0])


def test_there_are_30_snapshots_a_second_at_most(clock):
    shown = Shown()
    ring, counted = watched(shown, 64)
    for _ in range(250):
        clock[0] += 0.004
        shown.show()
    assert counted.taken == 30
    records = drained(ring)[1:]
    assert np.diff(records["cycles"]).tolist()[:4] == [9, 8, 8, 9]
    assert (records["work_us"] == 50.0).all()


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
    assert np.diff(records["moved"]).tolist() == [0, 0, 1, 0]
    first, moved = records["pose"][0, 0, 0], records["pose"][3, 0, 0]
    np.testing.assert_allclose(moved - first, 0.5, atol=1e-6)


def test_joints_come_with_the_poses_that_they_are_of(tmp_path, clock):
    """NaN where poses were set without joints, as a replay does."""
    gripper = load(write_gripper(tmp_path))
    pipeline, joints = Pipeline(gripper, Options(want={"temperature"})), Joints(gripper)
    ring = RingBuffer(snapshot_dtype(gripper, 16), 8)
    taken = Snapshots(ring, pipeline, None)
    assert drained(ring)["q"].tolist() == [[0.0]]
    expected = []
    for q in (0.02, np.nan, 0.03):
        if np.isnan(q):
            pipeline.move(gripper.position, gripper.rotation)
        else:
            joints.move([q])
            pipeline.move(*joints.unit_poses, joints.q)
        clock[0] += 1.0
        assert taken.look(pipeline.now)
        expected.append([q])
    np.testing.assert_array_equal(drained(ring)["q"], expected)
