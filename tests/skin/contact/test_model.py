"""Geometry of units and the memory of a stream."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tests.naive.contact as naive
from skin.contact.model import (
    POSE,
    WAYPOINTS,
    check_poses,
    contact_data,
    no_readings,
    posed_units,
    set_poses,
)
from skin.contact.record import CONTACT, UNTOUCHED
from skin.contact.touched import TOUCHED_ROWS
from skin.errors import SkinError


def arrays_of(value):
    """Arrays of a tuple of tuples, with their names."""
    for name, field in zip(value._fields, value, strict=True):
        if hasattr(field, "_fields"):
            yield from ((f"{name}.{inner}", array) for inner, array in arrays_of(field))
        else:
            yield name, field


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_new_stream_has_room_as_documented_and_knows_of_nothing(dtype):
    n, capacity, edges = 5, 3, 8
    slots = 2 * capacity
    reading = no_readings(n, dtype)
    data = dict(arrays_of(contact_data(reading, capacity, edges)))
    shapes = {
        "reading.force": (3, n), "reading.force_sigma": (3, n), "reading.displacement": (3, n),
        "reading.displacement_sigma": (3, n), "reading.temperature": (n,), "reading.valid": (n,),
        "reading.given": (1,), "units.begin": (n + 1,), "units.members": (n,),
        "units.loaded": (n,), "units.queue": (n,), "units.owner": (n,), "slots.present": (slots,),
        "slots.ended": (slots,), "slots.before": (capacity,), "slots.parent": (capacity,),
        "slots.mark": (slots,), "counters": (1,), "clock": (1,), "shared": (n,),
        "nearby": (n + edges,), "order": (n + edges,), "most": (slots,), "contacts": (slots + 1,),
        "paths": (slots, WAYPOINTS, 3), "sums.rows": (capacity + 2,),
        "touched": (TOUCHED_ROWS, 24), "scratch.first": (3, 3), "scratch.vectors": (3, 3),
        "evidence.level": (n,), "evidence.cycle": (n,),
    }  # fmt: skip
    assert {name: data[name].shape for name in shapes} == shapes
    assert data["contacts"].dtype == CONTACT
    for name in ("force", "force_sigma", "displacement", "displacement_sigma", "temperature"):
        assert data[f"reading.{name}"].dtype == dtype
    none = {"units.label": -1, "units.owner": -1, "reading.valid": 1, "evidence.cycle": -2,
            "shocks.elapsed_s": 0.004}  # fmt: skip
    unknown = "untouched", "borne"
    for name, array in data.items():
        if name in unknown or name == "clock":
            continue
        if name.startswith("slip."):
            assert array.size == 0 or not array.any(), name
        else:
            known = np.frombuffer(array.tobytes(), np.uint8) if name not in none else 0
            assert not np.any(known), name
    for name, value in none.items():
        assert (data[name] == value).all()
    assert np.isnan(data["borne"]).all()
    assert data["clock"].tolist() == [(0, 0, False, 0.004, 0, 0.0, 0)]
    for name in CONTACT.names:
        np.testing.assert_array_equal(data["untouched"][name], UNTOUCHED[name])
    data["sums.rows"]["load"][1] = 7.0
    assert 7.0 in data["sums.columns"][1], "the same memory"


def test_positions_are_about_the_middle_and_rotations_as_given():
    rng = np.random.default_rng(1)
    position, n = rng.normal(size=(3, 6)) + 10.0, 6
    rotation = np.moveaxis(Rotation.random(n, rng=rng).as_matrix(), 0, 2)
    area = rng.uniform(1.0, 2.0, n)
    geometry = posed_units(position, rotation, area)
    assert geometry.pose.dtype == POSE
    for _ in range(2):
        middle = position.mean(axis=1)
        assert geometry.origin == pytest.approx(middle)
        for i in range(n):
            pose = geometry.pose[i]
            assert pose["position"] == pytest.approx(position[:, i] - middle)
            assert pose["rotation"].tolist() == rotation[:, :, i].tolist()
            assert pose["area"] == area[i]
        position, rotation = position[:, ::-1] - 3.0, rotation[:, :, ::-1]
        set_poses(geometry, position, rotation)
    assert (posed_units(position, rotation, 2.5).pose["area"] == 2.5).all()


@pytest.mark.parametrize("area", [0.0, -1.0, np.nan, [1.0, 1.0, 0.0], np.ones(2), np.ones((3, 1))])
def test_an_area_that_is_none_is_refused(area):
    with pytest.raises(SkinError, match="area: must be positive, one or 3 of them; got shape"):
        posed_units(np.zeros((3, 3)), naive.facing_down(3), area)


def test_poses_of_another_number_of_units_are_refused():
    right = np.zeros((3, 3)), naive.facing_down(3)
    wrong = np.zeros((3, 4)), naive.facing_down(4)
    for position, rotation in ((right[0], wrong[1]), (wrong[0], right[1]), wrong):
        with pytest.raises(SkinError, match=r"position, rotation: must have shapes \(3, 3\)"):
            check_poses(3, position, rotation)
    check_poses(3, *right)
    with pytest.raises(SkinError, match=r"position, rotation: must have shapes \(3, 3\)"):
        posed_units(right[0], wrong[1], 1.0)
