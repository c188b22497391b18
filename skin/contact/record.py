"""The record of a contact: written by the kernels, read by everybody else.

A field is declared once, in `Fields`.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

import numpy as np

from skin.contact.field import Field, declared, detail, hidden

__all__ = ["AXES", "CONTACT", "LOADS", "LOAD_UNITS", "NEW", "QUANTITIES", "UNTOUCHED", "Event",
           "Fields", "Flag", "SlipState", "TrackState", "UnitKind", "UnitSlip"]  # fmt: skip

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
    """No friction estimate yet: friction, margin and grip force are NaN; their bounds are known."""
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
UNTRACKED = -2
"""Label of units in a contact beyond the capacity."""
WEAK, NORMAL_ASSUMED, TORSION_BLIND, FEW_UNITS, NO_FRICTION, NOISY, UNSEEN = map(int, Flag)


def _happened(event: Event, doc: str) -> Field[bool]:
    """Whether an event is one of those of a cycle."""
    return Field(bool, doc, values=lambda found: found["event"] & int(event) != 0)


class Fields:
    """Fields of the record of a contact, in order.

    Metre, newton, newton metre, pascal, second; skin frame unless stated. A field that is added
    here is an attribute of `skin.contact.contact.Contact`, and, unless it is a `detail`, a column,
    an array and a field of messages in every output: ``make reference`` renews their list in
    docs/reference/columns.md.
    """

    __slots__ = ()
    record: np.void
    """All of its numbers, of `CONTACT`."""

    # -- identity: written by find_contacts
    id = Field(int, "Identity, constant while the contact lasts; never used again.", dtype=np.int64)
    parent = Field(int, "Identity of the contact that it split from, 0.", dtype=np.int64)
    track = hidden(np.int32)  # TrackState
    event = detail(Event, "Events in this cycle.")
    born = _happened(Event.BORN, "Whether this is its first cycle.")
    resumed = _happened(Event.RESUMED, "Whether it is back after it was lost or absorbed.")
    merged = _happened(Event.MERGED, "Whether another contact was absorbed by it.")
    split = _happened(Event.SPLIT, "Whether a part of it went on as a contact of its own.")
    into = hidden(np.int32)  # record that absorbed this one, -1
    begin = hidden(np.int32)  # units: members[begin:end]
    end = hidden(np.int32)
    flags = detail(Flag, "Limitations of its numbers.")  # written by describe
    units = Field(int, "How many units it has.", message="uint16",
                  values=lambda found: found["end"] - found["begin"])  # fmt: skip
    cycles = hidden(np.int64)
    born_ns = hidden(np.int64)
    seen_ns = hidden(np.int64)
    # -- load: written by describe
    whole = Field(bool, "Whether no silent unit may bear some of its load.",
                  values=lambda found: found["flags"] & int(Flag.UNSEEN) == 0)  # fmt: skip
    friction_known = Field(
        bool, "Whether friction is one that slip has shown, or was given. Where not, friction, "
        "margin and grip_force are NaN, and only their bounds are known.",
        values=lambda found: np.isfinite(found["friction"]),
    )  # fmt: skip
    peak_unit = detail(int, "Its most loaded unit.")
    hot_unit = detail(int, "Its warmest unit.")
    load = Field(float, "Sum of the normal loads.", "N")
    load_sigma = detail(float, "One-sigma of `load`.")
    wrench = Field(np.ndarray, "Force and torque about the origin, exerted by the world; shape "
                   "(6,).", LOAD_UNITS, columns=LOADS, message="geometry_msgs/Wrench")  # fmt: skip
    wrench_covariance = detail(np.ndarray, "Shape (6, 6).", (6, 6))
    wrench_sigma = Field(
        np.ndarray, "One-sigma of `wrench`, shape (6,): the ambient field is a common error of all "
        "units, with the places of load on the faces, and the possible loads of silent units and "
        "of neighbours below the gate.", LOAD_UNITS, columns=[f"{load}_sigma" for load in LOADS],
    )  # fmt: skip
    centroid = Field(
        np.ndarray, "Centre of pressure, from the normal loads at the middles of its units and of "
        "neighbours below the gate; NaN where WEAK; shape (3,).", "m", columns=AXES,
        message="geometry_msgs/Point",
    )  # fmt: skip
    middle = hidden(np.float64, (3,))  # m, centre of the loads of its own units alone
    centroid_covariance = detail(
        np.ndarray, "Shape (3, 3), of the true centre of pressure: due to the places of load on "
        "the faces, the noise of its units and neighbours, and the possible loads of silent units.",
        (3, 3),
    )  # fmt: skip
    moment = detail(np.ndarray, "Torque about the centre of its units' loads, shape (3,).", (3,))
    moment_covariance = detail(np.ndarray, "Shape (3, 3).", (3, 3))
    normal = Field(np.ndarray, "Outward, away from the skin; shape (3,).",
                   columns=("nx", "ny", "nz"), message="geometry_msgs/Vector3")  # fmt: skip
    normal_condition = detail(float, "Roundness of the spread of its units: 1 round, 0 a line.")
    area = Field(float, "Sensing area of its units.", "m2")
    mean_pressure = detail(float, "Load over area.")
    peak_pressure = detail(float, "Of its most loaded unit.")
    axes = detail(np.ndarray, "Columns: major axis, minor axis, normal; shape (3, 3).", (3, 3))
    extent = detail(np.ndarray, "Root-mean-square half lengths along the first two axes, shape "
                    "(2,).", (2,))  # fmt: skip
    shear = Field(float, "Force across the normal.", "N")
    torsion = Field(float, "Torque about the normal.", "N m")
    torsion_sigma = detail(float, "One-sigma of `torsion`.")
    arm = detail(float, "Load-weighted mean distance of its units from the centroid.")
    # -- path: written by describe
    origin = hidden(np.float64, (3,))  # first known centre
    waypoint = hidden(np.float64, (3,))  # last centre that counted as a step
    travel = Field(float, "Distance that its centroid has travelled so far.", "m")
    waypoints = hidden(np.int64)
    # -- warmth: written by describe
    temperature = Field(float, "Mean over its area, degree Celsius.", "degC")
    temperature_gradient = detail(np.ndarray, "K/m along the skin, shape (3,).", (3,))
    hot_temperature = Field(float, "Of its warmest unit.", "degC")
    coverage = detail(float, "Heard fraction of its area and that of silent neighbours.")
    # -- slip: written by detect_slip
    slip = Field(SlipState, "State of the contact as a whole.", message="uint8")
    slip_units = detail(int, "Units that slip.")
    body_units = hidden(np.int64)  # of its body that were tested; as long as what follows
    onset_ns = hidden(np.int64)  # of the present slip, 0
    slip_began = Field(
        bool, "Whether it began to slip in this cycle.",
        values=lambda found: (found["onset_ns"] != 0) & (found["onset_ns"] == found["seen_ns"]),
    )  # fmt: skip
    stick_ratio = Field(float, "Fraction of the load on units that stick.")
    pattern = detail(float, "Odds of slip by the lags, as sigmas: root of twice their logarithm.")
    slip_probability = Field(float, "Probability that some of the load slips; NaN without enough "
                             "data.")  # fmt: skip
    slip_direction = detail(
        np.ndarray, "Direction of slip over the skin: mean of unit vectors, shorter than 1 for a "
        "rotation; NaN without slip; shape (3,).", (3,),
    )  # fmt: skip
    motion = detail(np.ndarray, "Displacement of the skin by the body since contact, millimetre; "
                    "shape (3,).", (3,))  # fmt: skip
    rotation = detail(np.ndarray, "Rotation of the skin by the body, radian; shape (3,).", (3,))
    gross_ns = hidden(np.int64)  # when it began to slide as a whole
    gross_ratio = hidden(np.float64)  # used friction since then
    decided_ns = hidden(np.int64)  # when enough units were last heard to decide `slip`
    # -- friction: written by detect_slip
    friction = Field(float, "Coefficient of friction that slip has shown, or that was given; NaN "
                     "where neither is known.")  # fmt: skip
    friction_sigma = Field(float, "One-sigma of `friction`.")
    friction_at_least = Field(float, "Lower bound of friction, by the loads of units that stick.")
    friction_information = hidden(np.float64)
    friction_mean = hidden(np.float64)
    friction_spread = detail(float, "One-sigma of friction over the faces of the contact.")
    margin = Field(float, "Free fraction of the friction cone; NaN where friction is not known.")
    margin_at_least = Field(float, "Lower bound of the margin by `friction_at_least`; the margin "
                            "where friction is known.")  # fmt: skip
    grip_force = Field(float, "Normal force that holds with the wanted safety; NaN where friction "
                       "is not known.", "N")  # fmt: skip
    grip_force_at_most = Field(float, "Upper bound of it: what holds now does; the grip force "
                               "where friction is known.", "N")  # fmt: skip
    grip_force_sigma = Field(float, "One-sigma of `grip_force`, by friction and tangential load.",
                             "N")  # fmt: skip


CONTACT, QUANTITIES = declared(Fields)
"""The record of a contact, and its output quantities, in order."""


def _blank(*zero: str) -> np.ndarray:
    """A record of which nothing is known but that these numbers are 0."""
    record = np.zeros(1, CONTACT)
    for name in CONTACT.names or ():
        if CONTACT[name].base == np.float64 and name not in zero:
            record[name] = np.nan
    record["peak_unit"] = record["hot_unit"] = -1
    return record


NEW = _blank(
    "travel", "friction_at_least", "friction_information", "friction_mean", "gross_ratio"
)  # fmt: skip
"""A contact that begins, shape (1,)."""
UNTOUCHED = _blank("load", "load_sigma", "wrench", "wrench_covariance", "wrench_sigma", "area",
                   "shear")  # fmt: skip
"""The total without contacts, shape (1,)."""
UNTOUCHED["flags"] = Flag.WEAK
