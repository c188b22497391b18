"""Status of a unit: one word of flags that travels with every number."""

from __future__ import annotations

from enum import IntFlag

__all__ = ["INVALID", "Status"]


class Status(IntFlag):
    """Flags of one unit in one cycle; 0 is a healthy, fresh reading.

    The lower byte is set by the bus (is there a number at all?), the upper by the decoder (is the
    number within what the unit can measure?).
    """

    OK = 0
    NEVER = 1 << 0
    """No good frame has ever arrived."""
    LATE = 1 << 1
    """Missing in this cycle; the last value is shown."""
    STALE = 1 << 2
    """Missing for `stale_cycles` or longer."""
    FROZEN = 1 << 3
    """Counts of a channel, or of all, stand still for longer than noise allows."""
    FAULT = 1 << 4
    """The unit reports a fault of its own."""
    DUPLICATE = 1 << 5
    """Two units send with this identifier."""
    DISABLED = 1 << 6
    """Switched off in the topology file."""
    TORN = 1 << 7
    """Frames of different cycles met in this unit; the last whole value is shown."""

    SATURATED = 1 << 8
    """A count at its rail, or the tangential field at the crest: the value is a lower bound."""
    OUT_OF_RANGE = 1 << 9
    """Counts that no working unit produces (broken gel, stopped timer)."""
    EXTRAPOLATED = 1 << 10
    """Beyond the calibrated range of force, displacement or temperature."""
    NOT_F3T = 1 << 11
    """A sensor of another kind, of which nothing is known but its counts."""
    MAGNETIC_ANOMALY = 1 << 12
    """The field is not the film's own at this depth and displacement: steel or a magnet is near, or
    the unit is not the one that was calibrated. What is tangential is wrong."""
    IDLE = 1 << 13
    """Without load, and so not looked at any further: what is tangential reads NaN, not zero."""
    UNCALIBRATED = 1 << 14
    """The unit's constants are those of its model, its sigma holds the spread from unit to unit. A
    note: the reading is valid."""
    UNTARED = 1 << 15
    """The unit's zeros are those of its bench or its model, not of its place: its sigma holds what
    neighbours at rest may add. A note: the reading is valid."""


INVALID = (
    Status.NEVER
    | Status.LATE
    | Status.STALE
    | Status.FROZEN
    | Status.FAULT
    | Status.DUPLICATE
    | Status.DISABLED
    | Status.TORN
    | Status.OUT_OF_RANGE
    | Status.NOT_F3T
    | Status.MAGNETIC_ANOMALY
)
"""Any of these, and array features (wrench, centroid, clusters) leave the unit out."""
