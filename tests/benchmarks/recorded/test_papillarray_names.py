"""States in the names and codes of the PapillArray."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import skin
from benchmarks.recorded.papillarray_names import NO_ESTIMATE, PapillArray, SlipCode
from skin.contact.record import Flag, UnitSlip
from skin.errors import NotWantedError

SENSOR = ["tus", "pillars", "gfX", "gfY", "gfZ", "gtX", "gtY", "gtZ", "friction_est",
          "target_grip_force", "is_sd_active", "is_ref_loaded", "is_contact"]  # fmt: skip
PILLAR = ["id", "dX", "dY", "dZ", "fX", "fY", "fZ", "in_contact", "slip_state"]


@pytest.fixture
def touched():
    """A palm under a load, and its state."""
    with skin.open("palm", simulate=True, pace=False, want={"wrench", "slip"}, seed=3) as palm:
        yield palm, next(s for s in palm if s.contacts and s.contacts[0].load > 8.0)


def told_by(array, slip, *, shear=0.0, contacts=(), wrench=(0.0,) * 6, stamp_ns=0):
    """What `array` makes of units that slip so (0 for no contact), sheared by `shear` newton."""
    slip = np.array(slip)
    n = slip.size
    force, moved = np.arange(3.0 * n).reshape(3, n), -np.arange(3.0 * n).reshape(3, n)
    force[0], force[1] = 0.6 * np.array(shear), 0.8 * np.array(shear)
    return array(
        SimpleNamespace(
            units=SimpleNamespace(force=force, displacement_mm=moved), slip=slip,
            label=np.where(slip > 0, 0, -1), contacts=list(contacts), wrench=np.array(wrench),
            stamp_ns=stamp_ns,
        )
    )  # fmt: skip


def contact(load, shear=0.0, friction=np.nan, grip_force=np.nan):
    return SimpleNamespace(
        load=load, shear=shear, friction=friction, grip_force=grip_force,
        friction_known=bool(np.isfinite(friction)),
    )  # fmt: skip


def test_a_wrench_is_told_in_the_frame_asked_for_and_in_newton_millimetres():
    wrench = np.array([1.0, 2.0, -9.0, 0.1, 0.2, 0.3])
    sensor = told_by(PapillArray(), [1, 1], wrench=wrench, stamp_ns=5_000_999)
    assert [sensor.gfX, sensor.gfY, sensor.gfZ] == [1.0, -2.0, 9.0]
    assert [sensor.gtX, sensor.gtY, sensor.gtZ] == pytest.approx([100.0, -200.0, -300.0])
    assert sensor.tus == 5000
    turn, origin = Rotation.from_rotvec([0.2, -0.4, 1.0]).as_matrix(), np.array([0.1, 0.2, -0.3])
    for rotation, point in ((turn, origin), (turn, np.zeros(3)), (np.diag([1, -1, -1]), origin)):
        given = {"rotation": rotation} if rotation is turn else {}
        given |= {"origin": point} if point is origin else {}
        sensor = told_by(PapillArray(**given), [1, 1], wrench=wrench)
        assert [sensor.gfX, sensor.gfY, sensor.gfZ] == pytest.approx(rotation.T @ wrench[:3])
        about = rotation.T @ (wrench[3:] - np.cross(point, wrench[:3]))
        assert [sensor.gtX, sensor.gtY, sensor.gtZ] == pytest.approx(1e3 * about)


def test_units_and_heaviest_contact_of_a_state():
    shear = np.array([0.09, 0.11, 0.0])
    sensor = told_by(PapillArray(), [1, 1, 0], shear=shear, contacts=[contact(1.0, 9.0, 0.3, 4.0),
                     contact(3.0, 0.11, 0.5, 6.0), contact(2.0, 9.0)])  # fmt: skip
    assert [pillar.id for pillar in sensor.pillars] == [0, 1, 2]
    assert [pillar.fZ for pillar in sensor.pillars] == [6.0, 7.0, 8.0]
    assert [pillar.dY for pillar in sensor.pillars] == [-3.0, -4.0, -5.0]
    assert [pillar.in_contact for pillar in sensor.pillars] == [True, True, False]
    assert [pillar.slip_state for pillar in sensor.pillars] == [1, 2, -2]
    assert (sensor.friction_est, sensor.target_grip_force) == (0.5, 6.0)
    assert (sensor.is_contact, sensor.is_ref_loaded, sensor.is_sd_active) == (True, True, True)
    light = told_by(PapillArray(), [1], shear=0.2, contacts=[contact(1.0, 0.09)])
    assert (light.is_contact, light.is_ref_loaded) == (True, False)
    assert (light.friction_est, light.target_grip_force) == (-1.0, -1.0)
    careless = told_by(PapillArray(shear_n=0.3), [1], shear=0.2, contacts=[contact(1.0, 0.2)])
    assert (careless.pillars[0].slip_state, careless.is_ref_loaded) == (1, False)
    untouched = told_by(PapillArray(), [0])
    assert (untouched.is_contact, untouched.is_ref_loaded, untouched.friction_est) == (
        False, False, -1.0,
    )  # fmt: skip


def test_slip_codes_through_two_grasps():
    tell = PapillArray()
    none, stick, slipping, held = map(int, UnitSlip)
    for slip, shear, codes in (
        ([none, none], 0.0, [-2, -2]),
        ([stick, none], 0.0, [1, -2]),
        ([stick, stick], 0.5, [2, 2]),
        ([slipping, stick], 0.5, [3, 2]),
        ([held, none], 0.0, [3, -1]),
        ([none, stick], 0.0, [-1, 1]),
        ([none, stick], 0.0, [-1, 1]),
        ([none, none], 0.0, [-2, -2]),
        ([none, stick], 0.0, [-2, 1]),
        ([stick, stick, stick], 0.0, [1, 1, 1]),
    ):
        sensor = told_by(tell, slip, shear=shear)
        assert [pillar.slip_state for pillar in sensor.pillars] == codes


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
    record["friction"], record["grip_force"] = 0.3, 9.0
    record["flags"] |= Flag.NO_FRICTION
    sensor = PapillArray()(state)
    assert (sensor.friction_est, sensor.target_grip_force) == (NO_ESTIMATE, NO_ESTIMATE)
    record["friction"], record["grip_force"] = 0.45, 7.5
    record["flags"] &= ~Flag.NO_FRICTION
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
    with pytest.raises(NotWantedError, match="must be wanted to be read"):
        PapillArray()(state)
