"""ClockModel: the map from an interface's own clock to the kernel's.

Stamps by a controller are accurate to a few microseconds, but its clock has an unknown offset and
its own rate; the kernel's stamp is of a known clock, but late by an interrupt, a queue, a USB
transfer. The delay is never negative: the map is the line below all pairs of stamps that is nearest
to them [Moon, Skelly, Towsley, INFOCOM 1999]. The smallest delay cannot be distinguished from the
offset and remains in it.
"""

from __future__ import annotations

from collections import deque

import numpy as np

__all__ = ["ClockModel"]

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
            return {"by": "kernel"}
        return {"by": "interface", "error_ns": self.error_ns, "drift_ppm": 1e6 * self.drift,
                "steps": self.steps}  # fmt: skip

    def learn(self, stamp_ns: int, late_ns: int) -> None:
        """Add the pair of a segment with the smallest delay: stamps of one event by both clocks.

        Where a clock was set, earlier pairs are dropped.
        """
        if len(self._pairs) >= LEAST:
            off = late_ns - self(stamp_ns)
            self._above = self._above + 1 if off > STEP_NS else 0
            if off < -STEP_NS or self._above >= STEPPED:
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


def _turns_right(x: np.ndarray, y: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether b is on or above the line from a to c."""
    return (y[b] - y[a]) * (x[c] - x[a]) >= (y[c] - y[a]) * (x[b] - x[a])
