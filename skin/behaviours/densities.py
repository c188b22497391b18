"""Logarithms of densities, for scalars."""

from __future__ import annotations

import math
from functools import lru_cache

__all__ = ["beta_log", "log_normal_log", "log_normal_longer_log", "normal_log"]

EDGE = 0.005
"""Fractions are kept this far from 0 and 1: noise resolves no less [assumed]."""

LEAST = 1e-300
"""Lower bound of a probability before its logarithm [numeric]."""


def normal_log(value: float, mean: float, sigma: float) -> float:
    """Logarithm of the density of a normal distribution."""
    away = (value - mean) / sigma
    return -0.5 * away * away - math.log(sigma) - 0.9189385332046727


def log_normal_log(value: float, median: float, spread: float) -> float:
    """Logarithm of the density, over the logarithm of `value`, of a log-normal distribution."""
    return normal_log(math.log(value / median), 0.0, spread)


def log_normal_longer_log(value: float, median: float, spread: float) -> float:
    """Logarithm of the survival function of a log-normal distribution.

    Examples
    --------
    >>> round(math.exp(log_normal_longer_log(1.0, 1.0, 0.5)), 3)
    0.5
    """
    return math.log(max(0.5 * math.erfc(math.log(value / median) / (spread * math.sqrt(2.0))),
                        LEAST))  # fmt: skip


def beta_log(share: float, a: float, b: float) -> float:
    """Logarithm of the density of a beta distribution; fractions are clipped by `EDGE`."""
    share = min(max(share, EDGE), 1.0 - EDGE)
    return (a - 1.0) * math.log(share) + (b - 1.0) * math.log(1.0 - share) - _beta(a, b)


@lru_cache(maxsize=256)
def _beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)
