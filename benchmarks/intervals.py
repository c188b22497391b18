"""95 % intervals of rates and of counts in a time."""

from __future__ import annotations

from scipy.stats import beta, chi2

__all__ = ["Rate", "per_minute", "rate"]

OUTSIDE = 0.05
"""Of 100 cases, 5 lie outside, 2.5 on each side."""
Rate = dict[str, float]


def rate(hits: int, trials: int) -> Rate | None:
    """Share of trials, with the interval of Clopper and Pearson (1934), which is exact for trials
    that are independent; None where there are none.

    Examples
    --------
    >>> {key: round(value, 5) for key, value in rate(0, 5000).items()}
    {'rate': 0.0, 'lower': 0.0, 'upper': 0.00074, 'trials': 5000}
    """
    if not trials:
        return None
    misses, tail = trials - hits, 0.5 * OUTSIDE
    return {
        "rate": hits / trials,
        "lower": float(beta.ppf(tail, hits, misses + 1)) if hits else 0.0,
        "upper": float(beta.ppf(1.0 - tail, hits + 1, misses)) if misses else 1.0,
        "trials": trials,
    }


def per_minute(count: int, seconds: float) -> Rate | None:
    """What happens a minute, with the interval of Garwood (1936), which is exact for a Poisson
    process; None where there was no time.

    Examples
    --------
    >>> round(per_minute(0, 3600.0)["upper"], 3)
    0.061
    """
    if not seconds > 0.0:
        return None
    minutes, tail = seconds / 60.0, 0.5 * OUTSIDE
    return {
        "rate": count / minutes,
        "lower": float(chi2.ppf(tail, 2 * count)) / (2.0 * minutes) if count else 0.0,
        "upper": float(chi2.ppf(1.0 - tail, 2 * count + 2)) / (2.0 * minutes),
        "minutes": minutes,
    }
