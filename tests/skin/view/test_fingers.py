"""Bars of fingers, the events of the last minute, and sliders, as the panel shows them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import topology
from skin.contact.record import CONTACT, SlipState
from skin.state import Status
from skin.view.drawing import Pose, top
from skin.view.fingers import Events, Fingers
from skin.view.panel import Panel
from tests.fixtures.asked import Asked
from tests.fixtures.robots import write_gripper
from tests.fixtures.shown import Shown
from tests.naive.record import snapshots


def pressed(shown, contacts=(), time_s=0.0, **units):
    """A snapshot in which contacts (identity, units, slip, margin) press 2 N on each unit."""
    record = snapshots(1, shown.topology.n)[0]
    record["stamp_ns"], record["cycle"] = 10**18 + round(1e9 * time_s), 1
    record["contact"], record["contact_count"] = -1, len(contacts)
    for k, (identity, own, slip, margin) in enumerate(contacts):
        one = np.zeros(1, CONTACT)
        one["id"], one["slip"], one["margin_at_least"], one["friction"] = (
            identity, slip, margin, np.nan,
        )  # fmt: skip
        record["contacts"][k] = one.view("i8")
        record["contact"][own], record["force"][2, own] = k, 2.0
    for unit, flag in units.items():
        record["status"][int(unit[1:])] = int(flag)
    return record


@pytest.fixture
def shown():
    """Two patches of six units; the second one on a frame of its own, with a third patch."""
    shown = Shown(2, 6)
    turn = np.repeat(np.diag([1.0, -1.0, -1.0])[:, :, None], 12, axis=2)
    shown.poses = shown.poses[0], turn
    shown.topology = replace(
        shown.topology, patch=np.repeat([0, 1, 2], [6, 4, 2]), patch_names=("palm", "a", "b"),
        patch_frames=("skin", "tip", "tip"),
    )  # fmt: skip
    return shown


def test_a_finger_has_the_force_of_its_units_in_contact_and_the_least_margin(shown):
    record = pressed(
        shown, [(4, [1, 2], SlipState.STICK, 0.7), (5, [2, 6, 11], SlipState.GROSS, -0.2)],
        u6=Status.STALE,
    )  # fmt: skip
    record["force"][2, 9] = 3.0  # touched by nothing that counts
    fingers = Fingers(shown.topology)
    (palm, force_n, on_palm), (tip, tip_n, on_tip) = fingers.forces(record, Pose(*shown.poses))
    assert (palm, force_n, on_palm["id"].tolist()) == ("palm", pytest.approx(4.0), [4, 5])
    assert (tip, tip_n, on_tip["id"].tolist()) == ("tip", pytest.approx(2.0), [5])
    page = fingers.html(record, Pose(*shown.poses), 8.0)
    assert "4.00 N gross margin ≥ -20 %" in page
    assert "width:50%" in page
    assert "width:25%" in page


def test_events_are_contacts_slips_and_faults_of_the_last_minute(shown):
    events, one = Events(shown.topology), (7, [1], SlipState.STICK, 0.5)
    for record in (
        pressed(shown), pressed(shown, [one], 1.0),
        pressed(shown, [(7, [1], SlipState.INCIPIENT, 0.1)], 2.0),
        pressed(shown, [(7, [1], SlipState.INCIPIENT, 0.1)], 3.0, u3=Status.STALE),
        pressed(shown, [], 4.0),
    ):  # fmt: skip
        events.add(record)
    page = events.html(10**18 + 4 * 10**9)
    told = ["1 units valid again", "contact 7 ends", "u3: stale", "contact 7: incipient slip",
            "contact 7 begins, 0.00 N"]  # fmt: skip
    places = [page.index(text) for text in told]
    assert sorted(places[2:]) == places[2:]
    assert "3 s ago" in page
    events.add(pressed(shown, [], 62.5))
    page = events.html(10**18 + 62 * 10**9)
    assert "incipient" not in page
    assert "contact 7 ends" in page


def test_the_top_is_the_face_of_the_largest_patch(shown):
    middle, outward, _ = top(Pose(*shown.poses), shown.topology.patch)
    np.testing.assert_allclose(middle, shown.poses[0][:, :6].mean(axis=1))
    np.testing.assert_allclose(outward, [0.0, 0.0, 1.0])


def test_sliders_ask_for_joints_and_follow_those_that_others_move(tmp_path):
    gripper, asked = topology.load(write_gripper(tmp_path)), Asked()
    panel = Panel(asked, gripper, is_live=True)
    (slider,) = (one for one in asked.gui.all if one.kind == "add_slider")
    assert slider.given[:3] == ("close", 0.0, 0.05)
    slider.value = 0.02
    slider.clicked(SimpleNamespace(client=None))
    assert panel.requests.empty()
    panel.follow(np.array([0.03]))
    assert slider.value == 0.03
    slider.clicked(SimpleNamespace(client="a browser"))
    assert panel.requests.get() == ("joints", [0.03])
    panel.follow(np.array([0.01]))  # not against the hand that has just moved it
    assert slider.value == 0.03
    assert not [one for one in asked.gui.all if one.kind == "add_slider" and one is not slider]
