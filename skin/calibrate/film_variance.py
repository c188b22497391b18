"""The variance of a film's displacement over the range, such that a sigma holds its share.

What a film's model cannot follow is no noise: it is the same in every reading of a pose, it waves
around the film, and it is least in the middle of the range. Its mean square alone would therefore
promise too much at the ends and too little between them. What is fitted is what a sigma means: over
all directions, as many errors of single readings lie within it as of a normal distribution.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.special import erf, ndtr

__all__ = ["Scatter", "fit_variance"]

SHARE = float(erf(2.0**-0.5))
"""Of a normal distribution, within one sigma [derived]."""
READINGS_LEAST = 2.0
"""Readings of a pose, below which its noise hides the film's own errors [assumed]."""


class Scatter(NamedTuple):
    """What is left of a scan of t poses, along and across the commanded direction."""

    residual: np.ndarray  # (2, t) mm
    noise: np.ndarray  # (2, t) mm, one sigma of the mean of a pose
    own: np.ndarray  # (2, t) mm², of the fit's covariance


def fit_variance(
    scatter: Scatter, along: np.ndarray, depth_mm: np.ndarray, displacement_mm: np.ndarray,
    flat_mm2: float, noisier: float,
) -> np.ndarray:  # fmt: skip
    """Variance across the displacement without its noise, ``sum c[2 i + j] R^(3 i) H^(2 j)``, mm².

    Parameters
    ----------
    scatter : Scatter
    along : ndarray, shape (2, t)
        Commanded direction.
    depth_mm, displacement_mm : ndarray, shape (t,)
    flat_mm2 : float
        The same over the whole range: the start.
    noisier : float
        Noise of a single reading over that of a pose.

    Returns
    -------
    ndarray, shape (6,)
    """
    flat = np.append(flat_mm2, np.zeros(5))
    if noisier**2 < READINGS_LEAST:
        return flat
    # components along x and y, as they are reported: each a part along and a part across
    mixed = np.stack([along, along[::-1]]) ** 2
    residual = np.stack([along[0], along[1]]) * scatter.residual[0]
    residual += np.stack([-along[1], along[0]]) * scatter.residual[1]
    noise2 = np.einsum("abt,bt->at", mixed, scatter.noise**2)
    # the film's errors are such of its field: along, they count as much less as its noise does
    ratio2 = (scatter.noise[0] / scatter.noise[1]) ** 2
    counts = np.einsum("abt,bt->at", mixed, np.stack([ratio2, np.ones_like(ratio2)]))
    own = np.einsum("abt,bt->at", mixed, scatter.own)
    # the residual holds a pose's noise already, less what the fit took up of it
    rest = np.sqrt(noise2 * (noisier**2 - 1.0) + 2.0 * own)
    longest, deepest = displacement_mm.max(), depth_mm.max()
    rising = (displacement_mm / longest) ** (3 * np.arange(3)[:, np.newaxis])
    pressed = (depth_mm / deepest) ** (2 * np.arange(2)[:, np.newaxis])
    terms = (rising[:, np.newaxis] * pressed).reshape(6, -1)
    _, cell = np.unique(np.stack([depth_mm, displacement_mm]), axis=1, return_inverse=True)
    size = 2.0 * np.bincount(cell)

    def missing(share: np.ndarray) -> np.ndarray:
        """By how much each cell of depth and displacement misses the share."""
        sigma = np.sqrt(noise2 * noisier**2 + counts * np.maximum(flat_mm2 * (share @ terms), 0.0))
        held = ndtr((sigma - residual) / rest) - ndtr((-sigma - residual) / rest)
        return np.bincount(cell, held.sum(axis=0)) / size - SHARE

    found = least_squares(missing, flat / flat_mm2).x * flat_mm2
    unit = np.outer(longest ** (-3.0 * np.arange(3)), deepest ** (-2.0 * np.arange(2)))
    return found * unit.ravel()
