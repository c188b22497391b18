"""Noise of held recordings, compared with the noise model of the slip detector.

The mean square of the change over a time τ, ``D(τ)``, is 2 w² for white noise of variance w², at
any τ. A bounded random walk (Ornstein-Uhlenbeck, sigma s, time constant T) adds 2 s² (1 - exp(-τ /
T)), a drift of d a second adds d² τ². All four are fitted to each channel of each recording, with
errors relative to D. The detector takes the noise of its lags for white, except for a factor of the
variance that it learns (`skin.contact.slip.lags`), and lets anchors follow within 3 s.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import nnls

from benchmarks.recorded.eflesh import RATE_HZ, turned

__all__ = ["noise"]

LAGS = np.unique(np.geomspace(1, 150, 25).astype(int))
"""Samples, up to half of a recording: beyond that a change has few independent values."""
TIMES_S = np.geomspace(0.02, 10.0, 28)
"""Time constants of a walk that are compared."""


def noise(held_ut: np.ndarray) -> dict[str, Any]:
    """Noise of held things.

    Parameters
    ----------
    held_ut : ndarray, shape (r, t, 2, chips, 3)

    Returns
    -------
    dict
        `white_ut`, `walk_ut`, `walk_s`, `drift_ut_per_s`: median and quartiles over channels and
        recordings; `white_share`: of the variance of a change over 10 ms and 1 s.
    """
    along = turned(held_ut)
    channels = along.reshape(*along.shape[:2], -1)
    each = np.moveaxis(channels, 2, 1).reshape(-1, channels.shape[1])
    change = np.array([structure(one) for one in each])
    white, walk, time_s, drift = np.array([_fit(one) for one in change]).T
    excess = change / (2.0 * white**2)[:, np.newaxis]
    at = {0.01: 0, 1.0: int(np.argmin(np.abs(LAGS - RATE_HZ)))}
    return {
        "recordings": len(held_ut),
        "white_ut": _quartiles(white),
        "walk_ut": _quartiles(walk),
        "walk_s": _quartiles(time_s[walk > 0.0]),
        "drift_ut_per_s": _quartiles(drift),
        "white_share": {f"{time:g} s": _quartiles(1.0 / excess[:, i]) for time, i in at.items()},
    }


def structure(values: np.ndarray) -> np.ndarray:
    """Mean square of the change over each of `LAGS`.

    Examples
    --------
    >>> structure(np.arange(300.0))[:3].tolist()
    [1.0, 4.0, 9.0]
    """
    return np.array([np.mean((values[lag:] - values[:-lag]) ** 2) for lag in LAGS])


def _fit(change: np.ndarray) -> tuple[float, float, float, float]:
    """Sigma of white noise, sigma and time constant of the walk, drift."""
    tau = LAGS / RATE_HZ
    best: tuple[float, np.ndarray, float] | None = None
    for time_s in TIMES_S:
        terms = np.stack([np.full(tau.size, 2.0), 2.0 * -np.expm1(-tau / time_s), tau**2], axis=1)
        found, left = nnls(terms / change[:, np.newaxis], np.ones(tau.size))
        if best is None or left < best[0]:
            best = left, found, float(time_s)
    assert best is not None
    white, walk, drift = np.sqrt(best[1])
    # a channel without white noise has a share of nearly 0, not an infinite excess
    return max(float(white), 1e-3 * float(np.sqrt(change[0]))), float(walk), best[2], float(drift)


def _quartiles(values: np.ndarray) -> dict[str, float]:
    low, middle, high = (
        np.quantile(values, [0.25, 0.5, 0.75]).tolist() if values.size else [0.0] * 3
    )
    return {"median": middle, "lower": low, "upper": high}
