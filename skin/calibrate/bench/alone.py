"""One unit of a skin by itself, and units with the zeros of a recording."""

from __future__ import annotations

import dataclasses

import numpy as np

from skin.calibrate.bench.file import KINDS
from skin.calibrate.bench.series import Series
from topology import CHANNELS, Topology

__all__ = ["alone", "tared"]

FREQUENCY = CHANNELS.index("frequency")
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


def tared(topology: Topology, series: Series) -> Topology:
    """The skin with the rest frequencies of a recording's units from its tare, where it has one."""
    rest = series.kind == KINDS.index("tare")
    if not rest.any():
        return topology
    units = list(series.units)
    scale, offset = (v[FREQUENCY, units] for v in (topology.scale, topology.offset))
    parameters = {name: values.copy() for name, values in topology.parameters.items()}
    counts = series.counts.counts[rest][:, FREQUENCY, units]
    parameters["frequency_rest_hz"][units] = scale * counts.mean(axis=0) + offset
    return dataclasses.replace(topology, parameters=parameters)
