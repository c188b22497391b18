"""Root finding in one unknown, or in a few, each trial of which is a step of the mechanics.

Not by scipy: its methods for one unknown ask for a bracket, where the step before tells a place and
a slope; its hybrid method for several gives up where faces begin to slip.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

__all__ = ["balance", "root"]

TRIALS = 100
"""More trials than any contact needs."""

HALVINGS = 12
"""A step this often halved and still no better is given up."""


def root(
    function: Callable[[float], float],
    x: float,
    slope: float,
    *,
    tolerance: float,
    first_step: float,
    furthest: float,
) -> tuple[float, float] | None:
    """Zero of a function that never falls, and its slope there: secants within a bracket.

    Parameters
    ----------
    function : callable
    x, slope : float
        First guesses; a slope of 0 if there is none.
    tolerance : float
        Of the function's value.
    first_step : float
        Where nothing is known of the slope; doubled as long as that is so.
    furthest : float
        Where the search ends.

    Returns
    -------
    tuple of float, or None
        None if there is no zero within reach.

    Examples
    --------
    >>> found = root(
    ...     lambda x: max(x - 1, 0) - 2, 0.5, 0.0, tolerance=1e-9, first_step=0.1, furthest=10
    ... )
    >>> round(found[0], 6)
    3.0
    """
    low, high = -math.inf, math.inf
    x_before, y_before = math.nan, math.nan
    for _ in range(TRIALS):
        y = function(x)
        if abs(y) <= tolerance:
            return x, slope
        if math.isfinite(x_before):
            slope = max((y - y_before) / (x - x_before), 0.0)
        low, high = (x, high) if y < 0.0 else (low, x)
        x_before, y_before = x, y
        new = x - y / slope if slope > 0.0 else math.inf
        if not low < new < high:
            new = 0.5 * (low + high)
        if not math.isfinite(new):
            new = x - math.copysign(first_step, y)
            first_step *= 2.0
        if new == x or abs(new) > furthest:
            return None
        x = new
    return None


def balance(
    lacking: Callable[[np.ndarray], np.ndarray],
    stiffness: Callable[[], np.ndarray],
    guess: np.ndarray | None,
    unknowns: int,
    *,
    tolerance: float,
    longest: float,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Displacements at which nothing is lacking: Newton steps with Broyden's corrections.

    Parameters
    ----------
    lacking : callable
        What is lacking, shape (m,), at displacements, shape (m,).
    stiffness : callable
        How much of it a displacement makes up for, shape (m, m), where `lacking` was asked last.
    guess : ndarray, shape (m, m), or None
        The stiffness to begin with, from an earlier balance nearby.
    unknowns : int
        m.
    tolerance, longest : float
        Of everything that is lacking; longest step.

    Returns
    -------
    tuple of ndarray, shapes (m,) and (m, m), or None
        Displacements, of which `lacking` was asked last, and stiffness; None if none were found.

    Examples
    --------
    >>> found = balance(
    ...     lambda x: np.array([3.0, 4.0]) - x - x**3, lambda: np.eye(2), None, 2,
    ...     tolerance=1e-9, longest=1.0,
    ... )
    >>> found[0].round(6)
    array([1.213412, 1.378797])
    """
    x = np.zeros(unknowns)
    y = lacking(x)
    fresh = guess is None
    matrix = stiffness() if guess is None else guess
    for _ in range(TRIALS):
        if np.abs(y).max() <= tolerance:
            return x, matrix
        better = _step(lacking, matrix, x, y, longest)
        if better is not None:
            step, new = better
            # what the step has taught: stiffer or softer than thought, that way
            matrix = matrix + np.outer(y - new - matrix @ step, step) / (step @ step)
            x, y, fresh = x + step, new, False
        elif fresh:
            return None
        else:
            lacking(x)
            matrix, fresh = stiffness(), True
    return None


def _step(
    lacking: Callable[[np.ndarray], np.ndarray],
    matrix: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    longest: float,
) -> tuple[np.ndarray, np.ndarray] | None:
    """A step after which less is lacking than `y`, and what then is; None if there is none."""
    try:
        step = np.linalg.solve(matrix, y)
    except np.linalg.LinAlgError:
        return None
    step *= min(1.0, longest / np.abs(step).max())
    for _ in range(HALVINGS):
        new = lacking(x + step)
        if np.abs(new).max() < np.abs(y).max():
            return step, new
        step = 0.5 * step
    return None
