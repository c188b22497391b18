"""The clock that filters run on: time of cycles, from their stamps and their numbers.

A stamp tells when a cycle was, but jitters with the host, and a clock that is set steps. The number
of a SYNC tells time without jitter, but not how long a bus was silent. So time goes on by as many
periods as the number has, and follows the stamps with a low-pass filter; where a stamp is later
than that by more than `GAP_PERIODS`, something was left out, and the time goes on by as much. It
never stands still or steps back.
"""

from __future__ import annotations

__all__ = ["Clock"]

FOLLOW = 16
"""Cycles in which the time follows the stamps [assumed]: jitter of a cycle counts a sixteenth."""
GAP_PERIODS = 2
"""Periods by which a stamp may be late [assumed: more than a host is in a cycle]."""
LONGEST_NS = 3_600_000_000_000
"""Stamps that leap by more tell of a clock that was set, not of a gap [assumed]."""


class Clock:
    """Time of cycles.

    Parameters
    ----------
    period_ns : int

    Attributes
    ----------
    period_ns : int
        As given.
    number : int or None
        Of the last cycle, as its stamp; None before the first one.
    stamp_ns : int
    off_ns : int
        By which the stamp is later than the time: what is left of it to follow.
    now_ns : int
        Of the last cycle; 0 of the first one.
    elapsed_ns : int
        From the cycle before to the last one; a period before and at the first one.
    overruns : int
        Periods, so far, that had no cycle.

    Examples
    --------
    >>> clock = Clock(4_000_000)
    >>> for number, stamp_ns in ((0, 100), (1, 4_000_100), (6, 24_000_100)):
    ...     clock.tick(number, stamp_ns)
    >>> clock.now_ns, clock.overruns
    (24000000, 4)
    """

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.now_ns, self.elapsed_ns, self.overruns = 0, period_ns, 0
        self.number: int | None = None
        self.stamp_ns = self.off_ns = 0

    def tick(self, number: int, stamp_ns: int) -> None:
        """Go on to the next cycle.

        Parameters
        ----------
        number : int
            `RawCycle.number`
        stamp_ns : int
            `RawCycle.stamp_ns`
        """
        if self.number is not None:
            self._go_on(max(number - self.number, 1) * self.period_ns, stamp_ns - self.stamp_ns)
        self.number, self.stamp_ns = number, stamp_ns

    def _go_on(self, counted_ns: int, stamped_ns: int) -> None:
        """By a time that numbers and stamps tell."""
        period_ns = self.period_ns
        if 0 < stamped_ns < LONGEST_NS:
            if stamped_ns - counted_ns > GAP_PERIODS * period_ns:
                counted_ns = stamped_ns
            off_ns = self.off_ns + stamped_ns - counted_ns
            elapsed_ns = max(counted_ns + off_ns // FOLLOW, counted_ns // FOLLOW, 1)
            self.off_ns = self.off_ns + stamped_ns - elapsed_ns
        else:
            elapsed_ns = counted_ns
        self.elapsed_ns = elapsed_ns
        self.now_ns += elapsed_ns
        self.overruns += max(round(elapsed_ns / period_ns) - 1, 0)
