"""Probe: whether something hangs between two pads or slides, told by gripping a little harder.

Where every face slides alike, no unit is ahead of the others, and slip does not show in them. But
friction then bears as much as it can: gripped harder, it bears more, while the weight of what hangs
stays as it is.
"""

from __future__ import annotations

__all__ = ["Probe"]

HARDER = 0.3
"""By which the grip rises [assumed: ten times the noise of a mean]."""

WAIT_S, MEAN_S, RISE_S = 0.15, 0.16, 0.2
"""Until the load is steady; what each mean is over; in which the grip rises [derived: 16 units have
0.05 N of noise, their mean over 40 cycles 0.008 N]."""

SLIDES = 0.12
"""Share of the grip's rise that the tangential load follows: 1 slides on, 0 has hung all along, and
what is between began to hang [derived: three sigma of two means of 0.6 N]."""


class Probe:
    """One question, asked again after every answer that it slides.

    Attributes
    ----------
    factor : float
        What the grip is to be multiplied by, now.
    hangs : bool
        The last answer.
    borne : float
        Ratio of the loads at which it hung, before the grip rose: friction is not less. 0 before.
    """

    def __init__(self, period_s: float) -> None:
        self.factor, self.hangs, self.borne = 1.0, False, 0.0
        self._period_s = period_s
        self._begin()

    def _begin(self) -> None:
        self._time_s, self.factor = 0.0, 1.0
        self._before, self._after = [0.0, 0.0, 0], [0.0, 0.0, 0]

    def update(self, load_n: float, shear_n: float) -> float | None:
        """Go on by a cycle; the ratio of the loads where it has been found to slide, else None."""
        self._time_s += self._period_s
        time_s = self._time_s - WAIT_S
        if time_s < 0.0:
            return None
        if time_s < MEAN_S:
            _add(self._before, load_n, shear_n)
            return None
        time_s -= MEAN_S
        self.factor = 1.0 + HARDER * min(time_s / RISE_S, 1.0)
        time_s -= RISE_S + WAIT_S
        if time_s < 0.0:
            return None
        _add(self._after, load_n, shear_n)
        if time_s < MEAN_S:
            return None
        (load, shear), (harder, dragged) = _mean(self._before), _mean(self._after)
        followed = (dragged - shear) / max(shear * (harder / load - 1.0), 1e-9)
        self._begin()
        self.hangs = followed < SLIDES
        if not self.hangs:
            return shear / load
        self.borne = shear / load
        return None


def _add(sums: list, load_n: float, shear_n: float) -> None:
    sums[0] += load_n
    sums[1] += shear_n
    sums[2] += 1


def _mean(sums: list) -> tuple[float, float]:
    return sums[0] / sums[2], sums[1] / sums[2]
