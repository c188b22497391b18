"""Which of several laws predicts best what it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

__all__ = ["FOLDS", "PIECES", "cross_validated"]

PIECES = 40
"""Stretches of samples whose errors are taken for independent of each other [assumed]."""
FOLDS = 5


def cross_validated(
    orders: Sequence[Any],
    samples: int,
    error: Callable[[Any, np.ndarray], np.ndarray],
    margin: float = 1.0,
) -> Any:
    """The simplest of several laws that predicts what it has not seen as well as the best.

    As well: within `margin` standard errors of the differences, over `FOLDS` folds of `PIECES`
    stretches [Breiman 1984].

    Parameters
    ----------
    orders : sequence
        Simplest first.
    samples : int
    error : callable
        Order and training mask, shape (t,), to squared errors of the other samples.
    margin : float
    """
    fold = (np.arange(samples) * PIECES // samples) % FOLDS
    scores = np.array([[np.mean(error(order, fold != k)) for k in range(FOLDS)]
                       for order in orders])  # fmt: skip
    best = int(np.argmin(scores.mean(axis=1)))
    for index, order in enumerate(orders):
        worse = scores[index] - scores[best]
        limit = margin * worse.std(ddof=1) / np.sqrt(FOLDS)
        if worse.mean() <= limit + 1e-12 * scores[best].mean():
            return order
    return orders[best]
