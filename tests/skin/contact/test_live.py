"""Contacts of simulated skins, from frames to identities."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import skin
import topology
from bus.cycle import ClosedBy, RawCycle
from skin.contact.record import Event
from skin.options import Options
from skin.pipeline import Pipeline
from skin.sim.scenes.load import load_scene, open_scene
from skin.sim.scenes.play import ScriptedScene
from skin.sim.unit import UnitSimulator


def wrench(force, position, rotation, *, valid):
    """Sum of the wrenches of some units."""
    turned = np.einsum("ijn,jn->in", rotation, force)[:, valid]
    return np.concatenate(
        [turned.sum(axis=1), np.cross(position[:, valid].T, turned.T).sum(axis=0)]
    )


def test_contacts_of_a_stroke_are_the_truth_within_their_sigma():
    palm = topology.load("palm").exact()
    told = []
    with skin.open(palm, simulate=open_scene("demo", palm), pace=False, seed=4) as opened:
        for state in itertools.islice(opened, 1700):
            truth = opened.nodes.truth
            if state.cycle % 20 or truth.force[2].sum() < 3.0:
                continue
            (contact,) = state.contacts
            assert contact.id == 1
            assert state.label[contact.units].tolist() == [0] * contact.units.size
            assert contact.wrench == pytest.approx(state.wrench, abs=1e-9)
            off = contact.wrench[:3] - truth.wrench[:3]
            told.append(off / contact.wrench_sigma[:3])
            assert np.linalg.norm(contact.centroid - truth.centroid) < 1e-3
            assert contact.normal == pytest.approx([0, 0, 1], abs=0.1)
            assert contact.coverage == 1.0
    spread = np.sqrt(np.mean(np.square(told), axis=0))
    assert len(told) > 40
    assert (spread < 1.6).all(), spread


@pytest.mark.long
def test_balls_that_merge_and_part_keep_their_identities():
    palm = topology.load("palm").exact()
    scene = ScriptedScene(palm, load_scene("merge", palm))
    told, events = [], {}
    with skin.open(palm, simulate=scene, pace=False, want={"contacts"}, seed=1) as opened:
        for state in itertools.islice(opened, int(7.6 * palm.cycle_rate_hz)):
            contacts = {contact.id: contact.centroid[0] for contact in state.contacts}
            told.append(contacts)
            for contact in state.contacts:
                if contact.event:
                    events[state.cycle] = (contact.id, contact.event)
    both = [contacts for contacts in told if len(contacts) == 2]
    assert {frozenset(contacts) for contacts in both} == {frozenset({1, 2})}
    left = {min(contacts, key=contacts.get) for contacts in both}
    assert len(left) == 1  # the left one is the same all the time
    numbers = [len(contacts) for contacts in told if contacts]
    changes = "".join(str(count) for count, _ in itertools.groupby(numbers))
    assert changes.strip("1") == "212"  # one ball may touch first, or leave last
    merged = [event for event in events.values() if event[1] & Event.MERGED]
    parted = [event for event in events.values() if event[1] & Event.RESUMED]
    assert len(merged) == len(parted) == 1


@pytest.mark.long
def test_contacts_outlive_stamps_that_step_back_and_numbers_that_repeat():
    palm = topology.load("palm").exact()
    scene, simulator = open_scene("demo", palm), UnitSimulator(palm, seed=5)
    counts = simulator.counts(scene.at(3.0))
    read = Pipeline(palm, Options(want={"contacts"}, estimator="sine"))
    rest = (np.ones(palm.n, bool), np.zeros(palm.n, np.uint16), *(np.zeros(palm.n, int),) * 3)
    ages = []
    for number, stamp_ns in ((7, 900), (8, 1000), (8, 1000), (9, 10), (20, -5), (3, 0)):
        read.counts[:] = counts
        state = read.state(RawCycle(number, stamp_ns, ClosedBy.COMPLETE, counts, *rest))
        (contact,) = state.contacts
        assert contact.id == 1
        assert state.stamp_ns == stamp_ns
        ages.append(contact.age_s)
    # stamps that stand still are followed slowly, those that step back not at all
    assert ages[1] == pytest.approx(0.004, rel=0.1)
    assert ages[4] - ages[2] == pytest.approx(12 * 0.004)
    assert (np.diff(ages) > 0.0).all()
