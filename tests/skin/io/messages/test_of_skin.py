"""One run, recorded and published: the same bytes of every message, and what they say, as rosbags
reads it."""

from __future__ import annotations

import dataclasses
import itertools
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

import skin
import topology
from bus.faults import FaultScript, FaultyTransport
from bus.faults import script as kinds
from bus.state import BusState
from skin import sinks
from skin.contact.record import CONTACT
from skin.io import publish
from skin.io.messages.definitions import MESSAGES
from skin.io.messages.of_skin import SkinMessages
from skin.io.messages.record import (
    BUS_STATES,
    COUNTERS,
    contacts_of,
    described,
    record_dtype,
)
from skin.io.publish import process
from skin.sim.node import SimulatedUnits
from skin.sim.scenes.load import open_scene
from skin.state import Status
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import over
from tests.naive.record import fill

reading = pytest.importorskip("mcap.reader", reason="mcap is not installed")
typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")

CYCLES, MOVED = 500, (200, 350)
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A turn about z."""
OFF, KILLED = 2, "strip/r0c1"
SAME = ("/skin/state", "/skin/wrench", "/skin/contact/0", "/skin/poses",
        "/skin/points", "/skin/forces", "/tf", "/diagnostics")  # fmt: skip


class Heard:
    """In place of a participant of DDS: what its writers send."""

    def __init__(self, *_):
        self.messages = defaultdict(list)

    def writer(self, topic, message, **_):
        class Writer:
            write = staticmethod(self.messages[f"/{topic}"].append)

        return Writer()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with a unit that is disabled, one that falls silent under load, and patches that move:
    its skin, states, messages recorded and published by topic."""
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    loaded = topology.load("strip")
    loaded = dataclasses.replace(loaded, enabled=np.arange(loaded.n) != OFF)
    nodes = SimulatedUnits(loaded, open_scene("slide", loaded, seed=5), seed=5)
    script = FaultScript(faults=(kinds.Kill(units=[KILLED], from_s=1.2, to_s=1.6),), seed=5)
    ends = [FaultyTransport(end, script, topology=loaded) for end in nodes.in_process()]
    patch = pytest.MonkeyPatch()
    patch.setattr(process, "Participant", Heard)
    patch.setattr(publish, "require", lambda *_: None)
    states = []
    with over(loaded, ends, record=file, deadline_s=0.001, pace=False) as strip:
        patch.setattr(sinks, "Worker", InProcess)
        node = publish.ros(strip, rate_hz=None)
        for state in itertools.islice(strip, CYCLES):
            states.append(state)
            if len(states) in MOVED:
                strip.move_patch(loaded.patch_names[0], QUARTER, [0.0, 0.0, 0.001 * len(states)])
        published = node._worker.publishing.participant.messages
    nodes.close()
    patch.undo()
    recorded = defaultdict(list)
    with file.open("rb") as opened:
        for _, channel, message in reading.make_reader(opened).iter_messages(log_time_order=False):
            recorded[channel.topic].append(message.data)
    return loaded, states, recorded, published


class InProcess:
    """In place of the process that publishes: as it does, when it is told of a record."""

    status = None

    def __init__(self, _, ring, request, niceness):
        self.publishing = process.Publishing(request)
        publish = ring.publish

        def at_once():
            publish()
            self.publishing.take(ring.unread()[:1])
            ring.release(1)

        ring.publish = at_once

    def ask(self, _):
        return {"sent": 0}

    def close(self):
        pass


@pytest.fixture(scope="module")
def store():
    known = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for name, text in MESSAGES.items():
        known.register(typesys.get_types_from_msg(text, name))
    return known


def without_names(data, store):
    """Diagnostics without their last entry, which is of the recording, or of the publishing."""
    message = store.deserialize_cdr(data, "diagnostic_msgs/msg/DiagnosticArray")
    return repr(message.header), repr(message.status[:-1])


