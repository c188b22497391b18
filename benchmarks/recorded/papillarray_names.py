"""Contacts in the names of Contactile's PapillArray, for programs that were written for it.

Field names are those of the messages ``SensorState`` and ``PillarState`` of its ROS node
``papillarray_ros_v2``, codes and the value that stands for no estimate those of
``PTSDKConstants.h``; what they mean is told by its C++ manual (PTSC++LIN_2.0_MAN_MAR23, tables 4.1
and 4.2). Millimetre, newton, newton millimetre.

Two things differ, and neither needs a change of the program. Slip detection is always active: it
needs no start, and so every contact counts as started when it began. And units that hold again
after a slip stay SLIPPED until they leave the contact, as pillars do.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from skin.contact.contact import wrench_adjoint
from skin.contact.record import UnitSlip
from skin.state import State

__all__ = ["NO_ESTIMATE", "PapillArray", "PillarState", "SensorState", "SlipCode"]

NO_ESTIMATE = -1.0
"""Friction and grip force of which nothing is known (NOFRICTIONEST)."""


class SlipCode(IntEnum):
    """Slip state of a pillar."""

    INELIGIBLE = -2
    """Not in contact."""
    LOST_CONTACT = -1
    """Was in contact, since the skin was last untouched, and is no more."""
    CONTACT_AT_START = 1
    """In contact, without much load along the skin."""
    TLOADING = 2
    """In contact, loaded along the skin."""
    SLIPPED = 3


@dataclass(slots=True)
class PillarState:
    """A unit; its own frame, z into the skin: `fZ` and `dZ` are positive when pressed."""

    id: int
    dX: float
    dY: float
    dZ: float
    fX: float
    fY: float
    fZ: float
    in_contact: bool
    slip_state: int


@dataclass(slots=True)
class SensorState:
    """The whole skin: global force and torque; friction and grip force of the heaviest contact."""

    tus: int
    pillars: list[PillarState]
    gfX: float
    gfY: float
    gfZ: float
    gtX: float
    gtY: float
    gtZ: float
    friction_est: float
    target_grip_force: float
    is_sd_active: bool
    is_ref_loaded: bool
    is_contact: bool


class PapillArray:
    """States of a skin as a PapillArray sensor would tell them; call it with each state.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3), optional
        Columns are the axes, in the skin frame, in which global force and torque are told; if not
        given, z is the skin frame's -z: into a skin that faces +z, so that a press is positive.
    origin : ndarray, shape (3,), optional
        Metre, skin frame: the point about which the torque is taken; its origin if not given. (A
        PapillArray takes the tip of its centre pillar.)
    shear_n : float
        Force along the skin from which a unit, and the contact as a whole, counts as loaded.

    Examples
    --------
    ::

        tell = PapillArray()
        with skin.open("fingertip", want={"wrench", "slip"}) as finger:
            for state in finger:
                sensor = tell(state)
                if any(pillar.slip_state == SlipCode.SLIPPED for pillar in sensor.pillars):
                    gripper.grip(sensor.target_grip_force)
    """

    def __init__(
        self,
        rotation: np.ndarray | None = None,
        origin: np.ndarray | None = None,
        *,
        shear_n: float = 0.1,
    ) -> None:
        self._rotation = np.diag([1.0, -1.0, -1.0]) if rotation is None else np.asarray(rotation)
        self._origin = np.zeros(3) if origin is None else np.asarray(origin)
        self._shear_n = shear_n
        self._codes = np.zeros(0, np.int64)

    def __call__(self, state: State) -> SensorState:
        """Tell one state.

        Raises
        ------
        NotWantedError
            The skin was opened without wanting wrench or slip.
        """
        force, moved = state.units.force, state.units.displacement_mm
        wrench, slip, label = state.wrench, state.slip, state.label
        assert moved is not None
        loaded = np.hypot(force[0], force[1]) > self._shear_n
        codes = self._follow(label >= 0, slip, loaded)
        total = wrench_adjoint(self._rotation, self._origin) @ wrench
        heaviest = max(state.contacts, key=lambda contact: contact.load, default=None)
        estimated = heaviest if heaviest is not None and heaviest.friction_known else None
        return SensorState(
            state.stamp_ns // 1000,
            [
                PillarState(
                    i,
                    *moved[:, i].tolist(),
                    *force[:, i].tolist(),
                    in_contact=code > 0,
                    slip_state=code,
                )
                for i, code in enumerate(codes.tolist())
            ],
            *total[:3].tolist(),
            *(1e3 * total[3:]).tolist(),
            friction_est=_known(estimated and estimated.friction),
            target_grip_force=_known(estimated and estimated.grip_force),
            is_sd_active=True,
            is_ref_loaded=heaviest is not None and heaviest.shear > self._shear_n,
            is_contact=heaviest is not None,
        )

    def _follow(self, touching: np.ndarray, slip: np.ndarray, loaded: np.ndarray) -> np.ndarray:
        """Slip codes of the units, by their slip and what they were before."""
        if self._codes.size != slip.size or not touching.any():
            self._codes = np.full(slip.size, SlipCode.INELIGIBLE)
        before = self._codes
        lost = np.where(before == SlipCode.INELIGIBLE, before, SlipCode.LOST_CONTACT)
        slipped = (slip == UnitSlip.SLIPPING) | (slip == UnitSlip.RE_STICK)
        held = np.where(loaded, SlipCode.TLOADING, SlipCode.CONTACT_AT_START)
        self._codes = np.where(touching, np.where(slipped, SlipCode.SLIPPED, held), lost)
        return self._codes


def _known(value: float | None) -> float:
    return NO_ESTIMATE if value is None else float(value)
