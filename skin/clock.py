"""Clock of the filters: time of the cycles, from their stamps and their SYNC numbers.

Stamps jitter with the host and step when a clock is set. The SYNC number has no jitter, but does
not count the time in which a bus was silent. So the time advances by the periods that the number
counts, and follows the stamps through a low-pass filter. A stamp that is later by more than
`GAP_PERIODS` shows a gap: the time advances by the gap. The time never stops or runs backwards.
"""

from __future__ import annotations

__all__ = ["Clock"]

FOLLOW = 16
"""Time constant of the filter that follows the stamps, cycles [assumed]."""
GAP_PERIODS = 2
"""Latest stamp that is no gap, periods [assumed: more than the jitter of a host]."""
LONGEST_NS = 3_600_000_000_000
"""Steps of stamps beyond this show a clock that was set, not a gap [assumed]."""


class Clock:
    """Time of the cycles.

    Parameters
    ----------
    period_ns : int

    Attributes
    ----------
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
        self._period_ns = self.elapsed_ns = period_ns
        self.now_ns = self.overruns = 0
        self._before: tuple[int, int] | None = None
        self._off_ns = 0
        """Stamp of the last cycle minus the time, still to be followed."""

    def tick(self, number: int, stamp_ns: int) -> None:
        """Advance to the next cycle, by its `RawCycle.number` and `RawCycle.stamp_ns`."""
        before, self._before = self._before, (number, stamp_ns)
        if before is None:
            return
        counted_ns = elapsed_ns = max(number - before[0], 1) * self._period_ns
        stamped_ns = stamp_ns - before[1]
        if 0 < stamped_ns < LONGEST_NS:
            if stamped_ns - counted_ns > GAP_PERIODS * self._period_ns:
                counted_ns = stamped_ns
            off_ns = self._off_ns + stamped_ns - counted_ns
            elapsed_ns = max(counted_ns + off_ns // FOLLOW, counted_ns // FOLLOW, 1)
            self._off_ns += stamped_ns - elapsed_ns
        self.elapsed_ns = elapsed_ns
        self.now_ns += elapsed_ns
        self.overruns += max(round(elapsed_ns / self._period_ns) - 1, 0)
