"""ClockModel: the map from an interface's own clock to the kernel's; DriverClock: frame by frame.

Stamps by a controller are accurate to a few microseconds, but its clock has an unknown offset and
its own rate; the kernel's stamp is of a known clock, but late by an interrupt, a queue, a USB
transfer. The delay is never negative: the map is the line below all pairs of stamps that is nearest
to them [Moon, Skelly, Towsley, INFOCOM 1999]. The smallest delay cannot be distinguished from the
offset and remains in it.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

__all__ = ["ClockModel", "DriverClock"]

SEGMENT_NS = 100_000_000
"""Length of a segment, of which the pair with the smallest delay is kept [assumed]."""
KEPT = 100
"""Segments in the window: 10 s, in which rates of crystals are constant [assumed]."""
LEAST = 5
"""Segments before the map is used [assumed]."""
STEP_NS = 2_000_000
"""Distance of a whole segment above the line, or of a pair below it, where a clock was set
[assumed: more than the delay of a late host in all of 0.1 s]."""
STEPPED = 3
"""Consecutive such segments above the line that show a step [assumed]."""
FASTEST = 1e-3
"""Largest difference of clock rates [assumed: ten times a bad crystal]."""
WRAPS_NS = [2**bits * 10**tick for bits in (16, 24, 32) for tick in range(7)]
"""Ranges of the counters of adapters: ticks of 1 ns to 1 ms [assumed]."""


class ClockModel:
    """Maps stamps of one clock to another, from pairs whose second stamp is late.

    Attributes
    ----------
    origin_ns : int
        Stamp of the first clock at which `offset_ns` holds.
    offset_ns : int
        Second clock minus first one.
    drift : float
        Change of the offset per time.
    error_ns : float
        One sigma of the map, by the median of the kept pairs' distance to it, for some wait long
        to be read; NaN before it is ready.
    steps : int
        How often a clock was set.

    Examples
    --------
    >>> model = ClockModel()
    >>> for i in range(10):  # the second clock: 5 s ahead, 40 ppm faster, late by 1 µs or more
    ...     stamp_ns = i * SEGMENT_NS
    ...     model.learn(stamp_ns, 5_000_000_000 + round(stamp_ns * 1.00004) + 1000 + i % 2)
    >>> model.ready, round(1e6 * model.drift), model(2 * SEGMENT_NS)
    (True, 40, 5200009000)
    """

    first, second, step_ns = "interface", "kernel", STEP_NS
    """Names of the clocks, and what shows a step."""

    def __init__(self) -> None:
        self._pairs: deque[tuple[int, int]] = deque(maxlen=KEPT)
        self._above = 0
        self.origin_ns, self.offset_ns, self.drift = 0, 0, 0.0
        self.error_ns, self.steps = float("nan"), 0

    @property
    def ready(self) -> bool:
        """Whether there are enough pairs for a map."""
        return len(self._pairs) >= LEAST

    def __call__(self, stamp_ns: int) -> int:
        """Convert a stamp of the first clock to one of the second."""
        return stamp_ns + self.offset_ns + round(self.drift * (stamp_ns - self.origin_ns))

    def report(self) -> dict[str, float | str]:
        """Source of the stamps; where that is the first clock, error, drift and steps as well."""
        if not self.ready:
            return {"by": self.second}
        return {"by": self.first, "error_ns": self.error_ns, "drift_ppm": 1e6 * self.drift,
                "steps": self.steps}  # fmt: skip

    def learn(self, stamp_ns: int, late_ns: int) -> None:
        """Add the pair of a segment with the smallest delay: stamps of one event by both clocks.

        Where a clock was set, earlier pairs are dropped.
        """
        if len(self._pairs) >= LEAST:
            off = late_ns - self(stamp_ns)
            self._above = self._above + 1 if off > self.step_ns else 0
            if off < -self.step_ns or self._above >= STEPPED:
                self._forget()
        if self._pairs and stamp_ns <= self._pairs[-1][0]:
            self._forget()  # the first clock was reset
        self._pairs.append((stamp_ns, late_ns))
        if len(self._pairs) >= LEAST:
            self._fit()

    def _forget(self) -> None:
        self._pairs.clear()
        self._above, self.error_ns = 0, float("nan")
        self.steps += 1

    def _fit(self) -> None:
        """The edge of the lower convex hull over the mean time: the line below all pairs that is
        nearest to them."""
        self.origin_ns = self._pairs[0][0]
        first_ns = self._pairs[0][1] - self.origin_ns
        x = np.array([stamp - self.origin_ns for stamp, _ in self._pairs], float)
        y = np.array([late - stamp - first_ns for stamp, late in self._pairs], float)
        hull: list[int] = []
        for i in range(x.size):
            while len(hull) > 1 and _turns_right(x, y, hull[-2], hull[-1], i):
                hull.pop()
            hull.append(i)
        middle = x.mean()
        k = next(k for k, i in enumerate(hull[1:], 1) if x[i] >= middle)
        i, j = hull[k - 1], hull[k]
        self.drift = float(np.clip((y[j] - y[i]) / (x[j] - x[i]), -FASTEST, FASTEST))
        low = y - self.drift * x
        self.offset_ns = first_ns + round(float(low.min()))
        self.error_ns = 1.4826 * float(np.median(low - low.min()))


class DriverClock(ClockModel):
    """Maps the stamps of an adapter's driver to this host's clock, from the arrival of each frame.

    Its clock may begin at any time, wrap, be set, or be none: stamps are the times of arrival until
    the clock has shown itself to be one, and never later than these.
    """

    first, second, step_ns = "driver", "host", 50_000_000
    """An arrival is late by what keeps this process from reading [assumed]."""

    def __init__(self) -> None:
        super().__init__()
        self._wrapped_ns = self._newest_ns = self._heard_ns = self._last_ns = self._begun_ns = 0
        self._best: tuple[int, int] | None = None
        self._tick_ns, self._has_equal = 0, False

    @property
    def ready(self) -> bool:
        """Whether there is a map, and the first clock is one: not of another rate, which leaves
        errors as long as the map, and not coarser than the frames that it stamps."""
        is_coarse = self._has_equal and self._tick_ns > STEP_NS
        if len(self._pairs) < LEAST or is_coarse:
            return False
        return self.error_ns < (self._pairs[-1][0] - self._pairs[0][0]) / 64

    def stamp(self, driver_ns: int, now_ns: int) -> int:
        """The time of a frame on this host's clock, by the driver (0: none) and at its arrival."""
        mapped_ns = now_ns
        if driver_ns:
            raw = self._unwrapped(driver_ns, now_ns)
            self._take(raw, now_ns)
            mapped_ns = self(raw) if self.ready else now_ns
        # in the order of the bus, also where the map begins or ends; not if this host's was set
        self._last_ns = min(now_ns, max(mapped_ns, self._last_ns))
        return self._last_ns

    def _unwrapped(self, driver_ns: int, now_ns: int) -> int:
        """The stamp of a counter that has not wrapped: a step back is one where it is the range of
        a counter, after the time since the last frame."""
        back_ns = self._newest_ns - driver_ns - self._wrapped_ns
        if self._heard_ns and back_ns > STEP_NS:
            range_ns = back_ns + now_ns - self._heard_ns
            wrap_ns = min(WRAPS_NS, key=lambda wrap_ns: abs(wrap_ns - range_ns))
            if abs(wrap_ns - range_ns) < wrap_ns // 64:  # the nearest other one is a third off
                self._wrapped_ns += wrap_ns
        return driver_ns + self._wrapped_ns

    def _take(self, raw: int, now_ns: int) -> None:
        """Learn from a frame; the pair with the least delay of a segment counts."""
        step_ns = raw - self._newest_ns
        if self._heard_ns:
            # a float of seconds since 1970 has 0.2 µs
            self._tick_ns = math.gcd(self._tick_ns, abs(round(step_ns, -3)))
            self._has_equal |= step_ns == 0
        if step_ns < -STEP_NS or (self.ready and self(raw) - now_ns > self.step_ns):
            self._best = None
            if self._pairs:
                self._forget()
        self._newest_ns, self._heard_ns = raw, now_ns
        if self._best is None or now_ns - self(raw) < self._best[1] - self(self._best[0]):
            self._best = raw, now_ns
        if not 0 <= now_ns - self._begun_ns < SEGMENT_NS:
            self.learn(*self._best)
            self._begun_ns, self._best = now_ns, None


def _turns_right(x: np.ndarray, y: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether b is on or above the line from a to c."""
    return (y[b] - y[a]) * (x[c] - x[a]) >= (y[c] - y[a]) * (x[b] - x[a])
