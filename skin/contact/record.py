"""The record of a contact: written by the kernels, read by everybody else.

A field is declared once, in `Fields`.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

import numpy as np

from skin.contact.field import Derived, Hidden, Number, Vector, declared

__all__ = ["AXES", "CONTACT", "LOADS", "LOAD_UNITS", "QUANTITIES", "UNTOUCHED", "Event", "Fields",
           "Flag", "SlipState", "TrackState", "UnitKind", "UnitSlip"]  # fmt: skip

AXES = ("x", "y", "z")
LOADS = ("fx", "fy", "fz", "mx", "my", "mz")
LOAD_UNITS = ("N", "N", "N", "N m", "N m", "N m")


class UnitKind(IntEnum):
    """State of a unit in this cycle."""

    OUT = 0
    """No contact."""
    OPEN = 1
    """Above the gate."""
    BRIDGE = 2
    """Silent, but in contact when last heard."""
    SILENT = 3


class TrackState(IntEnum):
    """State of an identity."""

    FREE = 0
    """The record is not in use."""
    PRESENT = 1
    """In contact in this cycle."""
    ABSORBED = 2
    """Merged with another contact, whose record represents both until they part."""
    LOST = 3
    """Ended recently; the next contact at the same place gets the identity back."""


class Event(IntFlag):
    """Events of a contact in this cycle."""

    NONE = 0
    BORN = 1 << 0
    """First cycle; `parent` is the contact that it split from, if any."""
    RESUMED = 1 << 1
    """Back after it was lost, or separate again after it was absorbed."""
    MERGED = 1 << 2
    """Another contact was absorbed by this one."""
    SPLIT = 1 << 3
    """A part of this contact became a contact of its own."""


class Flag(IntFlag):
    """Limitations of the numbers of a contact."""

    NONE = 0
    WEAK = 1 << 0
    """Load below 5 σ √n: the centre of pressure and what depends on it is NaN."""
    NORMAL_ASSUMED = 1 << 1
    """Too few units, or all in a row: the normal is the mean of the units' own."""
    TORSION_BLIND = 1 << 2
    """One unit: no torque about its normal can be measured."""
    FEW_UNITS = 1 << 3
    """Fewer than three units: slip is detected by the friction cone alone."""
    NO_FRICTION = 1 << 4
    """No friction estimate yet: friction and margin are lower bounds, grip force an upper one."""
    NOISY = 1 << 5
    """The measured noise of a unit is greater than its sigma: sigmas are too small, since
    calibration or surroundings have changed. See `Contact.noisy_units`."""
    UNSEEN = 1 << 6
    """Not whole: a silent unit was in contact when last heard, lies next to a contact that has come
    or changed since, or has no neighbour that would show one. Its possible load is in the sigmas.
    """


class UnitSlip(IntEnum):
    """State of a unit in a contact."""

    NO_CONTACT = 0
    STICK = 1
    SLIPPING = 2
    RE_STICK = 3
    """Sticks again, after it had slipped in this contact."""


class SlipState(IntEnum):
    """State of a contact as a whole."""

    UNKNOWN = 0
    """Not enough data yet."""
    STICK = 1
    INCIPIENT = 2
    """Some of the load slips: the last chance to grip harder."""
    GROSS = 3
    """The object slides."""


# The members as kernels take them: numba knows no IntFlag.
OUT, OPEN, BRIDGE, SILENT = map(int, UnitKind)
FREE, PRESENT, ABSORBED, LOST = map(int, TrackState)
BORN, RESUMED, MERGED, SPLIT = map(int, Event)
WEAK, NORMAL_ASSUMED, TORSION_BLIND, FEW_UNITS, NO_FRICTION, NOISY, UNSEEN = map(int, Flag)


def _happened(event: Event, doc: str) -> Derived:
    """Whether an event is one of those of a cycle."""
    return Derived(doc, "bool", lambda found: found["event"] & int(event) != 0)


