"""Status of a unit: flags that accompany every number."""

from __future__ import annotations

from enum import IntFlag

__all__ = ["INVALID", "Status"]


class Status(IntFlag):
    """Flags of one unit in one cycle; 0 is a healthy, fresh reading.

    The lower byte is set by the bus (whether there is a number), the upper by the decoder (whether
    the number is within the range of the unit).
    """

    OK = 0
    NEVER = 1 << 0
    """No good frame has ever arrived."""
    LATE = 1 << 1
    """Missing in this cycle; the last value is shown."""
    STALE = 1 << 2
    """Missing for `stale_cycles` or longer."""
    FROZEN = 1 << 3
    """Counts of a channel, or of all, are constant for longer than noise allows."""
    FAULT = 1 << 4
    """The unit reports a fault."""
    DUPLICATE = 1 << 5
    """Two units send with this identifier."""
    DISABLED = 1 << 6
    """Switched off in the topology file."""
    TORN = 1 << 7
    """Frames of different cycles in this unit; the last complete value is shown."""

    SATURATED = 1 << 8
    """A count at its rail, or the tangential field at the crest: the value is a lower bound."""
    OUT_OF_RANGE = 1 << 9
    """Counts that no working unit produces (broken gel, stopped timer)."""
    EXTRAPOLATED = 1 << 10
    """Beyond the calibrated range of force, displacement or temperature."""
    NOT_F3T = 1 << 11
    """A sensor of another kind, of which only the counts are known."""
    MAGNETIC_ANOMALY = 1 << 12
    """The field is not that of the film at this depth and displacement: steel or a magnet is near,
    or the unit is not the calibrated one. Tangential quantities are wrong."""
    IDLE = 1 << 13
    """Unloaded, and decoded no further: tangential quantities are NaN, not zero."""
    UNCALIBRATED = 1 << 14
    """The unit's constants are those of its model, and its sigma includes the spread between units.
    A note: the reading is valid."""
    UNTARED = 1 << 15
    """The unit's zeros are those of its bench or its model, not of its place: its sigma includes
    the field of neighbours at rest. A note: the reading is valid."""


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
"""Array features (wrench, centroid, clusters) leave out units with any of these."""
