"""Colours of units: quantities, their scales, and the colours of units without a reading.

The scale is cividis: it runs from dark blue to yellow, and colour-blind readers see nearly the same
(Nuñez, Anderton, Renslow 2018, doi:10.1371/journal.pone.0199239). Units that are not valid have a
colour that is not on the scale for any reader, and a cross.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skin.cividis import cividis
from skin.state import INVALID, Status

__all__ = [
    "INVALID_COLOUR", "OFF_COLOUR", "OFF_SIZE", "QUANTITIES", "Quantity", "Scale", "colours",
    "is_bad", "is_on", "rendered", "valid",
]  # fmt: skip

INVALID_COLOUR = (120, 220, 240)
"""Colour of units that are not valid."""
OFF_COLOUR, OFF_SIZE = (20, 23, 27), 0.4
"""Units that the topology switches off are a dot on their rim: grey is the middle of the scale."""


class Quantity(NamedTuple):
    """A quantity that units are coloured by."""

    label: str
    unit: str
    values: Callable[[np.void], np.ndarray]
    """From a snapshot to values, shape (n,)."""
    least: float
    """Smallest width of the scale."""
    from_zero: bool = True
    """Whether the scale starts at 0."""


def valid(record: np.void) -> np.ndarray:
    """Valid units, shape (n,), bool."""
    return record["status"] & int(INVALID) == 0


def is_on(status: np.ndarray) -> np.ndarray:
    """Units that are enabled in the topology, shape (n,), bool."""
    on: np.ndarray = status & int(Status.DISABLED) == 0
    return on


def is_bad(status: np.ndarray) -> np.ndarray:
    """Units that are enabled and not valid, shape (n,), bool."""
    return is_on(status) & (status & int(INVALID) != 0)


QUANTITIES = {
    quantity.label: quantity
    for quantity in (
        Quantity("load", "N", lambda record: record["force"][2], 1.0),
        Quantity("shear", "N", lambda record: np.hypot(*record["force"][:2]), 0.5),
        Quantity("temperature", "°C", lambda record: record["temperature"], 4.0, False),
        Quantity("sigma of the load", "N", lambda record: record["force_sigma"][2], 0.01),
        Quantity("test ratio", "", lambda record: record["test_ratio"], 1.0),
    )
}
"""By their labels in the view."""


class Scale:
    """The ends of a scale, which grow with the values shown, between round numbers.

    Parameters
    ----------
    least : float
        Smallest width.
    from_zero : bool
        Whether it starts at 0.

    Examples
    --------
    >>> scale = Scale(1.0)
    >>> scale.widen(np.array([0.2, 3.1, np.nan]))
    >>> scale.low, scale.high
    (0.0, 4.0)
    """

    def __init__(self, least: float, from_zero: bool = True) -> None:
        self._least, self._from_zero = least, from_zero
        self.reset()

    def reset(self) -> None:
        """Reset to the smallest width."""
        self.low, self.high = 0.0, self._least
        self._lowest, self._highest = np.inf, -np.inf

    def widen(self, values: np.ndarray) -> None:
        """Include values, shape (m,); NaN are left out."""
        values = values[np.isfinite(values)]
        if not values.size:
            return
        lowest, highest = float(values.min()), float(values.max())
        if self._lowest <= lowest and highest <= self._highest:
            return
        self._lowest, self._highest = min(self._lowest, lowest), max(self._highest, highest)
        if self._from_zero:
            self.high = round_above(max(self._highest, self._least))
            return
        step = round_above(max(self._highest - self._lowest, self._least)) / 4.0
        self.low = float(step * np.floor(self._lowest / step))
        self.high = float(step * (np.floor(self._highest / step) + 1.0))


def round_above(value: float) -> float:
    """The smallest of 1, 1.5, 2, 3, 4, 5, 6, 8, 10 that is not below a value, in any decade.

    Examples
    --------
    >>> round_above(3.1), round_above(0.02), round_above(60.0)
    (4.0, 0.02, 60.0)
    """
    decade = 10.0 ** np.floor(np.log10(value) + 1e-9)
    steps = decade * np.array([1, 1.5, 2, 3, 4, 5, 6, 8, 10])
    return float(steps[steps >= 0.999999 * value][0])


def colours(values: np.ndarray, is_valid: np.ndarray, low: float, high: float) -> np.ndarray:
    """Colours of units.

    Parameters
    ----------
    values : ndarray, shape (n,)
    is_valid : ndarray, shape (n,), bool
        Others, and NaN, have `INVALID_COLOUR`.
    low, high : float
        Ends of the scale; values beyond are clipped.

    Returns
    -------
    ndarray, shape (n, 3), uint8
        Red, green, blue.
    """
    is_shown = is_valid & np.isfinite(values)
    share = np.clip((np.where(is_shown, values, low) - low) / (high - low), 0.0, 1.0)
    return np.where(is_shown[:, np.newaxis], np.rint(cividis(share)), INVALID_COLOUR).astype(
        np.uint8
    )


def rendered(colours: np.ndarray) -> np.ndarray:
    """Colours for the renderer that appear about as the given ones in the lights of the view.

    three.js applies lights and the film curve ACES, by which a yellow would appear olive. This fit
    to their inverse is within 10 of 255 up to three quarters of the scale, and gives a paler yellow
    at its end, which the curve cannot reach [calibrated: viser 1.1].

    Parameters
    ----------
    colours : ndarray, shape (…, 3), uint8
        sRGB.

    Returns
    -------
    ndarray, shape (…, 3), uint8
        Linear light: 255 is the maximum.
    """
    share = np.asarray(colours, float) / 255.0
    return np.rint(255.0 * (0.194 * share**1.16 + 0.434 * share**4)).astype(np.uint8)
