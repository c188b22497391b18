"""Timing side by side: all take turns, so that a slow spell of the machine hits each of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np

__all__ = ["times"]

ROUNDS = 15


def times(
    runs: Mapping[str, Callable[[], object]], target_s: float
) -> dict[str, tuple[float, float]]:
    """Median and least seconds of a call of each.

    Parameters
    ----------
    runs : dict of str to callable
    target_s : float
        How long each is to run in all, repeated as often as that takes.
    """
    repeats = {}
    for name, call in runs.items():
        call()
        started = time.perf_counter()
        call()
        once = max(time.perf_counter() - started, 1e-7)
        repeats[name] = max(1, min(2000, round(target_s / ROUNDS / once)))
    samples: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(ROUNDS):
        for name, call in runs.items():
            started = time.perf_counter()
            for _ in range(repeats[name]):
                call()
            samples[name].append((time.perf_counter() - started) / repeats[name])
    return {name: (float(np.median(values)), min(values)) for name, values in samples.items()}
