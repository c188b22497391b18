"""Colours of units: what is shown, on which scale, and what stands outside of it.

The scale is cividis: it runs from dark blue to yellow, and looks nearly the same to the
colour-blind (Nuñez, Anderton, Renslow 2018, doi:10.1371/journal.pone.0199239). Units that must not
be trusted have a colour that is not on it for anybody, and a cross.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skin.state import INVALID
from topology import CHANNELS

__all__ = ["CIVIDIS", "INVALID_COLOUR", "QUANTITIES", "Quantity", "Range", "colours", "valid"]

CIVIDIS = np.array([
    (0, 34, 78), (0, 40, 91), (0, 46, 106), (5, 51, 113), (26, 56, 111),
    (39, 62, 110), (50, 67, 109), (59, 73, 108), (67, 78, 108), (75, 84, 108),
    (83, 90, 109), (90, 95, 110), (97, 101, 111), (104, 106, 113), (111, 112, 115),
    (118, 118, 118), (125, 124, 120), (132, 130, 121), (140, 136, 120), (147, 142, 120),
    (155, 148, 118), (163, 154, 116), (171, 160, 114), (180, 167, 111), (188, 174, 108),
    (196, 180, 104), (205, 187, 99), (213, 194, 94), (222, 201, 88), (231, 209, 80),
    (240, 216, 70), (249, 224, 58), (254, 232, 56),
], np.uint8)  # fmt: skip
"""Colours at even steps of the scale."""

INVALID_COLOUR = (120, 220, 240)
"""Of units that must not be trusted."""


class Quantity(NamedTuple):
    """Something that units are coloured by."""

    label: str
    unit: str
    values: Callable[[np.void], np.ndarray]
    """From a snapshot, shape (n,)."""
    least: float
    """Width of the scale, at least."""
    from_zero: bool
    """Whether the scale begins at 0."""


def valid(record: np.void) -> np.ndarray:
    """Units that may be trusted, shape (n,), bool."""
    return record["status"] & int(INVALID) == 0


def _shear(record: np.void) -> np.ndarray:
    return np.hypot(record["force"][0], record["force"][1])


def _row(c: int) -> Callable[[np.void], np.ndarray]:
    return lambda record: record["counts"][c].astype(np.float32)


QUANTITIES = {
    quantity.label: quantity
    for quantity in (
        Quantity("load", "N", lambda record: record["force"][2], 1.0, True),
        Quantity("shear", "N", _shear, 0.5, True),
        Quantity("temperature", "°C", lambda record: record["temperature"], 4.0, False),
        Quantity("sigma of the load", "N", lambda record: record["sigma"], 0.01, True),
        Quantity("test ratio", "", lambda record: record["test_ratio"], 1.0, True),
        Quantity("validity", "", lambda record: valid(record).astype(np.float32), 1.0, True),
        *(
            Quantity(f"raw {name}", "counts", _row(c), 10.0, False)
            for c, name in enumerate(CHANNELS)
        ),
    )
}
"""By the label that the view shows."""


class Range:
    """The scale of a quantity: wide enough for all that was shown, between round numbers.

    Examples
    --------
    >>> scale = Range(QUANTITIES["load"])
    >>> scale.widen(np.array([0.2, 3.1, np.nan]))
    True
    >>> scale.low, scale.high
    (0.0, 4.0)
    """

    def __init__(self, quantity: Quantity) -> None:
        self._quantity = quantity
        self.reset()

    def reset(self) -> None:
        """Forget what was shown."""
        self.low, self.high = 0.0, self._quantity.least
        self._is_fresh = not self._quantity.from_zero

    def widen(self, values: np.ndarray) -> bool:
        """Take in values, shape (m,), of units that may be trusted; True where that changed it."""
        is_wide = not self._is_fresh and values.size > 0
        if (
            is_wide
            and np.fmax.reduce(values) <= self.high
            and (self._quantity.from_zero or np.fmin.reduce(values) >= self.low)
        ):
            return False
        values = values[np.isfinite(values)]
        if not values.size:
            return False
        before = self.low, self.high
        low, high = float(values.min()), float(values.max())
        if not self._is_fresh and self.low <= low and high <= self.high:
            return False
        if self._quantity.from_zero:
            self.high = max(self.high, round_above(high))
        else:
            if not self._is_fresh:
                low, high = min(low, self.low), max(high, self.high)
            self._is_fresh = False
            step = round_above(max(high - low, self._quantity.least)) / 4.0
            self.low, self.high = step * np.floor(low / step), step * np.ceil(high / step)
            if self.high <= self.low:
                self.high = self.low + step
        return (self.low, self.high) != before


STEPS = (1, 1.5, 2, 3, 4, 5, 6, 8, 10)


def round_above(value: float) -> float:
    """The least of 1, 1.5, 2, 3, 4, 5, 6, 8, 10 that is not below a value, in any decade.

    Examples
    --------
    >>> round_above(3.1), round_above(0.02), round_above(60.0)
    (4.0, 0.02, 60.0)
    """
    if value <= 0.0:
        return 0.0
    decade = 10.0 ** np.floor(np.log10(value) + 1e-9)
    return float(next(step * decade for step in STEPS if step * decade >= value * 0.999999))


def colours(values: np.ndarray, is_valid: np.ndarray, low: float, high: float) -> np.ndarray:
    """Colours of units.

    Parameters
    ----------
    values : ndarray, shape (n,)
    is_valid : ndarray, shape (n,), bool
        Others have `INVALID_COLOUR`, and so has a value that is NaN.
    low, high : float
        Ends of the scale; what is beyond them has the colour of the end.

    Returns
    -------
    ndarray, shape (n, 3), uint8
        Red, green, blue.
    """
    is_shown = is_valid & np.isfinite(values)
    share = np.clip((np.where(is_shown, values, low) - low) / (high - low), 0.0, 1.0)
    at = share * (len(CIVIDIS) - 1)
    whole = np.minimum(at.astype(int), len(CIVIDIS) - 2)
    rest = (at - whole)[:, np.newaxis]
    mixed = (1.0 - rest) * CIVIDIS[whole] + rest * CIVIDIS[whole + 1]
    return np.where(is_shown[:, np.newaxis], np.rint(mixed), INVALID_COLOUR).astype(np.uint8)
