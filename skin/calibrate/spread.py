"""What a law is off by, from the errors that go on from sample to sample.

Neighbouring samples share what a law of another form is off by, and noise is each sample's own: the
mean of the products of neighbours is the variance of the first without the second.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import optimize
from scipy.special import ndtr

__all__ = ["Spread", "even_spread", "law_spread"]

BINS = 24
"""Of samples by their force, as many in each."""
TRIED = 49
"""Shares and absolute parts that are tried, each over the factor `LARGEST`."""
LARGEST = 1e3
ONE_SIGMA = 0.6826894921370859
"""Of normal errors, within one sigma [derived]."""
SCALES = 0.6, 1.7
"""Bounds of one-sigma over root mean square: 0.96 for a sine, 0.68 / sqrt(3) of whose range lies
within [assumed: wider than any law's]."""


class Spread(NamedTuple):
    """One-sigma of a law: ``sqrt((relative F)² + min(absolute, F)²)``."""

    relative: float
    absolute: float


def even_spread(error: np.ndarray, noise: np.ndarray | float) -> float:
    """One-sigma of a law whose errors are as large everywhere.

    Parameters
    ----------
    error : ndarray, shape (t,)
        Neighbours are those that the law has in common.
    noise : ndarray, shape (t,), or float
        Of one reading, which adds to it.
    """
    misfit = float(np.sqrt(max(_products(error).mean(), 0.0)))
    return misfit * _scale(error, np.full(error.shape, misfit), noise)


def law_spread(error: np.ndarray, force: np.ndarray, noise: np.ndarray | float) -> Spread:
    """One-sigma of a law of the force, of a share of it and absolute.

    The two parts are those under which the errors are most probable, if they are normal; then both
    are scaled so that 68 % of the errors of readings lie within one sigma, for any
    distribution.

    Parameters
    ----------
    error, force : ndarray, shape (t,)
        Error of the law, and what it says, newton. Neighbours are those that have an error in
        common.
    noise : ndarray, shape (t,), or float
        Of one reading, which adds to the error of the law.
    """
    product, size = _products(error), np.abs(0.5 * (force[1:] + force[:-1]))
    noise2 = max(float(np.mean(error**2) - product.mean()), 0.0)
    groups = np.array_split(np.argsort(size, kind="stable"), min(BINS, size.size))
    count = np.array([at.size for at in groups])
    seen2 = np.array([product[at].mean() for at in groups])
    force2 = np.array([np.mean(size[at] ** 2) for at in groups])
    # what products of noise alone amount to: below it nothing is known
    least2 = noise2 / np.sqrt(count) + 1e-12
    told2 = np.maximum(seen2 + least2, 0.1 * least2)
    most_n = 3.0 * float(np.sqrt(told2.max()))
    steps = np.append(0.0, np.geomspace(1.0 / LARGEST, 1.0, TRIED))
    share = steps * min(most_n / max(float(np.sqrt(force2.mean())), 1e-9), 1.0)
    relative, absolute = (each.ravel() for each in np.meshgrid(share, most_n * steps))
    law2 = _variance(relative[:, np.newaxis], absolute[:, np.newaxis], force2) + least2
    best = int(np.argmin((count * (np.log(law2) + told2 / law2)).sum(axis=1)))
    found = Spread(float(relative[best]), float(absolute[best]))
    scale = _scale(error, np.sqrt(_variance(*found, force**2)), noise)
    return Spread(scale * found.relative, scale * found.absolute)


def _variance(
    relative: np.ndarray | float, absolute: np.ndarray | float, force2: np.ndarray
) -> np.ndarray:
    return relative**2 * force2 + np.minimum(absolute**2, force2)


def _products(error: np.ndarray) -> np.ndarray:
    centred = np.asarray(error, float)
    return centred[1:] * centred[:-1]


def _scale(error: np.ndarray, sigma: np.ndarray, noise: np.ndarray | float) -> float:
    """Of a sigma, so that of readings with that noise 68 % lie within."""
    if not sigma.any():
        return 1.0
    # a mean of neighbours has less noise, and is as large as the products say
    smooth = np.convolve(np.pad(error, 1, mode="edge"), np.full(3, 1.0 / 3.0), "valid")
    left = max(_products(error).mean(), 0.0) / max(float(np.mean(smooth**2)), 1e-30)
    smooth = np.abs(smooth) * min(float(np.sqrt(left)), 1.0)
    noise = np.maximum(np.broadcast_to(noise, smooth.shape), 1e-9)

    def missing(log_scale: float) -> float:
        total = np.hypot(np.exp(log_scale) * sigma, noise)
        inside = ndtr((total - smooth) / noise) - ndtr((-total - smooth) / noise)
        return float(inside.mean()) - ONE_SIGMA

    low, high = np.log(SCALES)
    if missing(low) >= 0.0 or missing(high) <= 0.0:
        return float(np.exp(low if missing(low) >= 0.0 else high))
    root: Any = optimize.brentq(missing, low, high, xtol=1e-3)
    return float(np.exp(root))
