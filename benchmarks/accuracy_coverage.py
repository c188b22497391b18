"""Share of errors within the sigma that is told with each number, over the whole stated range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import ndtri

from benchmarks.accuracy_noise import COMPONENTS, TIMES, Cells, Found
from benchmarks.bench import FARTHEST_MM

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
        ``coverage_min``, ``coverage_max`` over cells and components; ``coverage_each`` the same of
        each of `COMPONENTS`; ``coverage_interval`` half of the 95 % interval of a cell's share;
        ``coverage`` the shares, by depth, displacement and component.
    """
    assert found.held is not None, "decoded with its sigma"
    held = found.held[:, cells.reach_mm <= STATED_MM[estimator]]
    low, high = held.min(axis=(0, 1)), held.max(axis=(0, 1))
    share, readings = float(held.mean()), TIMES * units * rounds
    return {
        "coverage_min": float(low.min()),
        "coverage_max": float(high.max()),
        "coverage_each": {name: [float(a), float(b)]
                          for name, a, b in zip(COMPONENTS, low, high, strict=True)},
        "coverage_interval": 1.96 * float(np.sqrt(share * (1.0 - share) / readings)),
        "coverage": held.round(4).tolist(),
    }  # fmt: skip


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


def lines(rows: dict[str, Any], cells: Cells, name: str) -> list[str]:
    """The shares of one decoder: least and largest of the components, in percent, H by R."""
    held = 100.0 * np.array(rows["coverage"])
    reach = cells.reach_mm[: held.shape[1]]
    interval = 100.0 * rows["coverage_interval"]
    head = f"{name}, % within one sigma, least and largest component (a cell: ± {interval:.1f})"
    out = [head, f"{'H, R mm':<9}" + "".join(f"{r:>10.2f}" for r in reach)]
    for depth, row in zip(cells.depth_mm, held, strict=True):
        shares = (f"{cell.min():.1f}-{cell.max():.1f}" for cell in row)
        out.append(f"{depth:<9.2f}" + "".join(f"{share:>10}" for share in shares))
    return [*out, ""]
