"""Statistics of a feature over an episode, and over all of them, as LeRobot keeps them."""

from __future__ import annotations

import numpy as np

__all__ = ["Statistics", "aggregate", "of_images"]

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
KEPT = 4096
"""Rows used for quantiles [assumed]."""


class Statistics:
    """Mean, spread, extremes and quantiles over batches, along the last axis.

    Values that are not finite are ignored.
    """

    def __init__(self) -> None:
        self._count = 0
        self._frames = 0
        self._stride = 1
        self._kept: list[np.ndarray] = []

    def add(self, batch: np.ndarray) -> None:
        """Add frames, shape (m, …, d)."""
        self._frames += len(batch)
        rows = np.asarray(batch, np.float64).reshape(-1, batch.shape[-1])
        finite = np.isfinite(rows)
        if self._count == 0:
            size = rows.shape[1]
            self._sums, self._squares, self._number = np.zeros((3, size))
            self._least, self._most = np.full(size, np.inf), np.full(size, -np.inf)
        known = np.where(finite, rows, 0.0)
        self._number += finite.sum(axis=0)
        self._sums += known.sum(axis=0)
        self._squares += (known * known).sum(axis=0)
        self._least = np.minimum(self._least, np.where(finite, rows, np.inf).min(axis=0))
        self._most = np.maximum(self._most, np.where(finite, rows, -np.inf).max(axis=0))
        self._keep(rows)
        self._count += len(rows)

    def _keep(self, rows: np.ndarray) -> None:
        """Keep every k-th row, and double k when there are too many."""
        self._kept += list(rows[-self._count % self._stride :: self._stride])
        while len(self._kept) > KEPT:
            self._kept = self._kept[::2]
            self._stride *= 2

    def result(self) -> dict[str, np.ndarray]:
        """min, max, mean, std, count and quantiles; 0 where no value was finite."""
        known = self._number > 0
        number = np.maximum(self._number, 1)
        mean = self._sums / number
        spread = np.sqrt(np.maximum(self._squares / number - mean * mean, 0.0))
        kept = np.array(self._kept)
        found = {
            "min": np.where(known, self._least, 0.0), "max": np.where(known, self._most, 0.0),
            "mean": mean, "std": spread, "count": np.array([self._frames]),
        }  # fmt: skip
        for name, share in QUANTILES.items():
            found[name] = np.array([_quantile(column, share) for column in kept.T])
        return found


def _quantile(column: np.ndarray, share: float) -> float:
    finite = column[np.isfinite(column)]
    return float(np.quantile(finite, share)) if finite.size else 0.0


def of_images(images: list[np.ndarray]) -> dict[str, np.ndarray]:
    """Statistics of pixels, shape (h, w, 3) each, per colour; 0 to 1, shape (3, 1, 1)."""
    statistics = Statistics()
    for image in images:
        statistics.add(image.reshape(1, -1, 3) / 255.0)
    found = statistics.result()
    count = found.pop("count")
    return {name: value.reshape(3, 1, 1) for name, value in found.items()} | {"count": count}


def aggregate(episodes: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Statistics of several episodes combined; quantiles are means weighted by frames."""
    counts = np.array([one["count"][0] for one in episodes], float)
    shares = counts / counts.sum()

    def weighed(name: str) -> np.ndarray:
        return np.tensordot(shares, np.stack([one[name] for one in episodes]), axes=1)

    mean = weighed("mean")
    means, spreads = (np.stack([one[name] for one in episodes]) for name in ("mean", "std"))
    squares = np.tensordot(shares, spreads**2 + (means - mean) ** 2, axes=1)
    return {
        "min": np.min([one["min"] for one in episodes], axis=0),
        "max": np.max([one["max"] for one in episodes], axis=0),
        "mean": mean, "std": np.sqrt(squares), "count": np.array([int(counts.sum())]),
    } | {name: weighed(name) for name in QUANTILES}  # fmt: skip
