"""Share of errors within the sigma that is told with each number, over the whole stated range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import ndtri

from benchmarks.accuracy_noise import TIMES, Cells, Found
from skin.sim.bench import FARTHEST_MM

RIGHT = 0.6827
"""Share of normal errors within one sigma."""
STATED_MM = {"field-angle": FARTHEST_MM, "sine": 1.5}
"""R to which the sigma of an estimator is held to its share, at all depths to the deepest: to the
end of a recording. Beyond 1.5 mm the sine nears its crest, where an error has no normal
distribution: SATURATED says so."""


def coverage(found: Found, cells: Cells, estimator: str, units: int, rounds: int) -> dict[str, Any]:
    """Coverage of every cell of the stated range, none left out.

    Returns
    -------
    dict
        ``coverage_min``, ``coverage_max`` over cells and components; ``coverage_interval`` half of
        the 95 % interval of a cell's share; ``coverage`` the shares, by depth, displacement and
        component.
    """
    held = found.held[:, cells.reach_mm <= STATED_MM[estimator]]
    share, readings = float(held.mean()), TIMES * units * rounds
    return {
        "coverage_min": float(held.min()),
        "coverage_max": float(held.max()),
        "coverage_interval": 1.96 * float(np.sqrt(share * (1.0 - share) / readings)),
        "coverage": held.round(4).tolist(),
    }


def by_chance(films: Sequence[dict[str, Any]]) -> dict[str, float]:
    """How far chance alone takes the cells of some films from 68.3 %.

    Returns
    -------
    dict
        ``coverage_interval``: half of the 95 % interval of one cell; ``coverage_min_by_chance``,
        ``coverage_max_by_chance``: median of the least and of the largest of so many cells, if
        all of them have the right sigma.
    """
    half = max(rows["coverage_interval"] for rows in films)
    cells = sum(np.size(rows["coverage"]) for rows in films)
    furthest = float(-ndtri(1.0 - 0.5 ** (1.0 / cells))) * half / 1.96
    return {
        "coverage_interval": half,
        "coverage_min_by_chance": RIGHT - furthest,
        "coverage_max_by_chance": RIGHT + furthest,
    }
