"""What messages say: slots of contacts, frames that were lost, what was not wanted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import skin
import topology
from bus.state import BusState
from skin.contact.record import CONTACT
from skin.publish import content
from skin.publish.cdr import encode
from skin.publish.snapshot import (
    BUS_STATES,
    COUNTERS,
    MOST_CONTACTS,
    contacts_of,
    fill,
    patch_poses,
    snapshot_dtype,
)
from skin.record.encode import StateEncoder
from skin.record.slot import slot_dtype


@pytest.fixture(scope="module")
def palm():
    return topology.load("palm")


@pytest.fixture(scope="module")
def state():
    with skin.open("palm", simulate="slide", pace=False) as opened:
        return next(one.copy() for one in opened if one.contacts)


@pytest.fixture
def record(palm):
    return np.zeros(1, snapshot_dtype(palm))


def contacts(*identities):
    found = np.zeros(len(identities), CONTACT)
    found["id"] = identities
    return found


def test_a_contact_keeps_its_slot_and_a_free_one_is_taken_again():
    slots = content.Slots()

    def taken(*identities):
        present, ended = slots.take(contacts(*identities))
        return {int(one["id"]): slot for slot, one in present}, ended

    assert taken(5, 9) == ({5: 0, 9: 1}, [])
    assert taken(9, 12) == ({9: 1, 12: 0}, [])  # who ended needs no zeros: its slot speaks again
    assert taken(9) == ({9: 1}, [0])
    assert taken() == ({}, [1])
    assert taken(20) == ({20: 0}, [])


def test_what_was_not_wanted_reads_nan(state, record):
    units = replace(state.units, temperature=None, force_sigma=None)
    units = replace(units, test_ratio=None)
    fill(record, replace(state, units=units, wrench=None, contacts=None, label=None, whole=None))
    told = content.state(record[0], "skin")
    assert np.isnan(told["temperature"]).all()
    assert np.isnan(told["force_sigma"]).all()
    assert np.isnan(told["test_ratio"]).all()
    assert told["whole"] is False
    np.testing.assert_array_equal(told["force"], state.units.force.reshape(-1))
    assert (told["contact"] == -1).all()
    assert told["contacts"] == []
    assert np.isnan(record["wrench"]).all()


def test_a_topic_and_a_recording_have_the_same_bytes(palm, state, record):
    slot = np.zeros(1, slot_dtype(palm))
    fill(record, state)
    assert record["valid"].all()
    for name in ("stamp_ns", "cycle", "force", "force_sigma", "temperature", "test_ratio", "status",
                 "whole"):  # fmt: skip
        slot[name] = record[name]
    slot["contact"], slot["contact_count"] = state.label, len(state.contacts)
    for at, contact in enumerate(state.contacts):
        slot["contacts"][0, at] = np.frombuffer(contact.record.tobytes(), np.uint8)
    of_topic = encode("f3t_msgs/msg/SkinState", content.state(record[0], "skin"))
    assert StateEncoder(palm.n)(slot[0]) == of_topic
    slot["contact_count"] = record["count"] = 0
    of_topic = encode("f3t_msgs/msg/SkinState", content.state(record[0], "skin"))
    assert StateEncoder(palm.n)(slot[0]) == of_topic


def test_more_contacts_than_have_room_are_left_out(state, record):
    fill(record, replace(state, contacts=state.contacts * (MOST_CONTACTS + 3)))
    assert record["count"][0] == MOST_CONTACTS + 3
    found = contacts_of(record[0])
    assert found.size == MOST_CONTACTS
    assert {one.tobytes() for one in found} == {state.contacts[0].record.tobytes()}


def test_diagnostics_tell_what_was_lost_since_the_last_ones(palm, record):
    request = {"name": "skin", "topology": "palm", "names": list(palm.unit_names), "buses": ["a"]}
    before = record.copy()
    record["counters"][0, COUNTERS.index("lost")] = 4
    record["bus_state"] = BUS_STATES.index(BusState.BUS_OFF)
    units, frames, bus = content.diagnostics(record[0], before[0], request)["status"]
    assert (units["level"], units["message"]) == (content.OK, "all units are fine")
    assert (frames["level"], frames["message"]) == (content.WARN, "lost 4")
    assert (bus["name"], bus["level"], bus["message"]) == ("skin: bus a", content.ERROR, "bus-off")
    again = content.diagnostics(record[0], record[0], request)["status"][1]
    assert (again["level"], again["message"]) == (content.OK, "no frame was lost")


def test_a_skin_without_any_unit_to_trust_is_an_error(palm, record):
    request = {"name": "skin", "topology": "palm", "names": list(palm.unit_names), "buses": []}
    record["status"] = 1
    told = content.diagnostics(record[0], None, request)["status"][0]
    assert (told["level"], told["message"]) == (2, "64 of 64 units are not to be trusted")
    assert told["values"][-1] == {"key": "further units", "value": "32"}


def test_every_patch_is_where_its_middle_unit_is():
    hand = topology.load("hand")
    for pose, patch in zip(
        patch_poses(hand, hand.position, hand.rotation), range(len(hand.patch_names)), strict=True
    ):
        units = np.flatnonzero(hand.patch == patch)
        at = np.flatnonzero((hand.position[:, units] == pose[:3, np.newaxis]).all(axis=0))
        x, y, z, w = pose[3:]
        turned = topology.pose.from_quaternion(w, x, y, z)
        np.testing.assert_allclose(turned, hand.rotation[:, :, units[at[0]]], atol=1e-12)
        away = np.linalg.norm(
            hand.position[:, units] - hand.position[:, units].mean(axis=1)[:, np.newaxis], axis=0
        )
        assert away[at[0]] == pytest.approx(away.min())