@long_after_first("topic", SAME)
def test_a_topic_and_a_recording_have_the_same_messages(run, store, topic):
    _, states, recorded, published = run
    one, other = recorded[topic], published[topic]
    if topic == "/skin/poses":
        assert len(one) == len(MOVED)
    else:
        assert one
    if topic == "/diagnostics":
        one, other = ([without_names(data, store) for data in found] for found in (one, other))
    if topic in ("/skin/state", "/skin/wrench"):
        assert len(one) == len(states)
    assert len(one) == len(other)
    if topic == "/tf":  # the first ones have the times of the layouts
        one, other = one[1:], other[1:]
    if topic == "/skin/poses":  # a topic has them with the next state
        one, other = ([data[12:] for data in found] for found in (one, other))
    assert one == other


def test_frames_of_patches_follow_the_units(run, store):
    loaded, _, recorded, _ = run
    first, last = (
        store.deserialize_cdr(recorded["/tf"][at], "tf2_msgs/msg/TFMessage").transforms[0].transform
        for at in (0, -1)
    )
    x, y, z = (getattr(first.translation, axis) for axis in "xyz")
    assert [x, y, z] in loaded.position.T.tolist()
    place = [getattr(last.translation, axis) for axis in "xyz"]
    np.testing.assert_allclose(place, [-y, x, z + 0.001 * max(MOVED)], atol=1e-12)
    i, j, k, w = (getattr(last.rotation, axis) for axis in "xyzw")
    turned = topology.pose.from_quaternion(w, i, j, k)
    np.testing.assert_allclose(turned, QUARTER @ loaded.rotation[:, :, 0], atol=1e-12)


def test_layouts_differ_in_their_time_alone(run):
    _, _, recorded, published = run
    (one,), (other,) = recorded["/skin/layout"], published["/skin/layout"]
    assert one[12:] == other[12:]


def test_invalid_units_read_nan_also_in_their_sigma(run, store):
    loaded, states, recorded, _ = run
    silent = loaded.unit_names.index(KILLED)
    numbers = 0
    for data, state in zip(recorded["/skin/state"], states, strict=True):
        told = store.deserialize_cdr(data, "f3t_msgs/msg/SkinState")
        units, n = state.units, loaded.n
        for name in ("force", "force_sigma", "temperature"):
            expected = np.where(units.valid, getattr(units, name), np.nan)
            np.testing.assert_array_equal(np.reshape(getattr(told, name), expected.shape), expected)
        np.testing.assert_array_equal(told.status, units.status)
        assert (told.cycle, told.whole) == (state.cycle, state.whole)
        assert [one.id for one in told.contacts] == [one.id for one in state.contacts]
        assert np.isnan(np.reshape(told.force_sigma, (3, n))[:, OFF]).all()
        numbers += np.isfinite(units.force_sigma[:, silent]).all() and not units.valid[silent]
    assert numbers > 50, "of an invalid unit no sigma had to be left out"
    assert any(state.contacts for state in states)


def test_diagnostics_leave_disabled_units_out(run, store):
    loaded, states, recorded, published = run
    silent = {s.stamp_ns for s in states if not s.units.valid[loaded.unit_names.index(KILLED)]}
    counts = set()
    for data in recorded["/diagnostics"] + published["/diagnostics"]:
        message = store.deserialize_cdr(data, "diagnostic_msgs/msg/DiagnosticArray")
        stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        units = message.status[0]
        named = [one.key for one in units.values]
        assert named == ([KILLED] if stamp_ns in silent else [])
        assert units.message == f"{len(named)} of {loaded.n - 1} units not valid"
        assert units.level == (1 if named else 0)
        counts.add(len(named))
    assert 0 in counts


@pytest.fixture(scope="module")
def palm():
    return topology.load("palm")


@pytest.fixture(scope="module")
def state():
    with skin.open("palm", simulate="slide", pace=False) as opened:
        return next(one.copy() for one in opened if one.contacts)


