"""What a person sees of states, readings, contacts and topologies: a line with what matters."""

from __future__ import annotations

import dataclasses
import re
from xml.etree import ElementTree

import numpy as np
import pytest

import skin
import topology
from bus.status import Status
from skin.notebook import UNTOUCHED, colour, map_svg
from skin.state import Reading


@pytest.fixture
def reading():
    n = 6
    force = np.zeros((3, n), np.float32)
    force[2] = [0.0, 1.5, 0.25, 0.0, np.nan, 9.0]
    status = np.zeros(n, np.uint16)
    status[4], status[5] = int(Status.NEVER), int(Status.LATE | Status.STALE)
    valid = status == 0
    return Reading(np.full(n, 24.5), force, force[0], force[0], force, status, valid)


def test_a_reading_is_a_line_that_leaves_out_what_cannot_be_trusted(reading):
    assert repr(reading) == (
        "<Reading: 6 units, 67% valid, Fz 0.00 to 1.50 N, T 24.50 to 24.50 °C; "
        "NEVER 4; LATE 5; STALE 5>"
    )


def test_of_many_units_in_trouble_their_number_is_told(reading):
    status = np.full(6, int(Status.NEVER), np.uint16)
    silent = dataclasses.replace(reading, status=status, valid=np.zeros(6, bool))
    assert repr(silent) == "<Reading: 6 units, 0% valid; NEVER 6 units>"


def test_what_is_not_wanted_is_not_told(reading):
    bare = dataclasses.replace(reading, temperature=None, force=None)
    assert repr(bare).startswith("<Reading: 6 units, 67% valid; NEVER")


def test_a_batch_tells_its_cycles(reading):
    batch = Reading(
        *(np.stack([value] * 3) for value in (
            reading.temperature, reading.force, reading.tangential, reading.theta,
            reading.displacement_mm, reading.status, reading.valid,
        ))
    )  # fmt: skip
    assert repr(batch).startswith("<Reading: 3 cycles of 6 units, 67% valid, Fz 0.00 to 1.50 N")


def test_a_state_and_its_contacts_are_a_line_each():
    with skin.open("strip", simulate=True, pace=False) as strip:
        for state in strip:
            if state.contacts and state.contacts[0].load > 1.0:
                break
        shown, contact = repr(state), repr(state.contacts[0])
        html = state._repr_html_()
    assert re.fullmatch(
        r"<State \d+: 10 units, \d touched, 1 contact, force \(\S+, \S+, \S+\) N>", shown
    )
    assert re.fullmatch(r"<Contact 1: \d units, \d\.\d\d N at \(.*\) mm.*>", contact)
    assert "\n" not in shown + contact
    assert shown.replace("<", "&lt;").replace(">", "&gt;") in html


def test_a_topology_says_what_hangs_where():
    assert repr(topology.load("palm")) == (
        "<Topology 'palm': 64 units, patch 'palm', bus 'main', 250 Hz, none calibrated, none tared>"
    )
    assert repr(topology.load("hand").exact()) == (
        "<Topology 'hand': 124 units, 6 patches, 2 buses (palm, fingers), 250 Hz, "
        "calibrated, tared>"
    )


def test_a_map_shows_each_unit_in_its_place_with_its_load_or_a_cross():
    palm = topology.load("palm")
    normal, trusted = np.zeros(palm.n), np.ones(palm.n, bool)
    normal[9], normal[17], normal[20] = 2.0, 1.0, 0.1
    normal[3], trusted[3] = 9.0, False
    touched = np.isin(np.arange(palm.n), (3, 9, 17))
    root = ElementTree.fromstring(map_svg(palm, normal, trusted, touched))
    discs = root.findall("{*}circle")
    assert len(discs) == palm.n
    fills = [disc.get("fill") for disc in discs]
    assert (fills[9], fills[17]) == (colour(1.0), colour(0.5))
    assert fills.count(UNTOUCHED) == palm.n - 2
    titles = [disc.findtext("{*}title") for disc in discs]
    assert titles[9] == f"{palm.unit_names[9]}: 2.00 N"
    assert titles[3] == f"{palm.unit_names[3]}: not valid"
    assert len(root.findall("{*}path")) == 1
    places = np.array([[float(disc.get("cx")), -float(disc.get("cy"))] for disc in discs])
    far = np.linalg.norm(places[:, np.newaxis] - places, axis=2)
    true = np.linalg.norm(palm.position.T[:, np.newaxis] - palm.position.T, axis=2)
    assert np.corrcoef(far.ravel(), true.ravel())[0, 1] > 0.999


def test_darker_is_more_also_in_grey():
    """Luminance falls evenly along the scale, so that it is read without colours."""
    rgb = [
        [int(colour(share)[k : k + 2], 16) for k in (1, 3, 5)] for share in np.linspace(0, 1, 33)
    ]
    grey = np.array(rgb) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(grey) < 0.0).all()
