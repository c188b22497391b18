"""Friction of faces: coefficients that may differ and change, and how far a contact has slipped."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bus.compiled.jit import compiled

__all__ = ["Coefficient", "Friction", "Slip"]

Coefficient = float | np.ndarray | Callable[[float], float | np.ndarray]
"""One number, one for each unit, or either as a function of the time in seconds."""

GROSS = 0.95
"""Share of the load that has slipped, beyond which the contact as a whole moves; all of it never
does, because a moving body always meets new faces."""


class Friction:
    """Coulomb friction of n faces, at rest and in motion.

    Parameters
    ----------
    n : int
    static : float, ndarray of shape (n,), or function of the time
        Coefficient up to which a face is held.
    kinetic : float, ndarray of shape (n,), or function of the time, optional
        Coefficient of a face in motion, not more than at rest; as at rest if None.

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
    """How far the slip of a contact has gone since it began to stick.

    A contact begins to stick when it begins, and anew when after gross slip no face moves.

    Attributes
    ----------
    slipped : ndarray, shape (n,), bool
        Loaded faces that have moved since.
    share : float
        Their share of the load.
    """

    def __init__(self, n: int) -> None:
        self.slipped = np.zeros(n, bool)
        self.share = 0.0
        self._gross = False

    def follow(self, load: np.ndarray, slipping: np.ndarray) -> None:
        """Go on by one step, at whose end the loads and the moving faces are these."""
        if self._gross and not slipping.any():
            self.slipped[:] = self._gross = False
        self.share = _share(load, slipping, self.slipped)
        if not self.share >= 0.0:
            self.share = 0.0
            self.slipped[:] = self._gross = False
        self._gross |= self.share >= GROSS


def _share_python(load, slipping, slipped):
    """Share of the load on faces that have slipped, to which `slipped` goes on; or NaN."""
    total = moved = 0.0
    for i in range(load.size):
        slipped[i] = (slipped[i] or slipping[i]) and load[i] > 0.0
        total += load[i]
        moved += load[i] if slipped[i] else 0.0
    return moved / total


_share = compiled(_share_python)
