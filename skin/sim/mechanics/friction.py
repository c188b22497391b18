"""Friction of faces: coefficients per face and time, and the extent of slip."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bus.compiled.jit import compiled

__all__ = ["Coefficient", "Friction", "Slip"]

Coefficient = float | np.ndarray | Callable[[float], float | np.ndarray]
"""One number, one for each unit, or either as a function of the time in seconds."""

GROSS = 0.95
"""Fraction of the load that has slipped above which the contact is in gross slip; it never reaches
1, since a moving body always meets new faces."""


class Friction:
    """Coulomb friction of n faces, static and kinetic.

    Parameters
    ----------
    n : int
    static : float, ndarray of shape (n,), or function of the time
        Static coefficient.
    kinetic : float, ndarray of shape (n,), or function of the time, optional
        Kinetic coefficient, at most the static one; equal to it if None.

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
        for row, value in zip(self._now, (self._static, self._kinetic), strict=True):
            row[:] = value(time_s) if callable(value) else value


class Slip:
    """Extent of slip of a contact since it began to stick.

    A contact begins to stick when it begins, and again when no face moves after gross slip.

    Attributes
    ----------
    slipped : ndarray, shape (n,), bool
        Loaded faces that have moved since.
    share : float
        Their fraction of the load.
    """

    def __init__(self, n: int) -> None:
        self.slipped = np.zeros(n, bool)
        self.share = 0.0
        self._gross = False

    def follow(self, load: np.ndarray, slipping: np.ndarray) -> None:
        """Process a step, with the loads and moving faces at its end."""
        if self._gross and not slipping.any():
            self.slipped[:] = self._gross = False
        self.share = _share(load, slipping, self.slipped)
        if not self.share >= 0.0:
            self.share = 0.0
            self.slipped[:] = self._gross = False
        self._gross |= self.share >= GROSS


def _share_python(load, slipping, slipped):
    """Fraction of the load on faces that have slipped, which are added to `slipped`; or NaN."""
    total = moved = 0.0
    for i in range(load.size):
        slipped[i] = (slipped[i] or slipping[i]) and load[i] > 0.0
        total += load[i]
        moved += load[i] if slipped[i] else 0.0
    return moved / total


_share = compiled(_share_python)
