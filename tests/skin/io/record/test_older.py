"""Recordings with the messages of other versions: they are replayed, and compared in what both say.

They are written by the libraries of others, from definitions written down by hand.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import skin
import topology
from bus.faults import FaultScript, FaultyTransport
from bus.faults import script as kinds
from skin.io.messages.definitions import STATE_VERSION
from skin.io.messages.topics import STATE
from skin.sim.attached import in_process
from skin.sim.node import SimulatedUnits
from skin.sim.scenes.load import open_scene

reading = pytest.importorskip("mcap.reader", reason="mcap is not installed")
typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")

KIND, CONTACT = "f3t_msgs/msg/SkinState", "f3t_msgs/msg/Contact"
CYCLES = 300
FIRST_CONTACT = """int64 id
geometry_msgs/Wrench wrench
float64[6] wrench_sigma
geometry_msgs/Point centroid
geometry_msgs/Vector3 normal
uint8 slip
float32 stick_ratio
float32 friction
float32 friction_sigma
float32 margin
float32 slip_probability
float32 grip_force
float32 grip_force_sigma
uint16 units"""
SECOND_CONTACT = FIRST_CONTACT + "\nbool whole"
FIRST_STATE = """std_msgs/Header header    # stamp of the SYNC
uint64 cycle
float32[] force
float32[] force_sigma
float32[] temperature
uint16[] status
int32[] contact
f3t_msgs/Contact[] contacts"""
SECOND_STATE = """std_msgs/Header header
uint8 version
uint64 cycle
float32[] force
float32[] force_sigma
float32[] temperature
float32[] test_ratio
uint16[] status
int32[] contact
bool whole
f3t_msgs/Contact[] contacts"""
LATER = FIRST_STATE.replace("f3t_msgs/Contact[]", "float32[] charge\nf3t_msgs/Contact[]")
PART = "\n" + "=" * 80 + "\nMSG: "
GEOMETRY = """
================================================================================
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A recording with contacts."""
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    with skin.open("strip", simulate=True, pace=False, record=file) as strip:
        assert any([bool(state.contacts) for state in itertools.islice(strip, CYCLES)])
    return file


def store_of(state, contact):
    """The messages of ROS, and these two."""
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg(contact, CONTACT))
    store.register(typesys.get_types_from_msg(state, KIND))
    return store


def rewritten(run, file, state, contact, spoil=lambda values: values):
    """The recording with states of other definitions."""
    from mcap.writer import Writer

    with run.open("rb") as given, file.open("wb") as made:
        reader, writer = reading.make_reader(given), Writer(made)
        writer.start("ros2", "another")
        for one in reader.iter_attachments():
            writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
        channels, stores = {}, None
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            data, text = message.data, schema.data
            if channel.topic == STATE:
                if stores is None:
                    own, *parts = text.decode().split(PART)
                    ours = next(one for one in parts if one.startswith("f3t_msgs/Contact\n"))
                    stores = store_of(own, ours.partition("\n")[2]), store_of(state, contact)
                data = old(stores, data, spoil)
                text = f"{state}{PART}f3t_msgs/Contact\n{contact}{GEOMETRY}".encode()
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, text)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(channels[channel.topic], message.log_time, data,
                               message.publish_time, message.sequence)  # fmt: skip
        writer.finish()


def old(stores, data, spoil):
    """A state by other definitions."""
    new, other = stores
    told = new.deserialize_cdr(data, KIND)

    def as_other(one, kind, **more):
        names = [name for name, _ in other.fielddefs[kind][1]]
        return other.types[kind](**({n: getattr(one, n, None) for n in names} | more))

    bounds = dict.fromkeys(("friction", "margin", "grip_force"), float("nan"))  # before version 5
    contacts = [
        as_other(one, CONTACT, **({} if one.friction_known else bounds)) for one in told.contacts
    ]
    given = {"contacts": contacts}
    if any(name == "charge" for name, _ in other.fielddefs[KIND][1]):
        given["charge"] = told.temperature
    return bytes(other.serialize_cdr(spoil(as_other(told, KIND, **given)), KIND))


@pytest.mark.parametrize("contact", [FIRST_CONTACT, SECOND_CONTACT])
def test_recordings_of_the_first_version_are_replayed_to_the_bit(run, contact, tmp_path):
    file = tmp_path / "old.mcap"
    rewritten(run, file, FIRST_STATE, contact)
    replayed = skin.replay(file)
    states = list(replayed)
    assert replayed.faults == []
    assert replayed.same == replayed.count == len(states) > 0
    assert any(state.contacts for state in states)


def test_a_state_of_the_first_version_that_differs_is_reported(run, tmp_path):
    file, count = tmp_path / "old.mcap", itertools.count()

    def spoil(message):
        if next(count) == 7:
            message.temperature = message.temperature + np.float32(0.001)
        return message

    rewritten(run, file, FIRST_STATE, FIRST_CONTACT, spoil)
    replayed = skin.replay(file)
    total = len(list(replayed))
    assert replayed.faults == [f"{file}: must give the states of the run; got 1 of {total} that "
                               "differ"]  # fmt: skip


@pytest.fixture(scope="module")
def with_silent_unit(tmp_path_factory):
    """A recording in which a unit falls silent, and its states."""
    file = tmp_path_factory.mktemp("silent") / "run.mcap"
    loaded = topology.load("strip")
    nodes = SimulatedUnits(loaded, open_scene("press", loaded, seed=2), seed=2)
    script = FaultScript(faults=(kinds.Kill(units=["strip/r0c1"], from_s=0.5, to_s=0.8),), seed=2)
    ends = [FaultyTransport(end, script, topology=loaded) for end in in_process(nodes)]
    with skin.open(loaded, transports=ends, deadline_s=0.001, pace=False, record=file) as strip:
        states = list(itertools.islice(strip, CYCLES))
    nodes.close()
    return file, states


def as_second(states, changed=None):
    """What makes states of the second version: numbers in the sigma of invalid units."""
    of, count = {state.cycle: state for state in states}, itertools.count()

    def spoil(message):
        message.version = 2
        message.force_sigma = of[message.cycle].units.force_sigma.reshape(-1).copy()
        if next(count) == changed:
            message.force_sigma[1] += np.float32(0.5)
        return message

    return spoil


def test_recordings_of_the_third_version_are_replayed_to_the_bit(run, tmp_path):
    """A contact had less then, in another order."""

    def third(message):
        message.version = 3
        return message

    file = tmp_path / "old.mcap"
    rewritten(run, file, SECOND_STATE, SECOND_CONTACT, third)
    replayed = skin.replay(file)
    assert any(state.contacts for state in replayed)
    assert replayed.faults == []
    assert replayed.same == replayed.count


@pytest.mark.parametrize("changed", [None, 150])
def test_recordings_of_the_second_version_are_replayed_to_the_bit(
    with_silent_unit, tmp_path, changed
):
    """A sigma of an invalid unit was a number then, and is compared as such."""
    run, states = with_silent_unit
    silent = [s for s in states if not s.units.valid[1] and np.isfinite(s.units.force_sigma[0, 1])]
    assert len(silent) > 30
    assert not states[150].units.valid[1]
    file = tmp_path / "old.mcap"
    rewritten(run, file, SECOND_STATE, SECOND_CONTACT, as_second(states, changed))
    replayed = skin.replay(file)
    total = len(list(replayed))
    assert total == len(states)
    if changed is None:
        assert replayed.faults == []
        assert replayed.same == total
    else:
        assert replayed.same == total - 1


def test_states_of_a_later_meaning_are_played_and_not_compared(run, tmp_path):
    def spoil(message):
        message.version = STATE_VERSION + 1
        return message

    file = tmp_path / "later.mcap"
    rewritten(run, file, SECOND_STATE, SECOND_CONTACT, spoil)
    replayed = skin.replay(file)
    assert any(state.contacts for state in replayed)
    assert replayed.faults == [f"{file}: /skin/state: must have fields that this version knows; "
                               f"got version {STATE_VERSION + 1}: states were not "
                               "compared"]  # fmt: skip


def test_states_of_a_later_version_are_played_and_not_compared(run, tmp_path):
    file = tmp_path / "later.mcap"
    rewritten(run, file, LATER, FIRST_CONTACT)
    replayed = skin.replay(file)
    assert any(state.contacts for state in replayed)
    assert replayed.faults == [f"{file}: /skin/state: must have fields that this version knows; "
                               "got charge: states were not compared"]  # fmt: skip
