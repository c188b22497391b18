"""Which of several laws predicts best what it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

__all__ = ["FOLDS", "PIECES", "cross_validated", "folds_of"]

PIECES = 40
"""Stretches of samples whose errors are taken for independent of each other [assumed]."""
FOLDS = 5


def folds_of(samples: int) -> np.ndarray:
    """Fold of each of so many samples: `FOLDS` of `PIECES` stretches, by turns."""
    return np.arange(samples) * PIECES // samples % FOLDS


def cross_validated(
    orders: Sequence[Any],
    folds: np.ndarray,
    error: Callable[[Any, np.ndarray], np.ndarray],
    margin: float = 1.0,
) -> tuple[Any, np.ndarray]:
    """The simplest of several laws that predicts what it has not seen as well as the best.

    As well: within `margin` standard errors of the differences over folds [Breiman 1984].

    Parameters
    ----------
    orders : sequence
        Simplest first.
    folds : ndarray, shape (t,), int
        Fold of each sample, from 0 (`folds_of`).
    error : callable
        Order and training mask, shape (t,), to squared errors of the other samples.
    margin : float

    Returns
    -------
    order : one of `orders`
    scores : ndarray, shape (orders, folds)
        Mean squared error of each fold.
    """
    count = int(folds.max()) + 1
    scores = np.array([[np.mean(error(order, folds != k)) for k in range(count)]
                       for order in orders])  # fmt: skip
    best = int(np.argmin(scores.mean(axis=1)))
    for index, order in enumerate(orders):
        worse = scores[index] - scores[best]
        limit = margin * worse.std(ddof=1) / np.sqrt(count)
        if worse.mean() <= limit + 1e-12 * scores[best].mean():
            return order, scores
    return orders[best], scores
