"""What a person looks at more closely: a unit, a contact over time, the map of a patch."""

from __future__ import annotations

import numpy as np
import pytest

from skin.contact.record import CONTACT, SlipState
from skin.state import Status
from skin.view.colour import INVALID_COLOUR, OFF_COLOUR, colours
from skin.view.history import History, Moment, Pose
from skin.view.inspection import LARGEST, NONE, ContactFolder, MapFolder, UnitFolder, known
from skin.view.layout import described_layout, layout_of
from skin.view.patch_map import PatchMap, flattened
from skin.view.scene import BACKGROUND, CHOSEN_COLOUR, RIM_COLOUR, Scales
from tests.fixtures.asked import Api
from tests.fixtures.shown import Shown
from tests.naive.record import fill, snapshots
from topology import load

N = 6


def history_of(contacts_at, n=N, step_s=0.1, **of_state):
    """Snapshots, each with contacts: pairs of identity and load."""
    history, skin = History(snapshots(1, n).dtype, 1000), Shown(2, n // 2)
    for k, contacts in enumerate(contacts_at):
        record = snapshots(1, n)
        given = [skin.contact(0, load, SlipState.STICK, number) for number, load in contacts]
        fill(record, skin.state(contacts=given, **of_state))
        record["stamp_ns"] = 10**18 + round(1e9 * step_s) * k
        history.add(record[0])
    return history


def moment_of(skin, **of_state):
    record = snapshots(1, skin.topology.n)
    fill(record, skin.state(**of_state))
    return Moment(record[0], Pose(*skin.poses))


# A unit.


@pytest.fixture
def unit():
    api, skin = Api(), Shown(2, 3)
    folder = UnitFolder(api, layout_of(described_layout(skin.topology)))
    words = next(node for node in api.all if node.kind == "add_html")
    plots = [node for node in api.all if node.kind == "add_uplot"]
    return folder, skin, words, plots, api


def test_a_unit_says_its_name_force_temperature_and_flags(unit):
    folder, skin, words, _, api = unit
    force, status = np.zeros((3, N)), np.zeros(N, np.uint16)
    force[:, 4], status[4] = (0.1, 0.0, 2.0), int(Status.STALE | Status.UNTARED)
    assert not api.nodes["Unit"].visible
    folder.choose(4)
    assert api.nodes["Unit"].visible
    folder.show(moment_of(skin, force=force, status=status))
    for text in ("u4", "2.00 ± 0.01 N", "0.100 ± 0.010 N", "30.0 °C", "stale", "untared"):
        assert text in words.content
    folder.choose(None)
    assert not api.nodes["Unit"].visible


def test_a_unit_that_was_never_heard_is_shown_as_that(unit):
    folder, skin, words, plots, _ = unit
    force, status = np.full((3, N), np.nan), np.full(N, int(Status.NEVER), np.uint16)
    moment = moment_of(skin, force=force, status=status)
    moment.record["temperature"] = np.nan
    folder.choose(2)
    folder.show(moment)
    assert "no force" in words.content
    assert "unknown" in words.content
    assert "never" in words.content
    assert "nan" not in words.content
    folder.plot(history_of([()] * 5, force=force))
    assert all(values.size == 0 for values in plots[0].data)


def test_a_unit_is_plotted_with_its_sigma(unit):
    folder, _, _, plots, _ = unit
    force = np.zeros((3, N))
    force[:, 1] = 0.3, 0.4, 1.5
    folder.choose(1)
    folder.plot(history_of([()] * 30, force=force))
    time_s, normal, shear, above, below = plots[0].data
    np.testing.assert_allclose(time_s, np.arange(-29, 1) * 0.1, atol=1e-6)
    np.testing.assert_allclose(normal, 1.5)
    np.testing.assert_allclose(shear, 0.5, rtol=1e-6)
    np.testing.assert_allclose(above - below, 0.02, rtol=1e-4)
    np.testing.assert_allclose(plots[1].data[1], 30.0)


def test_points_that_are_not_known_are_left_out_of_plots():
    time_s, values = known(np.arange(3.0), np.array([1.0, np.nan, 3.0]))
    assert (time_s.tolist(), values.tolist()) == ([0.0, 2.0], [1.0, 3.0])


# A contact.


@pytest.fixture
def contact():
    api = Api()
    folder = ContactFolder(api)
    words = next(node for node in api.all if node.kind == "add_html")
    load, margin = (node for node in api.all if node.kind == "add_uplot")
    return folder, words, load, margin


def test_no_contact_is_plotted_until_one_is_asked_for(contact):
    folder, words, load, _ = contact
    before = load.visible, vars(load).get("data")
    folder.plot(history_of([((3, 1.0),)] * 10))
    assert folder.choice.options == (NONE, LARGEST, "contact 3")
    assert not words.visible
    assert (load.visible, vars(load).get("data")) == before == (False, None)


def test_a_chosen_contact_is_plotted_wherever_it_is_in_the_list(contact):
    folder, words, load, margin = contact
    history = history_of([((3, 1.0 + 0.1 * k), (7, 5.0)) for k in range(10)]
                         + [((7, 5.0), (3, 2.0))] * 5)  # fmt: skip
    folder.choice.value = "contact 3"
    folder.plot(history)
    np.testing.assert_allclose(load.data[1], [*(1.0 + 0.1 * np.arange(10)), *[2.0] * 5])
    np.testing.assert_allclose(load.data[2], 0.0, atol=1e-9)
    np.testing.assert_allclose(margin.data[1], 50.0)
    assert "2.00 N" in words.content
    assert "stick" in words.content
    folder.choice.value = LARGEST
    folder.plot(history)
    np.testing.assert_allclose(load.data[1], 5.0)


def test_a_contact_that_ends_while_it_is_plotted_stays_as_long_as_it_is_seen(contact):
    folder, words, load, _ = contact
    folder.choice.value = "contact 3"
    folder.plot(history_of([((3, 1.0),)] * 10 + [()] * 20))
    np.testing.assert_allclose(load.data[0], np.arange(-29, -19) * 0.1, atol=1e-6)
    assert "3, ended 2.0 s ago" in words.content
    assert folder.choice.value == "contact 3"
    folder.plot(history_of([((3, 1.0),)] * 10 + [()] * 201))
    assert folder.choice.value == LARGEST
    assert folder.choice.options == (NONE, LARGEST)
    assert "none now" in words.content
    assert load.data[0].size == 0


def test_a_contact_that_pauses_bears_nothing_meanwhile(contact):
    folder, _, load, margin = contact
    folder.choice.value = "contact 3"
    folder.plot(history_of([((3, 1.0),), (), (), ((3, 2.0),)]))
    assert load.data[1].tolist() == [1.0, 0.0, 0.0, 2.0]
    assert margin.data[0].size == 2


def test_without_contacts_there_is_none_to_choose(contact):
    """States that no contacts were wanted of have none in their record."""
    folder, words, _, _ = contact
    folder.choice.value = LARGEST
    folder.plot(history_of([()] * 3))
    assert folder.choice.options == (NONE, LARGEST)
    assert "none now" in words.content


def test_what_is_left_of_contacts_before_is_not_one(contact):
    folder, *_ = contact
    history = history_of([((3, 1.0),), ()])
    assert np.frombuffer(history[1].record["contacts"].tobytes(), CONTACT)["id"][0] == 0
    folder.plot(history)
    assert folder.choice.options == (NONE, LARGEST, "contact 3")


# The map of a patch.


def test_a_flat_patch_is_seen_from_outside():
    palm = load("palm")
    flat = flattened(palm.position, palm.rotation)
    span = palm.position - palm.position.mean(axis=1, keepdims=True)
    distances = np.linalg.norm(span[:, :, None] - span[:, None], axis=0)
    np.testing.assert_allclose(
        np.linalg.norm(flat[:, :, None] - flat[:, None], axis=0), distances, atol=1e-9
    )
    # right-handed about the outward normal
    outward = -palm.rotation[:, 2, 0]
    a, b = span[:, 1] - span[:, 0], span[:, 8] - span[:, 0]
    turned = np.cross(a, b) @ outward
    x, y = flat[:, 1] - flat[:, 0], flat[:, 8] - flat[:, 0]
    assert np.sign(x[0] * y[1] - x[1] * y[0]) == np.sign(turned)


def test_a_cylinder_is_unrolled():
    skin = Shown(5, 12, 0.012)
    half = np.flatnonzero(np.arange(60) % 12 <= 6)
    flat = flattened(skin.poses[0][:, half], skin.poses[1][:, :, half])
    along = np.abs(np.diff(np.sort(np.unique(np.round(flat[0], 6)))))
    np.testing.assert_allclose(along, 0.012, atol=1e-5)  # arcs are the pitch
    np.testing.assert_allclose(np.unique(np.round(flat[1], 6)), 0.012 * np.arange(5), atol=1e-6)


def test_units_of_a_dome_do_not_lie_on_one_another():
    dome = load("fingertip")
    flat = flattened(dome.position, dome.rotation)
    apart = np.linalg.norm(flat[:, :, None] - flat[:, None], axis=0)
    np.fill_diagonal(apart, np.inf)
    real = np.linalg.norm(dome.position[:, :, None] - dome.position[:, None], axis=0)
    np.fill_diagonal(real, np.inf)
    assert apart.min() > 0.6 * real.min()
    assert np.isfinite(flattened(dome.position[:, :1], dome.rotation[:, :, :1])).all()


def at(image, drawn, unit, share=0.0):
    """The colour of a place on a unit: its middle, or a share of its radius to the right."""
    inside = np.argwhere(drawn._unit == unit)
    row, column = np.rint(inside.mean(axis=0)).astype(int)
    last = inside[inside[:, 0] == row, 1].max()
    return tuple(image[row, column + round(share * (last - column))].tolist())


def test_the_map_has_the_colours_of_the_units_and_marks_the_chosen_one():
    palm = load("palm")
    units = np.arange(64)
    drawn = PatchMap(units, palm.position, palm.rotation, palm.area)
    record = snapshots(1, 64)[0]
    record["status"][9], record["status"][20] = int(Status.NEVER), int(Status.DISABLED)
    values = np.linspace(0.0, 2.0, 64)
    image = drawn.image(record, values, (0.0, 2.0), 30)
    expected = colours(values, np.ones(64, bool), 0.0, 2.0)
    for unit in (0, 7, 40, 63):
        assert at(image, drawn, unit) == tuple(expected[unit].tolist())
        assert at(image, drawn, unit, 1.0) == tuple(RIM_COLOUR.tolist())
    assert at(image, drawn, 30, 1.0) == tuple(CHOSEN_COLOUR.tolist())
    assert at(image, drawn, 20) == OFF_COLOUR
    assert at(image, drawn, 9) == (0, 0, 0)  # the middle of its cross
    assert at(image, drawn, 9, 0.6) == INVALID_COLOUR
    assert tuple(image[0, 0].tolist()) == BACKGROUND


def test_a_map_is_made_only_where_one_is_chosen():
    api, skin = Api(), Shown(4, 6)
    skin.topology.patch, skin.topology.patch_names = np.arange(24) // 12, ("low", "high")
    folder = MapFolder(api, layout_of(described_layout(skin.topology)))
    image = next(node for node in api.all if node.kind == "add_image")
    assert folder.choice.options == (NONE, "low", "high")
    folder.show(moment_of(skin), "load", Scales(), None)
    assert not image.visible
    assert "image" not in vars(image)
    folder.choice.value = "high"
    folder.show(moment_of(skin), "load", Scales(), 3)
    assert image.visible
    assert image.image.dtype == np.uint8
    assert folder._maps["high"].units.tolist() == list(range(12, 24))
