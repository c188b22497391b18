"""A calibration file as the fits it was written from: what is not measured again is kept."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skin.physics.least_squares import Fit
from topology import Topology
from topology.model import TABLES

__all__ = ["as_fit", "named_file", "read_calibration"]

SIGMA = re.compile(r"""\s*["']?(\w+)["']?\s*=.*# ± (\S+)""")
"""A parameter with the sigma that `write_calibration` writes next to it."""


def named_file(topology: Topology, patch: str) -> Path | None:
    """The calibration file that the topology's own file names for a patch."""
    if topology.path is None:
        return None
    with open(topology.path, "rb") as file:
        tables = tomllib.load(file)["patches"]
    named = next(table for table in tables if table["name"] == patch).get("calibration")
    return None if named is None else topology.path.parent / named


def read_calibration(path: Path | None) -> tuple[dict[str, Any], dict[str, list[Fit]]]:
    """A calibration file, and its values as fits of each unit; sigma NaN where none is given."""
    if path is None:
        return {}, {}
    text = path.read_text(encoding="utf-8")
    table = tomllib.loads(text)
    sigma, unit = {}, None
    for line in text.splitlines():
        if line.lstrip().startswith("[units"):
            unit = next(iter(tomllib.loads(line)["units"]), None)
        elif match := SIGMA.match(line):
            sigma[unit, match[1]] = float(match[2])
    units = {}
    for unit, given in table.get("units", {}).items():
        units[unit] = []
        for name, value in given.items():
            spread = sigma.get((unit, name), np.nan)
            values = {name: (value, spread)}
            if name in TABLES:
                entries = value or [0.0] * TABLES[name]
                values = {f"{name}[{k}]": (v, spread) for k, v in enumerate(entries)}
            units[unit].append(as_fit(values, 0))
    return table, units


def as_fit(values: Mapping[str, tuple[float, float]], samples: int) -> Fit:
    """Values with their sigma, independent of each other, as a fit."""
    known = np.array(list(values.values()), float).reshape(-1, 2)
    return Fit(tuple(values), known[:, 0], np.diag(known[:, 1] ** 2), np.nan, 1.0, samples)
