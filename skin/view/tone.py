"""Colours for the renderer, corrected so that a browser shows the intended ones.

The renderer applies lights and maps the result with the film curve ACES, in the fit of Stephen
Hill, as in three.js (`ACESFilmicToneMapping`): a yellow of the scale would appear olive. This is
the inverse. Colours that are brighter or more saturated than the curve allows are approximated.
"""

from __future__ import annotations

import functools

import numpy as np

from skin.view.colour import INVALID_COLOUR, colours

__all__ = ["AMBIENT", "DIRECTED", "given", "given_colours", "given_to_mesh"]

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


def given(colours: np.ndarray) -> np.ndarray:
    """Colours for the renderer that appear as the given ones.

    Parameters
    ----------
    colours : ndarray, shape (…, 3), uint8
        sRGB.

    Returns
    -------
    ndarray, shape (…, 3), uint8
        Linear light: 255 is the maximum.
    """
    seen = np.clip(linear(colours) @ TO_SEEN, 0.0, BRIGHTEST)
    a, b, c, d, e = SHOULDER
    # the fit is a quotient of two parabolas: its inverse is the root of one
    p, q, r = 1.0 - c * seen, a - d * seen, -(b + e * seen)
    film = (-q + np.sqrt(q**2 - 4.0 * p * r)) / (2.0 * p)
    lit = np.clip(film @ TO_LIGHT, 0.0, None)
    return np.rint(255.0 * np.clip(lit / (EXPOSURE * LIT), 0.0, 1.0)).astype(np.uint8)


def given_to_mesh(colour: tuple[int, int, int]) -> tuple[int, ...]:
    """`given` of the one colour of a mesh, which the renderer takes as sRGB."""
    light = given(np.array(colour, np.uint8)) / 255.0
    share = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
    return tuple(np.rint(255.0 * share).astype(int).tolist())


SHADES = 1024
"""Precomputed steps of the scale: four for each of a display."""


@functools.cache
def _shades() -> np.ndarray:
    """Renderer colours for even steps of the scale, then for units that are not valid."""
    steps = colours(np.linspace(0.0, 1.0, SHADES), np.ones(SHADES, bool), 0.0, 1.0)
    return given(np.concatenate([steps, np.array([INVALID_COLOUR], np.uint8)]))


def given_colours(values: np.ndarray, is_valid: np.ndarray, low: float, high: float) -> np.ndarray:
    """`given` of `skin.view.colour.colours`, to a step of a display, in a few operations.

    Examples
    --------
    >>> load, sure = np.array([0.0, 4.0, np.nan, 1.0]), np.array([True, True, True, False])
    >>> bool((given_colours(load, sure, 0.0, 4.0) == given(colours(load, sure, 0.0, 4.0))).all())
    True
    """
    share = (values - low) * ((SHADES - 1) / (high - low))
    at = np.fmin(np.fmax(share, 0.0), SHADES - 1)
    is_shown = is_valid & np.isfinite(values)
    return _shades()[np.where(is_shown, at + 0.5, SHADES).astype(np.intp)]


def linear(colours: np.ndarray) -> np.ndarray:
    """Linear light of 8-bit sRGB colours."""
    share = np.asarray(colours, float) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