@pytest.fixture
def record(palm):
    return np.zeros(1, record_dtype(palm, 16))


def test_a_contact_keeps_its_slot_ends_at_zero_and_leaves_its_place_free(palm, store):
    messages = SkinMessages(described(palm), "recording")
    made = np.zeros(1, record_dtype(palm, 16))

    def told(*identities):
        found = np.zeros(len(identities), CONTACT)
        found["id"] = identities
        found["wrench"][:, 0] = identities
        made["contact_count"] = len(identities)
        rows = found.view(np.int64).reshape(len(identities), CONTACT.itemsize // 8)
        made["contacts"][0, : len(identities)] = rows
        kind = "geometry_msgs/msg/WrenchStamped"
        return {
            int(topic.rpartition("/")[2]): store.deserialize_cdr(data, kind).wrench.force.x
            for topic, data in messages.of_state(made[0])
            if topic.startswith("/skin/contact/")
        }

    assert told(5, 9) == {0: 5.0, 1: 9.0}
    assert told(9, 12) == {1: 9.0, 0: 12.0}  # who ended needs no zeros: its slot speaks again
    assert told(9) == {1: 9.0, 0: 0.0}
    assert told() == {1: 0.0}
    assert told(20) == {0: 20.0}


def test_what_was_not_wanted_reads_nan(state, record, store):
    units = replace(state.units, temperature=None, force_sigma=None)
    units = replace(units, test_ratio=None)
    fill(record, replace(state, units=units, wrench=None, contacts=None, label=None, whole=None))
    (topic, data), *others = SkinMessages(described(topology.load("palm")), "a").of_state(record[0])
    told = store.deserialize_cdr(data, "f3t_msgs/msg/SkinState")
    assert topic == "/skin/state"
    assert np.isnan(told.temperature).all()
    assert np.isnan(told.force_sigma).all()
    assert np.isnan(told.test_ratio).all()
    assert told.whole is False
    np.testing.assert_array_equal(told.force, state.units.force.reshape(-1))
    assert (told.contact == -1).all()
    assert len(told.contacts) == 0
    assert "/skin/wrench" not in dict(others)


def test_contacts_beyond_the_capacity_are_a_warning(record, palm, store):
    diagnostics = SkinMessages(described(palm), "recording").diagnostics
    for untracked, level, text in (
        (0, 0, "all have an identity"), (3, 1, "3 beyond the capacity have no identity")
    ):  # fmt: skip
        record["untracked"] = untracked
        found = status_of(diagnostics.message(record[0]), store)
        (entry,) = (one for one in found if one.name == "skin: contacts")
        assert (entry.level, entry.message) == (level, text)


def status_of(data, store):
    return store.deserialize_cdr(data, "diagnostic_msgs/msg/DiagnosticArray").status


def test_diagnostics_tell_what_was_lost_since_the_last_ones(palm, record, store):
    told = SkinMessages(described(palm), "publishing", name="left").diagnostics
    record["counters"][0, COUNTERS.index("lost")] = 1
    record["overruns"], record["lost_cycles"], record["bus_lost"] = 2, 3, 7
    record["bus_states"] = BUS_STATES.index(BusState.WARNING)
    units, frames, bus, _, left_out = status_of(told.message(record[0]), store)
    assert (units.level, units.message) == (0, "0 of 64 units not valid")
    assert (frames.level, frames.message) == (1, "1 lost, 2 overruns since the last message")
    assert (bus.level, bus.message) == (1, "error-warning, 7 frames lost on this host")
    assert (left_out.name, left_out.level) == ("left: publishing", 1)
    assert left_out.message == "3 cycles and 0 frames left out"
    record["bus_states"] = BUS_STATES.index(BusState.BUS_OFF)
    record["lost_cycles"] = 0
    _, frames, bus, _, left_out = status_of(told.message(record[0]), store)
    assert (frames.level, frames.message) == (0, "all frames taken")
    assert (bus.name, bus.level, bus.message) == ("left: bus main", 2, "bus-off")
    assert (left_out.level, left_out.message) == (0, "nothing left out")
    record["bus_states"] = -1
    assert status_of(told.message(record[0]), store)[2].level == 3


def test_a_skin_without_any_valid_unit_is_an_error(palm, record, store):
    record["status"] = int(Status.NEVER)
    told = SkinMessages(described(palm), "publishing").diagnostics
    units = status_of(told.message(record[0]), store)[0]
    assert (units.level, units.message) == (2, "64 of 64 units not valid")
    assert [one.key for one in units.values] == list(palm.unit_names)


def test_every_patch_is_where_its_middle_unit_is(store):
    hand = topology.load("hand")
    data = SkinMessages(described(hand), "publishing").transforms(0)
    frames = store.deserialize_cdr(data, "tf2_msgs/msg/TFMessage").transforms
    assert [one.child_frame_id for one in frames] == [f"skin/{name}" for name in hand.patch_names]
    for patch, one in enumerate(frames):
        units = np.flatnonzero(hand.patch == patch)
        place = [getattr(one.transform.translation, axis) for axis in "xyz"]
        at = np.flatnonzero((hand.position[:, units] == np.reshape(place, (3, 1))).all(axis=0))
        x, y, z, w = (getattr(one.transform.rotation, axis) for axis in "xyzw")
        turned = topology.pose.from_quaternion(w, x, y, z)
        np.testing.assert_allclose(turned, hand.rotation[:, :, units[at[0]]], atol=1e-12)
        away = np.linalg.norm(
            hand.position[:, units] - hand.position[:, units].mean(axis=1)[:, np.newaxis], axis=0
        )
        assert away[at[0]] == pytest.approx(away.min())


def cloud(skin, record, topic, store):
    """Message of a cloud, and its records with the fields that it declares."""
    data = dict(SkinMessages(described(skin), "recording").of_state(record[0]))[topic]
    message = store.deserialize_cdr(data, "sensor_msgs/msg/PointCloud2")
    kinds = [(one.name, {6: "<u4", 7: "<f4"}[one.datatype]) for one in message.fields]
    points = np.frombuffer(message.data.tobytes(), np.dtype(kinds))
    assert points.dtype.itemsize == message.point_step
    assert len(points) == message.width
    return message, points


def test_a_unit_that_is_not_valid_has_no_load_and_a_colour_that_no_load_has(palm, record, store):
    record["status"] = 0
    record["force"] = np.linspace(-1.0, 9.0, palm.n)
    message, points = cloud(palm, record, "/skin/points", store)
    assert message.is_dense
    of_loads = set(points["rgb"].tolist())
    record["status"][0, 7] = int(Status.STALE)
    record["force"][0, 1, 9] = np.nan
    message, points = cloud(palm, record, "/skin/points", store)
    assert not message.is_dense
    assert np.flatnonzero(np.isnan(points["load"])).tolist() == [7, 9]
    (colour,) = set(points["rgb"][[7, 9]].tolist())
    assert colour not in of_loads


def test_a_contact_without_a_known_centroid_is_shown_at_its_units(palm, state, record, store):
    fill(record, state)
    units = np.array([3, 12, 40])
    record["contact"], record["contact"][0, units] = -1, 0
    found = contacts_of(record[0])[:1].copy()
    found["centroid"] = np.nan
    record["contact_count"] = 1
    record["contacts"][0, 0] = found.view("i8")
    begin = palm.position[:, units].mean(axis=1)
    _, points = cloud(palm, record, "/skin/forces", store)
    np.testing.assert_allclose([points[axis][0] for axis in "xyz"], begin, atol=1e-7)


def test_without_contacts_the_cloud_of_forces_is_empty(palm, state, record, store):
    fill(record, replace(state, contacts=[]))
    message, points = cloud(palm, record, "/skin/forces", store)
    assert (message.width, len(points), message.is_dense) == (0, 0, True)
