"""Colour scale of all pictures: cividis, from dark blue to yellow.

Its lightness grows evenly, and colour-blind readers see nearly the same (Nuñez, Anderton, Renslow
2018, doi:10.1371/journal.pone.0199239).
"""

from __future__ import annotations

import numpy as np

__all__ = ["CIVIDIS", "cividis"]

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


def cividis(share: np.ndarray | float) -> np.ndarray:
    """RGB from 0 to 255, shape (..., 3), for values from 0 to 1; others are clipped.

    Examples
    --------
    >>> cividis([0.0, 2.0]).tolist()
    [[0.0, 34.0, 78.0], [254.0, 232.0, 56.0]]
    """
    at = np.clip(share, 0.0, 1.0) * (len(CIVIDIS) - 1)
    steps = np.arange(len(CIVIDIS))
    return np.stack([np.interp(at, steps, column) for column in CIVIDIS.T], axis=-1)
