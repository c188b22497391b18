"""What other people's readers make of a recording: the same counts, stamps and values."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest

import skin
from bus.frame import FRAME_DTYPE
from skin.contact.record import Event
from skin.state import INVALID

matplotlib = pytest.importorskip("matplotlib", reason="matplotlib is not installed")
reading = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")
CYCLES = 300


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """States of a run with contacts, and its recording."""
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    with skin.open("strip", simulate=True, pace=False, record=file) as strip:
        live = [state.copy() for state in itertools.islice(strip, CYCLES)]
        topology = strip.topology
    assert any(state.contacts for state in live)
    return topology, live, file


@pytest.fixture(scope="module")
def decoded(run):
    """Messages by topic, as the reference library decodes them."""
    found = {}
    for message in reading.read_ros2_messages(str(run[2])):
        found.setdefault(message.channel.topic, []).append(message)
    return found


def stamp(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


@pytest.mark.long
def test_every_state_is_there_with_its_stamp(run, decoded):
    live = run[1]
    found = decoded["/skin/state"]
    assert [one.ros_msg.cycle for one in found] == [state.cycle for state in live]
    assert [stamp(one.ros_msg) for one in found] == [state.stamp_ns for state in live]
    assert [one.log_time_ns for one in found] == [state.stamp_ns for state in live]


def test_states_have_the_values_of_the_live_ones_and_nan_where_invalid(run, decoded):
    topology, live, _ = run
    n = topology.n
    for one, state in zip(decoded["/skin/state"], live, strict=True):
        message, units = one.ros_msg, state.units
        wrong = units.status & int(INVALID) != 0
        force = np.where(wrong, np.nan, units.force)
        np.testing.assert_array_equal(np.reshape(message.force, (3, n)), force)
        sigma = np.where(wrong, np.nan, units.force_sigma)
        np.testing.assert_array_equal(np.reshape(message.force_sigma, (3, n)), sigma)
        warm = np.where(wrong, np.nan, units.temperature)
        np.testing.assert_array_equal(message.temperature, warm)
        np.testing.assert_array_equal(message.test_ratio, units.test_ratio)
        assert np.isfinite(message.test_ratio).all()
        assert message.whole == state.whole
        np.testing.assert_array_equal(message.status, units.status)
        np.testing.assert_array_equal(message.contact, state.label)


def test_contacts_have_the_values_of_the_live_ones(run, decoded):
    for one, state in zip(decoded["/skin/state"], run[1], strict=True):
        found = one.ros_msg.contacts
        assert [c.id for c in found] == [c.id for c in state.contacts]
        for contact, true in zip(found, state.contacts, strict=True):
            wrench = contact.wrench
            six = [getattr(part, axis) for part in (wrench.force, wrench.torque) for axis in "xyz"]
            assert six == true.wrench.tolist()
            assert list(contact.wrench_sigma) == true.wrench_sigma.tolist()
            for name in ("centroid", "normal"):
                three = [getattr(getattr(contact, name), axis) for axis in "xyz"]
                np.testing.assert_array_equal(three, getattr(true, name))
            assert (contact.slip, contact.units) == (true.slip, true.units.size)
            assert (contact.whole, contact.parent) == (true.whole, true.parent)
            events = [one for one in Event if getattr(contact, one.name.lower(), False)]
            assert sum(events) == true.event
            assert contact.slip_began == (true.onset_s == 0.0)
            for name in ("load", "area", "shear", "torsion", "travel", "temperature",
                         "hot_temperature", "stick_ratio", "friction", "friction_sigma", "margin",
                         "slip_probability", "grip_force", "grip_force_sigma"):  # fmt: skip
                np.testing.assert_equal(
                    np.float32(getattr(contact, name)), np.float32(getattr(true, name))
                )


def test_wrenches_are_stamped_and_in_the_skin_frame(run, decoded):
    live = run[1]
    for one, state in zip(decoded["/skin/wrench"], live, strict=True):
        message = one.ros_msg
        assert (message.header.frame_id, stamp(message)) == ("skin", state.stamp_ns)
        parts = message.wrench.force, message.wrench.torque
        six = [getattr(part, axis) for part in parts for axis in "xyz"]
        assert six == state.wrench.tolist()
    of_contacts = {topic: one for topic, one in decoded.items() if "/skin/contact/" in topic}
    told = Counter(
        m.log_time_ns
        for messages in of_contacts.values()
        for m in messages
        if m.ros_msg.wrench.force.z != 0.0  # zeros once it has ended
    )
    assert told == Counter(s.stamp_ns for s in live for _ in s.contacts)


def test_all_frames_are_there_and_none_else(run, decoded):
    last = run[1][-1].counters
    frames = np.concatenate([
        np.frombuffer(bytes(one.ros_msg.frames), FRAME_DTYPE) for one in decoded["/skin/frames"]
    ])  # fmt: skip
    assert len(frames) == last.data + last.sync + last.heartbeat
    syncs = frames[frames["id"] == run[0].sync_id]
    assert syncs["data"][:, 0].tolist() == [i & 0xFF for i in range(CYCLES)]


def test_layout_patches_and_health_are_there(run, decoded):
    topology = run[0]
    (layout,) = decoded["/skin/layout"]
    message = layout.ros_msg
    assert (tuple(message.names), tuple(message.patches)) == (
        topology.unit_names, topology.patch_names
    )  # fmt: skip
    np.testing.assert_array_equal(message.position, topology.position.ravel())
    np.testing.assert_array_equal(message.rotation, topology.rotation.ravel())
    frames = decoded["/tf"][0].ros_msg.transforms
    children = [f"skin/{name}" for name in topology.patch_names]
    assert [one.child_frame_id for one in frames] == children
    assert {one.header.frame_id for one in frames} == {"skin"}
    health = {one.name: one for one in decoded["/diagnostics"][-1].ros_msg.status}
    assert health["skin: units"].message == f"0 of {topology.n} units not valid"
    assert health[f"skin: bus {topology.buses[0].name}"].message == "error-active"
    assert health["skin: recording"].message == "nothing left out"


def points_of(message):
    """A cloud, field by field, as the definition of PointCloud2 says."""
    kinds = {6: "<u4", 7: "<f4"}
    assert (message.height, message.is_bigendian) == (1, False)
    assert message.row_step == message.width * message.point_step == len(message.data)
    raw = np.frombuffer(bytes(message.data), np.uint8).reshape(message.width, message.point_step)
    found = {}
    for field in message.fields:
        size = np.dtype(kinds[field.datatype]).itemsize
        part = np.ascontiguousarray(raw[:, field.offset : field.offset + size])
        found[field.name] = part.view(kinds[field.datatype])[:, 0]
    return found


def test_clouds_show_every_unit_by_load_and_every_contact_by_its_force(run, decoded):
    topology, live, _ = run
    units, forces = decoded["/skin/points"], decoded["/skin/forces"]
    assert len(units) == len(forces) > 10
    assert {one.ros_msg.header.frame_id for one in units + forces} == {"skin"}
    by_stamp, pressed = {state.stamp_ns: state for state in live}, 0
    for cloud, rows in zip(units, forces, strict=True):
        state = by_stamp[stamp(cloud.ros_msg)]
        points = points_of(cloud.ros_msg)
        np.testing.assert_array_equal(
            np.stack([points[axis] for axis in "xyz"]), topology.position.astype(np.float32)
        )
        np.testing.assert_array_equal(points["load"], state.units.force[2].astype(np.float32))
        np.testing.assert_array_equal(points["colors"], points["rgb"] << 8 | 0xFF)
        reference = matplotlib.colormaps["cividis"](state.units.force[2] / 6.0, bytes=True)
        red_green_blue = points["rgb"][:, np.newaxis] >> np.array([16, 8, 0]) & 0xFF
        np.testing.assert_allclose(red_green_blue, reference[:, :3], atol=4)
        points = points_of(rows.ros_msg)
        at = np.stack([points[axis] for axis in "xyz"], axis=1)
        for contact, row in zip(
            state.contacts, np.split(at, len(state.contacts)) if len(at) else [], strict=True
        ):
            begin = contact.centroid
            if np.isnan(begin).any():
                begin = topology.position[:, contact.units].mean(axis=1)
            np.testing.assert_allclose(row[0], begin, atol=1e-7)
            tip = begin + 0.005 * contact.wrench[:3]  # 1 N is 5 mm
            np.testing.assert_allclose(row[-1], tip, atol=1e-7)
            pressed += 1
    assert pressed


def test_the_file_says_what_it_is(run):
    from mcap.reader import make_reader

    with run[2].open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert {one.encoding for one in summary.schemas.values()} == {"ros2msg"}
        assert {one.message_encoding for one in summary.channels.values()} == {"cdr"}
        attached = {one.name for one in reader.iter_attachments()}
    assert attached == {"run.json", "topology.npz"}
