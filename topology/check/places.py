"""Places: no two units in one place."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from topology.neighbours import pairs_within
from topology.report import Report
from topology.source import Key, Source

__all__ = ["CLOSEST", "check_places", "overlapping"]

CLOSEST = 0.1
"""Fraction of their radius within which two units are the same one entered twice."""

MOST_BATCHES = 250
"""Limit that bounds the time for thousands of units in one place; most are found."""


def check_places(
    position: np.ndarray,
    radius: np.ndarray,
    names: Sequence[str],
    keys: Sequence[Key],
    source: Source,
    report: Report,
) -> None:
    """Report units that stand where one further up stands, once for each pair of tables.

    Parameters
    ----------
    position : ndarray, shape (3, n), float64
        Metre.
    radius : ndarray, shape (n,), float64
        Metre.
    names : sequence of str, length n
    keys : sequence of Key, length n
        Table that placed each unit.
    """
    found: dict[tuple[Key, Key], list[tuple[int, int, float]]] = {}
    blamed = np.zeros(len(names), bool)
    batches = pairs_within(position, CLOSEST * float(np.max(radius, initial=0.0)))
    for i, j, distance in islice(batches, MOST_BATCHES):
        close = (distance < CLOSEST * np.minimum(radius[i], radius[j])) & ~blamed[j]
        second, first = np.unique(j[close], return_index=True)
        blamed[second] = True
        pairs = zip(i[close][first].tolist(), second.tolist(), distance[close][first], strict=True)
        for a, b, d in pairs:
            # A unit that an exception moved onto another is the one to blame.
            one, two = (b, a) if keys[a][0] == "units" else (a, b)
            found.setdefault((keys[one], keys[two]), []).append((two, one, float(d)))
    for (other, table), pairs in found.items():
        b, a, distance = min(pairs)
        more = f", and {len(pairs) - 1} more" if len(pairs) > 1 else ""
        report.add("same-place", source, table,
                   minimum_mm=1e3 * CLOSEST * min(radius[a], radius[b]),
                   got_mm=round(1e3 * distance, 6),
                   unit=repr(names[b]), other=repr(names[a]), line=source.line(other),
                   more=more)  # fmt: skip


def overlapping(position: np.ndarray, normal: np.ndarray, radius: np.ndarray) -> int:
    """Number of pairs of units whose round faces run into each other.

    Two faces that are tilted by 2 a to each other meet where their planes do, which is
    distance / (2 cos a) from either centre.

    Parameters
    ----------
    position, normal : ndarray, shape (3, n), float64
        Metre; unit vectors.
    radius : ndarray, shape (n,), float64
        Metre.
    """
    pairs = 0
    for i, j, distance in pairs_within(position, 2 * float(np.max(radius, initial=0.0))):
        half_tilt = np.sqrt(np.clip((1 + np.sum(normal[:, i] * normal[:, j], axis=0)) / 2, 0, 1))
        room = distance >= (radius[i] + radius[j]) * half_tilt * (1 - 1e-6)
        pairs += int(np.count_nonzero(~room))
    return pairs
