"""Friction of faces: coefficients that may differ and change, and how far a contact has slipped."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bus.compiled.jit import compiled
from skin.errors import OptionError

__all__ = ["ONSETS", "Coefficient", "Friction", "Slip"]

Coefficient = float | np.ndarray | Callable[[float], float | np.ndarray]
"""One number, one for each unit, or either as a function of the time in seconds."""

ONSETS = {"first": 0.0, "10 %": 0.1, "50 %": 0.5, "gross": 0.95}
"""Stages of slip: the share of the load that has slipped. Beyond 95 % the contact as a whole moves;
all of it never does, because a moving body always meets new faces."""


class Friction:
    """Coulomb friction of n faces, at rest and in motion.

    Parameters
    ----------
    n : int
    static : float, ndarray of shape (n,), or function of the time
        Coefficient up to which a face is held.
    kinetic : float, ndarray of shape (n,), or function of the time, optional
        Coefficient of a face in motion; as at rest if None.

    Raises
    ------
    OptionError
        If a coefficient is negative or not a number, or more in motion than at rest.

    Examples
    --------
    >>> dry = Friction(2, static=lambda time_s: 0.6 - 0.1 * time_s, kinetic=0.3)
    >>> dry.at(1.0)
    (array([0.5, 0.5]), array([0.3, 0.3]))
    """

    def __init__(
        self, n: int, static: Coefficient = 0.5, kinetic: Coefficient | None = None
    ) -> None:
        self._static, self._kinetic = static, static if kinetic is None else kinetic
        self._changes = callable(self._static) or callable(self._kinetic)
        self._now = np.empty((2, n))
        self._update(0.0)

    def at(self, time_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Static and kinetic coefficients, each of shape (n,), valid until the next call."""
        if self._changes:
            self._update(time_s)
        return self._now[0], self._now[1]

    def _update(self, time_s: float) -> None:
        for row, (name, value) in enumerate((("static", self._static), ("kinetic", self._kinetic))):
            self._now[row] = value(time_s) if callable(value) else value
            if not np.all(self._now[row] >= 0.0):
                raise OptionError(f"{name}: must be at least 0; got {self._now[row].min():g}")
        beyond = self._now[1] - self._now[0]
        if beyond.max(initial=0.0) > 0.0:
            worst = int(np.argmax(beyond))
            raise OptionError(
                f"kinetic: must not be more than static, {self._now[0, worst]:g}; "
                f"got {self._now[1, worst]:g}"
            )


class Slip:
    """How far the slip of a contact has gone since it began to stick.

    A contact begins to stick when it begins, and anew when after gross slip no face moves.

    Attributes
    ----------
    slipped : ndarray, shape (n,), bool
        Loaded faces that have moved since.
    share : float
        Their share of the load.
    onset_s : ndarray, shape (4,)
        When the share first passed each stage of `ONSETS`; NaN where it has not.
    """

    def __init__(self, n: int) -> None:
        self.slipped = np.zeros(n, bool)
        self.share = 0.0
        self.onset_s = np.full(len(ONSETS), np.nan)

    def follow(self, time_s: float, load: np.ndarray, slipping: np.ndarray) -> None:
        """Go on by one step, at whose end the loads and the moving faces are these."""
        if np.isfinite(self.onset_s[-1]) and not slipping.any():
            self._begin()
        self.share = _share(load, slipping, self.slipped)
        if not self.share >= 0.0:
            self.share = 0.0
            self._begin()
        if self.share > 0.0:
            for stage, share in enumerate(ONSETS.values()):
                if self.share >= share and np.isnan(self.onset_s[stage]):
                    self.onset_s[stage] = time_s

    def _begin(self) -> None:
        """Nothing has slipped yet."""
        self.slipped[:] = False
        self.onset_s[:] = np.nan


def _share_python(load, slipping, slipped):
    """Share of the load on faces that have slipped, to which `slipped` goes on; or NaN."""
    total = moved = 0.0
    for i in range(load.size):
        slipped[i] = (slipped[i] or slipping[i]) and load[i] > 0.0
        total += load[i]
        moved += load[i] if slipped[i] else 0.0
    return moved / total


_share = compiled(_share_python)
