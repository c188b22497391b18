"""Geometry of units and the memory of a stream."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tests.naive.contact as naive
from skin.contact.model import POSE, check_poses, contact_data, contact_model, set_poses
from skin.contact.record import CONTACT, UNTOUCHED
from skin.errors import SkinError

ALONE = np.zeros(7, int), np.zeros(0, int)


def test_a_new_stream_has_room_as_documented_and_knows_of_nothing():
    n, capacity, edges = 5, 3, 8
    data = contact_data(n, capacity, edges)
    sizes = {"units": n, "label": n, "slip": n, "members": n, "lists": n + 1, "slots": 6,
             "contacts": 7, "cycle": 1, "pairs": 2 * n + edges, "sums": 2}  # fmt: skip
    assert {name: getattr(data, name).size for name in sizes} == sizes
    assert data.contacts.dtype == CONTACT
    fields = [CONTACT[name].itemsize for name in CONTACT.names]
    assert CONTACT.itemsize == sum(fields), "no gaps, which a copy would fill with anything"
    assert not np.frombuffer(data.contacts[:-1].tobytes(), np.uint8).any()
    for name in CONTACT.names:
        np.testing.assert_array_equal(data.contacts[name][-1:], UNTOUCHED[name])
    assert (data.label == -1).all()
    assert (data.units["owner"] == -1).all()
    assert np.isnan(data.units["borne"]).all()
    data.sums["load"][1] = 7.0
    assert 7.0 in data.columns[1], "the same memory"


def test_positions_are_about_the_middle_and_rotations_as_given():
    rng = np.random.default_rng(1)
    position, n = rng.normal(size=(3, 6)) + 10.0, 6
    rotation = np.moveaxis(Rotation.random(n, rng=rng).as_matrix(), 0, 2)
    area = rng.uniform(1.0, 2.0, n)
    model = contact_model(position, rotation, area, *ALONE)
    assert model.poses.dtype == POSE
    for _ in range(2):
        middle = position.mean(axis=1)
        assert model.settings["origin"][0] == pytest.approx(middle)
        for i in range(n):
            pose = model.poses[i]
            assert pose["position"] == pytest.approx(position[:, i] - middle)
            assert pose["rotation"].tolist() == rotation[:, :, i].tolist()
            assert pose["area"] == area[i]
        position, rotation = position[:, ::-1] - 3.0, rotation[:, :, ::-1]
        set_poses(model, position, rotation)
    assert (contact_model(position, rotation, 2.5, *ALONE).poses["area"] == 2.5).all()


@pytest.mark.parametrize("area", [0.0, -1.0, np.nan, [1.0, 1.0, 0.0], np.ones(2), np.ones((3, 1))])
def test_an_area_that_is_none_is_refused(area):
    with pytest.raises(SkinError, match="area: must be positive, one or 3 of them; got shape"):
        contact_model(np.zeros((3, 3)), naive.facing_down(3), area, [0, 0, 0, 0], [])


def test_poses_of_another_number_of_units_are_refused():
    right = np.zeros((3, 3)), naive.facing_down(3)
    wrong = np.zeros((3, 4)), naive.facing_down(4)
    for position, rotation in ((right[0], wrong[1]), (wrong[0], right[1]), wrong):
        with pytest.raises(SkinError, match=r"position, rotation: must have shapes \(3, 3\)"):
            check_poses(3, position, rotation)
    check_poses(3, *right)
    with pytest.raises(SkinError, match=r"position, rotation: must have shapes \(3, 3\)"):
        contact_model(right[0], wrong[1], 1.0, [0, 0, 0, 0], [])
