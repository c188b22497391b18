"""One unit of a skin by itself."""

from __future__ import annotations

import dataclasses

import numpy as np

from topology import Topology

__all__ = ["alone"]

OF_UNITS = ("patch", "enabled", "position", "rotation", "area", "calibrated", "tared", "scale",
            "offset", "wired")  # fmt: skip
"""Arrays of a topology whose last axis is the unit's."""


def alone(topology: Topology, unit: int) -> Topology:
    """The skin of one unit alone, to decode its counts without the others'."""
    units = topology.frames.units
    sliced = {name: getattr(topology, name)[..., unit : unit + 1] for name in OF_UNITS}
    none = np.zeros(0, np.int32)
    return dataclasses.replace(
        topology, **sliced, unit_names=(topology.unit_names[unit],),
        parameters={k: v[..., unit : unit + 1] for k, v in topology.parameters.items()},
        frames=dataclasses.replace(topology.frames, units=np.where(units == unit, 0, -1)),
        neighbour_start=np.zeros(2, np.int32), neighbour_index=none,
    )  # fmt: skip
