"""States in the names and codes of the PapillArray."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import skin
from skin.contact.papillarray import NO_ESTIMATE, PapillArray, SlipCode
from skin.contact.record import UnitSlip
from skin.errors import SkinError

SENSOR = ["tus", "pillars", "gfX", "gfY", "gfZ", "gtX", "gtY", "gtZ", "friction_est",
          "target_grip_force", "is_sd_active", "is_ref_loaded", "is_contact"]  # fmt: skip
PILLAR = ["id", "dX", "dY", "dZ", "fX", "fY", "fZ", "in_contact", "slip_state"]


@pytest.fixture
def touched():
    """A palm under a load, and its state."""
    with skin.open("palm", simulate=True, pace=False, want={"wrench", "slip"}, seed=3) as palm:
        yield palm, next(s for s in palm if s.contacts and s.contacts[0].load > 8.0)


def test_names_are_those_of_the_messages(touched):
    _, state = touched
    sensor = PapillArray()(state)
    assert [field.name for field in dataclasses.fields(sensor)] == SENSOR
    assert [field.name for field in dataclasses.fields(sensor.pillars[0])] == PILLAR


def test_numbers_are_those_of_the_state(touched):
    opened, state = touched
    turn = Rotation.from_rotvec([0.2, -0.4, 1.0]).as_matrix()
    origin = np.array([0.01, 0.02, -0.03])
    sensor = PapillArray(turn, origin)(state)
    force, moment = state.wrench[:3], state.wrench[3:]
    assert [sensor.gfX, sensor.gfY, sensor.gfZ] == pytest.approx(turn.T @ force)
    about = turn.T @ (moment - np.cross(origin, force))
    assert [sensor.gtX, sensor.gtY, sensor.gtZ] == pytest.approx(1e3 * about)
    assert PapillArray()(state).gfZ == pytest.approx(-force[2])
    assert sensor.tus == state.stamp_ns // 1000
    assert sensor.is_contact
    assert sensor.is_sd_active
    for pillar in sensor.pillars:
        i = pillar.id
        assert [pillar.fX, pillar.fY, pillar.fZ] == state.units.force[:, i].tolist()
        assert [pillar.dX, pillar.dY, pillar.dZ] == state.units.displacement_mm[:, i].tolist()
        assert pillar.in_contact == (state.label[i] >= 0)
    assert len(sensor.pillars) == opened.topology.n


def test_friction_of_the_heaviest_contact_or_no_estimate(touched):
    _, state = touched
    record = state.contacts[0].record
    record["friction"], record["grip_force"] = np.nan, np.nan
    sensor = PapillArray()(state)
    assert (sensor.friction_est, sensor.target_grip_force) == (NO_ESTIMATE, NO_ESTIMATE)
    record["friction"], record["grip_force"] = 0.45, 7.5
    sensor = PapillArray()(state)
    assert (sensor.friction_est, sensor.target_grip_force) == (0.45, 7.5)
    record["shear"] = 0.05
    assert not PapillArray()(state).is_ref_loaded
    record["shear"] = 0.15
    assert PapillArray()(state).is_ref_loaded


def test_slip_codes_follow_a_unit_through_a_grasp(touched):
    _, state = touched
    tell = PapillArray()
    unit, other = 5, 6
    told = []
    for slip, shear in (
        (UnitSlip.NO_CONTACT, 0.0),
        (UnitSlip.STICK, 0.0),
        (UnitSlip.STICK, 0.5),
        (UnitSlip.SLIPPING, 0.5),
        (UnitSlip.RE_STICK, 0.5),
        (UnitSlip.NO_CONTACT, 0.0),
        (UnitSlip.STICK, 0.0),
    ):
        state.slip[:] = UnitSlip.NO_CONTACT
        state.slip[unit], state.slip[other] = slip, UnitSlip.STICK
        state.label[:] = np.where(state.slip > 0, 0, -1)
        state.units.force[:2, unit] = 0.0, shear
        told.append(tell(state).pillars[unit].slip_state)
    assert told == [-2, 1, 2, 3, 3, -1, 1]
    state.label[:] = -1
    assert {p.slip_state for p in tell(state).pillars} == {SlipCode.INELIGIBLE}


def test_untouched_skin_tells_nothing_of_friction():
    with skin.open("fingertip", simulate=True, pace=False, want={"wrench", "slip"}) as finger:
        state = next(iter(finger))
    sensor = PapillArray()(state)
    assert not sensor.is_contact
    assert not sensor.is_ref_loaded
    assert sensor.friction_est == sensor.target_grip_force == NO_ESTIMATE
    assert sensor.gfZ == 0.0


def test_state_without_slip_is_refused():
    with skin.open("fingertip", simulate=True, pace=False, want={"wrench"}) as finger:
        state = next(iter(finger))
    with pytest.raises(SkinError, match="want: must have 'wrench' and 'slip' for a PapillArray"):
        PapillArray()(state)
