"""Root finding in one unknown, where each evaluation is a step of the mechanics.

scipy's methods need a bracket; here the step before provides a start and a slope.
"""

from __future__ import annotations

import math
from collections.abc import Callable

__all__ = ["root"]

TRIALS = 100
"""Upper bound of the number of evaluations."""


def root(
    function: Callable[[float], float],
    x: float,
    slope: float,
    *,
    tolerance: float,
    first_step: float,
    furthest: float,
) -> tuple[float, float] | None:
    """Zero of a non-decreasing function, and its slope there: secants within a bracket.

    Parameters
    ----------
    function : callable
    x, slope : float
        First guesses; a slope of 0 if there is none.
    tolerance : float
        Of the function's value.
    first_step : float
        Without a known slope; doubled until there is one.
    furthest : float
        Bound of the search.

    Returns
    -------
    tuple of float, or None
        None if there is no zero within the bound.

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
