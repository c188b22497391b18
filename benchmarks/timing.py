"""Timing side by side: all take turns, so that a slow spell of the machine hits each of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.stats import binom

__all__ = ["Timed", "ratio", "times"]

ROUNDS = 15


class Timed(NamedTuple):
    """Seconds of a call.

    Attributes
    ----------
    median, fastest : float
    rounds : ndarray, shape (k,)
        Of each round, in turn with the rounds of the others.
    """

    median: float
    fastest: float
    rounds: np.ndarray


def times(runs: Mapping[str, Callable[[], object]], target_s: float) -> dict[str, Timed]:
    """Seconds of a call of each.

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
    return {
        name: Timed(float(np.median(values)), min(values), np.array(values))
        for name, values in samples.items()
    }


def ratio(one: Timed, other: Timed) -> tuple[float, float, float]:
    """Median of one over the other, round by round, and the ends of its 95 % interval.

    The interval is that of the order statistics, which assumes nothing of how times spread; with
    fewer than six rounds it is the range.
    """
    each = np.sort(one.rounds / other.rounds)
    cut = int(max(binom.ppf(0.025, each.size, 0.5) - 1, 0))
    return float(np.median(each)), float(each[cut]), float(each[-1 - cut])
