"""What is known of a contact, as one record: computed by the kernels, read by everybody."""

from __future__ import annotations

from enum import IntEnum, IntFlag

import numpy as np

__all__ = ["CONTACT", "UNTOUCHED", "Event", "Flag", "SlipState", "TrackState", "UnitKind",
           "UnitSlip"]  # fmt: skip


class UnitKind(IntEnum):
    """What a unit is in this cycle."""

    OUT = 0
    """No contact."""
    OPEN = 1
    """Above the gate."""
    BRIDGE = 2
    """Silent, but in contact when last heard."""
    SILENT = 3


class TrackState(IntEnum):
    """What became of an identity."""

    FREE = 0
    """The record is not in use."""
    PRESENT = 1
    """In contact in this cycle."""
    ABSORBED = 2
    """Grown together with another contact, whose record speaks for both until they part."""
    LOST = 3
    """Ended a moment ago; whatever touches the same place soon gets the identity back."""


class Event(IntFlag):
    """What happened to a contact in this cycle."""

    NONE = 0
    BORN = 1 << 0
    """First cycle; `parent` names the contact that it split from, if it did."""
    RESUMED = 1 << 1
    """Back after it was lost, or parted again after it had been absorbed."""
    MERGED = 1 << 2
    """Another contact was absorbed by this one."""
    SPLIT = 1 << 3
    """A part of this contact went on as a contact of its own."""


class Flag(IntFlag):
    """What a number of a contact does not know."""

    NONE = 0
    WEAK = 1 << 0
    """Load below 5 σ √n: no centre of pressure (NaN), nor anything about it."""
    NORMAL_ASSUMED = 1 << 1
    """Too few units, or all in a row: the normal is the mean of the units' own."""
    TORSION_BLIND = 1 << 2
    """One unit: nothing can be said of a moment about its normal."""
    FEW_UNITS = 1 << 3
    """Fewer than three units: slip is judged by the friction cone alone."""
    NO_FRICTION = 1 << 4
    """No friction estimate yet: margin and grip force are NaN."""
    NOISY = 1 << 5
    """The noise of a unit, seen while the contact held, is greater than its sigma says: sigmas are
    too small, for calibration or surroundings have changed. `Contact.noisy_units` are which."""
    UNSEEN = 1 << 6
    """Not whole: a unit that is not heard lies in or beside it, or touched something when it was
    last heard, or has no neighbour that would show a touch. What it may bear is in the sigmas."""


class UnitSlip(IntEnum):
    """What a unit does under what it touches."""

    NO_CONTACT = 0
    STICK = 1
    SLIPPING = 2
    RE_STICK = 3
    """Held again, after it had slipped in this contact."""


class SlipState(IntEnum):
    """What a contact does as a whole."""

    NONE = 0
    """Too little is known yet."""
    STICK = 1
    INCIPIENT = 2
    """Some of the load slips: the last moment to grip harder."""
    GROSS = 3
    """The object slides."""


# The members as kernels take them: numba knows no IntFlag.
OUT, OPEN, BRIDGE, SILENT = map(int, UnitKind)
FREE, PRESENT, ABSORBED, LOST = map(int, TrackState)
BORN, RESUMED, MERGED, SPLIT = map(int, Event)
WEAK, NORMAL_ASSUMED, TORSION_BLIND, FEW_UNITS, NO_FRICTION, NOISY, UNSEEN = map(int, Flag)


CONTACT = np.dtype(
    [
        # -- identity: written by track
        ("id", np.int64),
        ("parent", np.int64),
        ("track", np.int32),  # TrackState
        ("event", np.int32),  # Event
        ("into", np.int32),  # record that absorbed this one, -1
        ("begin", np.int32),  # units: members[begin:end]
        ("end", np.int32),
        ("cycles", np.int64),
        ("born_ns", np.int64),
        ("seen_ns", np.int64),
        # -- load: written by describe
        ("flags", np.int32),  # Flag
        ("peak_unit", np.int32),
        ("hot_unit", np.int32),
        ("load", np.float64),  # N, sum of normal loads
        ("load_sigma", np.float64),
        ("wrench", np.float64, (6,)),  # N, N·m about the origin of the skin frame
        ("wrench_covariance", np.float64, (6, 6)),
        ("wrench_sigma", np.float64, (6,)),
        ("centroid", np.float64, (3,)),  # m, skin frame
        ("middle", np.float64, (3,)),  # m, centre of the loads of its own units alone
        ("centroid_covariance", np.float64, (3, 3)),
        ("moment", np.float64, (3,)),  # N·m about the centre
        ("moment_covariance", np.float64, (3, 3)),
        ("area", np.float64),  # m²
        ("mean_pressure", np.float64),  # Pa
        ("peak_pressure", np.float64),
        ("axes", np.float64, (3, 3)),  # columns: major, minor, normal
        ("extent", np.float64, (2,)),  # m, root-mean-square half lengths
        ("normal", np.float64, (3,)),  # outward, away from the skin
        ("normal_condition", np.float64),  # 1 round, 0 a line
        ("shear", np.float64),  # N, force across the normal
        ("torsion", np.float64),  # N·m about the normal
        ("torsion_sigma", np.float64),
        ("arm", np.float64),  # m, load-weighted mean distance from the centre
        ("temperature", np.float64),
        ("temperature_gradient", np.float64, (3,)),  # K/m
        ("hot_temperature", np.float64),
        ("coverage", np.float64),
        # -- path: written by path
        ("origin", np.float64, (3,)),  # first known centre
        ("waypoint", np.float64, (3,)),  # last centre that counted as a step
        ("travel", np.float64),  # m
        ("waypoints", np.int64),
        # -- slip: written by slip
        ("slip", np.int32),  # SlipState
        ("slip_units", np.int32),  # units that judge
        ("body_units", np.int32),
        ("stick_ratio", np.float64),
        ("pattern", np.float64),  # of slip: root of twice the logarithm of its odds
        ("slip_probability", np.float64),
        ("slip_direction", np.float64, (3,)),  # of the body over the skin; 1 long if all go alike
        ("onset_ns", np.int64),  # of the present slip, 0
        ("motion", np.float64, (3,)),  # mm, of the body since contact, skin frame
        ("rotation", np.float64, (3,)),  # rad
        ("gross_ns", np.int64),  # when it began to slide as a whole
        ("gross_ratio", np.float64),  # friction in use since then
        # -- friction: written by slip
        ("friction", np.float64),
        ("friction_sigma", np.float64),
        ("friction_lower", np.float64),
        ("friction_information", np.float64),
        ("friction_mean", np.float64),
        ("friction_spread", np.float64),  # one-sigma over the faces
        ("margin", np.float64),
        ("grip_force", np.float64),  # N
        ("grip_force_sigma", np.float64),
    ],
    align=True,
)
"""One contact. Metre, newton, newton metre, pascal, second; skin frame unless it says otherwise."""


def _untouched() -> np.ndarray:
    """The total where nothing touches: zero force, no centre, nothing known of anything else."""
    record = np.zeros(1, CONTACT)
    zero = ("load", "load_sigma", "wrench", "wrench_covariance", "wrench_sigma", "area", "shear")
    for name in CONTACT.names or ():
        if CONTACT[name].base == np.float64 and name not in zero:
            record[name] = np.nan
    record["peak_unit"] = record["hot_unit"] = -1
    record["flags"] = Flag.WEAK
    return record


UNTOUCHED = _untouched()
"""Shape (1,)."""