class Fields:
    """Fields of the record of a contact, in order.

    Metre, newton, newton metre, pascal, second; skin frame unless stated. A field that is added
    here is an attribute of `skin.contact.contact.Contact`, and a column, an array and a field of
    messages in every output: ``python -m tests.house draw`` renews their list in
    docs/reference/columns.md.
    """

    __slots__ = ()
    record: np.void
    """All of its numbers, of `CONTACT`."""

    # -- identity: written by track
    id = Number(int, "Identity, constant while the contact lasts; never used again.",
                dtype=np.int64)  # fmt: skip
    parent = Number(int, "Identity of the contact that it split from, 0.", dtype=np.int64)
    track = Hidden(np.int32)  # TrackState
    event = Number(Event, "Events in this cycle.", leaves=False)
    born = _happened(Event.BORN, "Whether this is its first cycle.")
    resumed = _happened(Event.RESUMED, "Whether it is back after it was lost or absorbed.")
    merged = _happened(Event.MERGED, "Whether another contact was absorbed by it.")
    split = _happened(Event.SPLIT, "Whether a part of it went on as a contact of its own.")
    into = Hidden(np.int32)  # record that absorbed this one, -1
    begin = Hidden(np.int32)  # units: members[begin:end]
    end = Hidden(np.int32)
    units = Derived("How many units it has.", "int32",
                    lambda found: found["end"] - found["begin"], message="uint16")  # fmt: skip
    cycles = Hidden(np.int64)
    born_ns = Hidden(np.int64)
    seen_ns = Hidden(np.int64)
    # -- load: written by describe
    flags = Number(Flag, "Limitations of its numbers.", leaves=False)
    whole = Derived(
        "Whether no silent unit may bear some of its load.", "bool",
        lambda found: found["flags"] & int(Flag.UNSEEN) == 0,
    )  # fmt: skip
    friction_known = Derived(
        "Whether friction is one that slip has shown, or was given. Where not, friction and margin "
        "are lower bounds, grip_force an upper one.", "bool",
        lambda found: np.isfinite(found["friction"])
        & (found["flags"] & int(Flag.NO_FRICTION) == 0),
    )  # fmt: skip
    peak_unit = Number(int, "Its most loaded unit.", leaves=False)
    hot_unit = Number(int, "Its warmest unit.", leaves=False)
    load = Number(float, "Sum of the normal loads.", "N")
    load_sigma = Number(float, "One-sigma of `load`.", leaves=False)
    wrench = Vector(
        "Force and torque about the origin, exerted by the world; shape (6,).", (6,), LOAD_UNITS,
        columns=LOADS, message="geometry_msgs/Wrench",
    )  # fmt: skip
    wrench_covariance = Vector("Shape (6, 6).", (6, 6))
    wrench_sigma = Vector(
        "One-sigma of `wrench`, shape (6,): the ambient field is a common error of all units, "
        "with the places of load on the faces, and the possible loads of silent units and of "
        "neighbours below the gate.",
        (6,), LOAD_UNITS, columns=(f"{load}_sigma" for load in LOADS),
    )  # fmt: skip
    centroid = Vector(
        "Centre of pressure, from the normal loads at the middles of its units and of neighbours "
        "below the gate; NaN where WEAK; shape (3,).",
        (3,), "m", columns=AXES, message="geometry_msgs/Point",
    )  # fmt: skip
    middle = Hidden(np.float64, (3,))  # m, centre of the loads of its own units alone
    centroid_covariance = Vector(
        "Shape (3, 3), of the true centre of pressure: due to the places of load on the faces, the "
        "noise of its units and neighbours, and the possible loads of silent units.",
        (3, 3),
    )
    moment = Vector("Torque about the centre of its units' loads, shape (3,).", (3,))
    moment_covariance = Vector("Shape (3, 3).", (3, 3))
    normal = Vector(
        "Outward, away from the skin; shape (3,).", (3,),
        columns=(f"n{axis}" for axis in AXES), message="geometry_msgs/Vector3",
    )  # fmt: skip
    normal_condition = Number(
        float, "Roundness of the spread of its units: 1 round, 0 a line.", leaves=False
    )
    area = Number(float, "Sensing area of its units.", "m2")
    mean_pressure = Number(float, "Load over area.", leaves=False)
    peak_pressure = Number(float, "Of its most loaded unit.", leaves=False)
    axes = Vector("Columns: major axis, minor axis, normal; shape (3, 3).", (3, 3))
    extent = Vector("Root-mean-square half lengths along the first two axes, shape (2,).", (2,))
    shear = Number(float, "Force across the normal.", "N")
    torsion = Number(float, "Torque about the normal.", "N m")
    torsion_sigma = Number(float, "One-sigma of `torsion`.", leaves=False)
    arm = Number(float, "Load-weighted mean distance of its units from the centroid.", leaves=False)
    # -- path: written by path
    origin = Hidden(np.float64, (3,))  # first known centre
    waypoint = Hidden(np.float64, (3,))  # last centre that counted as a step
    travel = Number(float, "Distance that its centroid has travelled so far.", "m")
    waypoints = Hidden(np.int64)
    # -- warmth: written by describe
    temperature = Number(float, "Mean over its area, degree Celsius.", "degC")
    temperature_gradient = Vector("K/m along the skin, shape (3,).", (3,))
    hot_temperature = Number(float, "Of its warmest unit.", "degC")
    coverage = Number(
        float, "Heard fraction of its area and that of silent neighbours.", leaves=False
    )
    # -- slip: written by slip
    slip = Number(SlipState, "State of the contact as a whole.", message="uint8")
    slip_units = Number(int, "Units that slip.", leaves=False)
    body_units = Hidden(np.int32)
    onset_ns = Hidden(np.int64)  # of the present slip, 0
    slip_began = Derived(
        "Whether it began to slip in this cycle.", "bool",
        lambda found: (found["onset_ns"] != 0) & (found["onset_ns"] == found["seen_ns"]),
    )  # fmt: skip
    stick_ratio = Number(float, "Fraction of the load on units that stick.")
    pattern = Number(
        float, "Odds of slip by the lags, as sigmas: root of twice their logarithm.", leaves=False
    )
    slip_probability = Number(
        float, "Probability that some of the load slips; NaN without enough data."
    )
    slip_direction = Vector(
        "Direction of slip over the skin: mean of unit vectors, shorter than 1 for a rotation; "
        "NaN without slip; shape (3,).",
        (3,),
    )
    motion = Vector("Displacement of the skin by the body since contact, millimetre; shape (3,).",
                    (3,))  # fmt: skip
    rotation = Vector("Rotation of the skin by the body, radian; shape (3,).", (3,))
    gross_ns = Hidden(np.int64)  # when it began to slide as a whole
    gross_ratio = Hidden(np.float64)  # used friction since then
    decided_ns = Hidden(np.int64)  # when enough units were last heard to decide `slip`
    # -- friction: written by slip
    friction = Number(
        float, "Coefficient of friction that slip has shown; before, what units that stick have "
        "borne, and 0 at least: it is not less."
    )  # fmt: skip
    friction_sigma = Number(float, "One-sigma of `friction`.")
    friction_lower = Number(
        float, "Lower bound of friction, by the loads of units that stick.", leaves=False
    )
    friction_information = Hidden(np.float64)
    friction_mean = Hidden(np.float64)
    friction_spread = Number(
        float, "One-sigma of friction over the faces of the contact.", leaves=False
    )
    margin = Number(
        float, "Free fraction of the friction cone; where friction is not known, at least this."
    )
    grip_force = Number(
        float, "Normal force that holds with the wanted safety; where friction is not known, at "
        "most this: what holds now does.", "N"
    )  # fmt: skip
    grip_force_sigma = Number(
        float, "One-sigma of `grip_force`, by friction and tangential load.", "N"
    )


CONTACT, QUANTITIES = declared(Fields)
"""The record of a contact, and its output quantities, in order."""


def _untouched() -> np.ndarray:
    """The total without contacts: zero force, no centre, all else unknown."""
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
