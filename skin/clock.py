"""Clock of the filters: time of the cycles, from their stamps and their SYNC numbers.

Stamps jitter with the host and step when a clock is set. The SYNC number has no jitter, but does
not count the time in which a bus was silent. So the time advances by the periods that the number
counts, and follows the stamps through a low-pass filter. A stamp that is later by more than
`GAP_PERIODS` shows a gap: the time advances by the gap. The time never stops or runs backwards.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable

__all__ = ["TIME", "Clock", "tick"]

FOLLOW = 16
"""Time constant of the filter that follows the stamps, cycles [assumed]."""
GAP_PERIODS = 2
"""Latest stamp that is no gap, periods [assumed: more than the jitter of a host]."""
LONGEST_NS = 3_600_000_000_000
"""Steps of stamps beyond this show a clock that was set, not a gap [assumed]."""

TIME = np.dtype([
    ("period_ns", np.int64),
    ("begun", np.int64),  # whether a cycle was counted
    ("number", np.int64), ("stamp_ns", np.int64),  # of the last cycle
    ("off_ns", np.int64),  # its stamp minus the time, still to be followed
    ("now_ns", np.int64), ("elapsed_ns", np.int64), ("overruns", np.int64),  # see `Clock`
])  # fmt: skip
"""The state of a clock."""


@jitable
def tick(number, stamp_ns, time):
    """Advance to the next cycle; `time` is a record of TIME."""
    if time["begun"] != 0:
        period_ns = time["period_ns"]
        counted_ns = max(number - time["number"], 1) * period_ns
        stamped_ns = stamp_ns - time["stamp_ns"]
        elapsed_ns = counted_ns
        if 0 < stamped_ns < LONGEST_NS:
            if stamped_ns - counted_ns > GAP_PERIODS * period_ns:
                counted_ns = stamped_ns
            off_ns = time["off_ns"] + stamped_ns - counted_ns
            elapsed_ns = max(counted_ns + off_ns // FOLLOW, counted_ns // FOLLOW, 1)
            time["off_ns"] += stamped_ns - elapsed_ns
        time["elapsed_ns"] = elapsed_ns
        time["now_ns"] += elapsed_ns
        time["overruns"] += max(np.int64(np.rint(elapsed_ns / period_ns)) - 1, 0)
    time["begun"], time["number"], time["stamp_ns"] = 1, number, stamp_ns


class Clock:
    """Time of the cycles.

    Parameters
    ----------
    period_ns : int

    Attributes
    ----------
    time : ndarray, shape (1,), TIME
        Storage of the state, which the compiled cycle advances.
    now_ns : int
        Of the last cycle; 0 of the first one.
    elapsed_ns : int
        From the cycle before to the last one; a period before and at the first one.
    overruns : int
        Periods without a cycle so far.

    Examples
    --------
    >>> clock = Clock(4_000_000)
    >>> for number, stamp_ns in ((0, 100), (1, 4_000_100), (6, 24_000_100)):
    ...     clock.tick(number, stamp_ns)
    >>> clock.now_ns, clock.overruns
    (24000000, 4)
    """

    def __init__(self, period_ns: int) -> None:
        self.time = np.zeros(1, TIME)
        self.time["period_ns"] = self.time["elapsed_ns"] = period_ns

    def tick(self, number: int, stamp_ns: int) -> None:
        """Advance to the next cycle, by its `RawCycle.number` and `RawCycle.stamp_ns`."""
        tick(number, stamp_ns, self.time[0])

    @property
    def now_ns(self) -> int:
        return int(self.time["now_ns"][0])

    @property
    def elapsed_ns(self) -> int:
        return int(self.time["elapsed_ns"][0])

    @property
    def overruns(self) -> int:
        return int(self.time["overruns"][0])
