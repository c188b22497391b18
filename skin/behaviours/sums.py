"""Sums over pads and contacts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from topology import Topology

if TYPE_CHECKING:
    from skin.behaviours.pads import PadLoads
    from skin.contact.contact import Contact

__all__ = ["centre_of", "normal_of", "touched"]


def touched(contacts: list[Contact]) -> tuple[float, float, float, float]:
    """Force and torsion of all contacts together."""
    x = y = z = torsion = 0.0
    for contact in contacts:
        wrench = contact.wrench
        x, y, z = x + wrench[0], y + wrench[1], z + wrench[2]
        own = contact.torsion
        torsion += own if math.isfinite(own) else 0.0
    return float(x), float(y), float(z), float(torsion)


def centre_of(loads: PadLoads) -> list[float]:
    """Centre of pressure of all pads together."""
    weight = np.where(np.isfinite(loads.centre_m[0]), np.maximum(loads.load_n, 0.0), 0.0)
    total = weight.sum()
    if not total > 0.0:
        return [math.nan] * 3
    return (np.nan_to_num(loads.centre_m) @ weight / total).tolist()


def normal_of(topology: Topology, names: Iterable[str]) -> list[float]:
    """Mean normal of the pads, into the first one; opposing pads count alike."""
    total = np.zeros(3)
    for name in names:
        own = topology.patch == topology.patch_names.index(name)
        mean = topology.rotation[:, 2, own].mean(axis=1)
        total += mean if total @ mean >= 0.0 else -mean
    return (total / np.linalg.norm(total)).tolist()
