"""Noise of held recordings, compared with the noise model of the slip detector.

The mean square of the change over a time τ, ``D(τ)``, is 2 w² for white noise of variance w², at
any τ. A bounded random walk (Ornstein-Uhlenbeck, sigma s, time constant T) adds 2 s² (1 - exp(-τ /
T)), a drift of d a second adds d² τ². All four are fitted to each channel of each recording, with
errors relative to D. The detector takes the noise of its lags for white, except for a factor of the
variance that it learns (`skin.contact.slip.lags`), and lets anchors follow within 3 s.

Correlations are of steps from sample to sample (white noise), and of means over 0.1 s about a
straight line (slow noise): root mean square over pairs, less what chance gives to independent ones.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls

from benchmarks.recorded.eflesh import CHIPS, RATE_HZ, turned

__all__ = ["draw", "noise"]

LAGS = np.unique(np.geomspace(1, 150, 25).astype(int))
"""Samples, up to half of a recording: beyond that a change has few independent values."""
TIMES_S = np.geomspace(0.02, 10.0, 28)
"""Time constants of a walk that are compared."""
SLOW = 10
"""Samples of a mean of slow noise."""


def noise(held_ut: np.ndarray) -> dict[str, Any]:
    """Noise of held things.

    Parameters
    ----------
    held_ut : ndarray, shape (r, t, 2, chips, 3)

    Returns
    -------
    dict
        `white_ut`, `walk_ut`, `walk_s`, `drift_ut_per_s`: median and quartiles over channels and
        recordings; `white_share`: of the variance of a change over 10 ms and 1 s; `excess`: that
        variance over the white one, by time in second; `correlation`: by kind of pair.
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
        "excess": {f"{lag / RATE_HZ:g}": _quartiles(row)
                   for lag, row in zip(LAGS.tolist(), excess.T, strict=True)},
        "correlation": {"white": _pairs(np.diff(channels, axis=1), 1.0),
                        "slow": _pairs(_slow(channels), 0.0)},
    }  # fmt: skip


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


def _slow(channels: np.ndarray) -> np.ndarray:
    """Means over 0.1 s, less a straight line, shape (r, t / 10, c)."""
    r, t, c = channels.shape
    means = channels[:, : t // SLOW * SLOW].reshape(r, -1, SLOW, c).mean(axis=2)
    time = np.linspace(-1.0, 1.0, means.shape[1])
    basis = np.stack([np.full(time.size, time.size**-0.5), time / np.linalg.norm(time)])
    return means - np.einsum("kt,ku,ruc->rtc", basis, basis, means)


def correlations(values: np.ndarray) -> np.ndarray:
    """Mean correlation matrix over recordings of the channels, and that of its squares."""
    each = np.array([np.corrcoef(one, rowvar=False) for one in values])
    return np.stack([each.mean(axis=0), (each**2).mean(axis=0)])


def _pairs(values: np.ndarray, ends: float) -> dict[str, float]:
    """Root mean square correlation of pairs, less that of independent noise; `ends` is 1 for steps,
    whose neighbours share a sample."""
    square = correlations(values)[1]
    # of t values: 1 / t; steps of white noise: neighbours correlate by -1/2, so 1.5 / t
    chance = (1.0 + 0.5 * ends) / values.shape[1]
    index = np.arange(values.shape[2])
    finger, chip = index // (3 * CHIPS), index // 3
    other = ~np.eye(index.size, dtype=bool)
    same_chip = chip[:, np.newaxis] == chip
    same_finger = finger[:, np.newaxis] == finger
    kinds = {"axes of a unit": other & same_chip, "units of a finger": ~same_chip & same_finger,
             "fingers": ~same_finger}  # fmt: skip
    return {name: float(np.sqrt(max(square[kind].mean() - chance, 0.0)))
            for name, kind in kinds.items()}  # fmt: skip


def _quartiles(values: np.ndarray) -> dict[str, float]:
    low, middle, high = (
        np.quantile(values, [0.25, 0.5, 0.75]).tolist() if values.size else [0.0] * 3
    )
    return {"median": middle, "lower": low, "upper": high}


def draw(path: Path, held_ut: np.ndarray, figures: dict[str, Any]) -> None:
    """Excess over white noise by time, and correlations of all channels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    over, steps, slow = figure.subplots(1, 3, width_ratios=(1.25, 1.0, 1.0))
    time_s = [float(key) for key in figures["excess"]]
    rows = list(figures["excess"].values())
    over.fill_between(time_s, [row["lower"] for row in rows], [row["upper"] for row in rows],
                      color="#0072b2", alpha=0.3, label="quartiles of channels")  # fmt: skip
    over.plot(time_s, [row["median"] for row in rows], color="#0072b2", label="measured, median")
    over.axhline(1.0, color="black", linestyle=":", label="white noise, as the detector assumes")
    over.set(xscale="log", yscale="log", xlabel="time between readings / s",
             ylabel="variance of the change / white")  # fmt: skip
    over.set(title="held things, 17 recordings")
    over.legend(frameon=False, fontsize=7)
    along = turned(held_ut)
    channels = along.reshape(*along.shape[:2], -1)
    for axis, values, title in ((steps, np.diff(channels, axis=1), "correlation from step to step"),
                                (slow, _slow(channels), "of means over 0.1 s")):  # fmt: skip
        shown = axis.imshow(correlations(values)[0], vmin=-1.0, vmax=1.0, cmap="RdBu_r")
        axis.set(
            title=title, xlabel="channel: x, y, z of each chip", xticks=[0, 15], yticks=[0, 15]
        )
    figure.colorbar(shown, ax=slow, shrink=0.8)
    over.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=110)
