"""Colours of units: quantity, scale, and the colour of units that are not valid.

The scale is cividis: it runs from dark blue to yellow, and colour-blind readers see nearly the same
(Nuñez, Anderton, Renslow 2018, doi:10.1371/journal.pone.0199239). Units that are not valid have a
colour that is not on the scale for any reader, and a cross.

The renderer of the browser applies lights and the film curve ACES, in the fit of Stephen Hill, as
in three.js (`ACESFilmicToneMapping`): a yellow of the scale would appear olive, and the picture
would not fit its legend. `rendered` is the inverse of both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skin.cividis import cividis
from skin.state import INVALID, Status
from topology import CHANNELS

__all__ = [
    "AMBIENT", "DIRECTED", "INVALID_COLOUR", "OFF_COLOUR", "QUANTITIES", "Quantity", "Range",
    "colours", "is_on", "rendered", "rendered_mesh", "valid",
]  # fmt: skip

INVALID_COLOUR = (120, 220, 240)
"""Colour of units that are not valid."""
OFF_COLOUR = (96, 102, 110)
"""Colour of units that the topology switches off."""


class Quantity(NamedTuple):
    """A quantity that units are coloured by."""

    label: str
    unit: str
    values: Callable[[np.void], np.ndarray]
    """From a snapshot to values, shape (n,)."""
    least: float
    """Smallest width of the scale."""
    from_zero: bool
    """Whether the scale starts at 0."""


def valid(record: np.void) -> np.ndarray:
    """Valid units, shape (n,), bool."""
    return record["status"] & int(INVALID) == 0


def is_on(status: np.ndarray) -> np.ndarray:
    """Units that are enabled in the topology, shape (n,), bool."""
    on: np.ndarray = status & int(Status.DISABLED) == 0
    return on


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
        Quantity("sigma of the load", "N", lambda record: record["force_sigma"][2], 0.01, True),
        Quantity("test ratio", "", lambda record: record["test_ratio"], 1.0, True),
        Quantity("validity", "", lambda record: valid(record).astype(np.float32), 1.0, True),
        *(
            Quantity(f"raw {name}", "counts", _row(c), 10.0, False)
            for c, name in enumerate(CHANNELS)
        ),
    )
}
"""By their labels in the view."""


class Range:
    """The scale of a quantity, which grows with the values shown, between round numbers.

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
        """Reset to the smallest width."""
        self.low, self.high = 0.0, self._quantity.least
        self._is_fresh = not self._quantity.from_zero

    def widen(self, values: np.ndarray) -> bool:
        """Include values, shape (m,), of valid units; True where the scale changed."""
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
    """The smallest of 1, 1.5, 2, 3, 4, 5, 6, 8, 10 that is not below a value, in any decade.

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


AMBIENT, DIRECTED = 4.3, 0.7
"""Lights: an even one, and one from above, which makes edges visible."""
LIT = AMBIENT + 0.8 * DIRECTED
"""Sum of both on a face towards the light [calibrated: a grey in viser 1.1]."""
EXPOSURE = 1.0 / (0.6 * np.pi)
"""Input of the curve over colour times light [derived: a matt face, and the exposure of the
fit]."""
BRIGHTEST = 0.85
"""Fraction of the curve's range. More needs more light, and leaves dark colours fewer steps of the
8 bits, which the renderer takes as light and not as sRGB [assumed]."""
TO_FILM = np.array([
    [0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777],
])  # fmt: skip
FROM_FILM = np.array([
    [1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602],
])  # fmt: skip
TO_SEEN, TO_LIGHT = np.linalg.inv(FROM_FILM).T, np.linalg.inv(TO_FILM).T
SHOULDER = (0.0245786, 0.000090537, 0.983729, 0.4329510, 0.238081)
"""a … e of (x (x + a) - b) / (x (c x + d) + e)."""


def rendered(colours: np.ndarray) -> np.ndarray:
    """Colours for the renderer that appear as the given ones; too bright or too saturated ones are
    approximated.

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
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    seen = np.clip(light @ TO_SEEN, 0.0, BRIGHTEST)
    a, b, c, d, e = SHOULDER
    # the fit is a quotient of two parabolas: its inverse is the root of one
    p, q, r = 1.0 - c * seen, a - d * seen, -(b + e * seen)
    film = (-q + np.sqrt(q**2 - 4.0 * p * r)) / (2.0 * p)
    lit = np.clip(film @ TO_LIGHT, 0.0, None)
    return np.rint(255.0 * np.clip(lit / (EXPOSURE * LIT), 0.0, 1.0)).astype(np.uint8)


def rendered_mesh(colour: tuple[int, int, int]) -> tuple[int, ...]:
    """`rendered` of the one colour of a mesh, which the renderer takes as sRGB."""
    light = rendered(np.array(colour, np.uint8)) / 255.0
    share = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
    return tuple(np.rint(255.0 * share).astype(int).tolist())
