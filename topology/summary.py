"""A topology in figures: units, identifiers, frames, and how full each bus is at worst."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from topology.arrays import EXTENDED, Topology
from topology.budget import bus_load
from topology.neighbours import nearest_point, neighbour_pairs

__all__ = ["FAR_M", "summary"]

FAR_M = 1.0
"""Distance from everything else above which a place is likely in millimetres [assumed: from a
link's frame to its skin, or to the next link's, no arm or humanoid has more]."""


def summary(topology: Topology) -> dict[str, Any]:
    """Sum up a topology, which may have been loaded with `allow_overload`, as `skin check --json`
    prints it.

    Loads of buses are those of worst-case bits, heartbeats included; `frames` are those of a cycle,
    `ids` the lowest and highest identifier, None on a bus without units; `cycle_ms` is the time on
    the wire of SYNC and all data frames, `highest_rate_hz` the cycle rate at which the load is
    `max_load`, None on an empty bus; `ok` says whether a bus, or every bus, can carry its cycle
    rate. `neighbours` is the mean number of a unit, `nearest_mm` the median distance of nearest
    neighbours in a patch, None with a single unit.

    Examples
    --------
    >>> from topology.load import load
    >>> found = summary(load("palm"))
    >>> found["units"], found["frames"], found["buses"][0]["ids"]
    (64, 13, [256, 268])
    """
    bus_of = _bus_of(topology)
    buses = [_bus(topology, index, bus_of) for index in range(len(topology.buses))]
    return {
        "name": topology.name,
        "path": str(topology.path) if topology.path is not None else None,
        "cycle_rate_hz": topology.cycle_rate_hz,
        "sync_id": topology.sync_id,
        "units": topology.n,
        "disabled": int(np.count_nonzero(~topology.enabled)),
        "frames": len(topology.frames),
        "neighbours": topology.neighbour_index.size / topology.n,
        "buses": buses,
        "patches": [_patch(topology, i, bus_of) for i in range(len(topology.patch_names))],
        "warnings": list(_warnings(topology, buses)),
        "ok": all(bus["ok"] for bus in buses),
    }


def _bus_of(topology: Topology) -> np.ndarray:
    """Bus of each unit, shape (n,)."""
    bus = np.zeros(topology.n, int)
    frame, slot = np.nonzero(topology.frames.units >= 0)
    bus[topology.frames.units[frame, slot]] = topology.frames.bus[frame]
    return bus


def _bus(topology: Topology, index: int, bus_of: np.ndarray) -> dict[str, Any]:
    bus, frames = topology.buses[index], topology.frames
    found = bus_load(topology, index)
    ids = frames.can_id[frames.bus == index] & ~np.uint32(EXTENDED)
    return {
        "name": bus.name,
        "interface": bus.interface,
        "channel": bus.channel,
        "bitrate": bus.bitrate,
        "data_bitrate": bus.data_bitrate,
        "units": int(np.count_nonzero(bus_of == index)),
        "frames": found.frames,
        "ids": [int(ids.min()), int(ids.max())] if ids.size else None,
        "cycle_ms": 1e3 * found.cycle_s,
        "load": found.load,
        "max_load": bus.max_load,
        "highest_rate_hz": found.highest_rate_hz if np.isfinite(found.highest_rate_hz) else None,
        "ok": found.load <= bus.max_load,
    }


def _patch(topology: Topology, index: int, bus_of: np.ndarray) -> dict[str, Any]:
    units = np.flatnonzero(topology.patch == index)
    frames = topology.frames
    carrying = np.isin(frames.units, units).any(axis=1)
    nearest, _ = nearest_point(topology.position[:, units])
    ids = frames.can_id[carrying] & ~np.uint32(EXTENDED)
    return {
        "name": topology.patch_names[index],
        "units": units.size,
        "disabled": int(np.count_nonzero(~topology.enabled[units])),
        "layouts": [topology.layouts[i].name for i in np.unique(frames.layout[carrying])],
        "buses": [topology.buses[i].name for i in np.unique(bus_of[units])],
        "ids": [int(ids.min()), int(ids.max())],
        "nearest_mm": 1e3 * float(np.median(nearest)) if units.size > 1 else None,
    }


def _warnings(topology: Topology, buses: list[dict[str, Any]]) -> Iterator[str]:
    """What may be meant, but is worth a second look."""
    for name, gap in _far_away(topology):
        yield (
            f"{name} is {gap:.3g} m from all else of the skin and from the "
            f"{'origin' if topology.robot is None else 'links'}: lengths are metres, not mm"
        )
    outward = -topology.rotation[:, 2]
    overlaps = _overlapping(topology.position, outward, topology.parameters["radius_m"])
    if overlaps:
        yield f"faces overlap between {overlaps} pairs of units, by their radius_m"
    for index in np.unique(topology.patch[topology.counts_only]):
        units = np.flatnonzero(topology.patch == index)
        carrying = np.isin(topology.frames.units, units).any(axis=1)
        layout = topology.layouts[topology.frames.layout[carrying][0]].name
        yield (
            f"patch {topology.patch_names[index]!r} gives counts only: its layout {layout!r} is of "
            "another sensor (not F3T)"
        )
    for bus in buses:
        if bus["units"] == 0:
            yield f"bus {bus['name']!r} carries no unit"


def _overlapping(position: np.ndarray, normal: np.ndarray, radius: np.ndarray) -> int:
    """Number of pairs of units whose round faces run into each other.

    Two faces that are tilted by 2 a to each other meet where their planes do, which is
    distance / (2 cos a) from either centre.
    """
    i, j = neighbour_pairs(position, 2 * radius, np.zeros(radius.size))
    distance = np.linalg.norm(position[:, i] - position[:, j], axis=0)
    half_tilt = np.sqrt(np.clip((1 + np.sum(normal[:, i] * normal[:, j], axis=0)) / 2, 0, 1))
    room = distance >= (radius[i] + radius[j]) * half_tilt * (1 - 1e-6)
    return int(np.count_nonzero(~room))


def _far_away(skin: Topology) -> Iterator[tuple[str, float]]:
    """Patches, or single units of them, that no chain of steps of `FAR_M` reaches from the origin
    or the links; and their distance from what it does."""
    _, some = np.unique(np.round(20 / FAR_M * skin.position), axis=1, return_index=True)
    place, gap = skin.position[:, some], np.full(some.size, np.inf)
    robot = skin.robot
    left = list(np.zeros((1, 3)) if robot is None else robot.forward(robot.home)[:, :3, 3])
    while left:
        away = np.linalg.norm(place - left.pop()[:, np.newaxis], axis=0)
        left += list(place[:, (gap > FAR_M) & (away <= FAR_M)].T)
        gap = np.minimum(gap, away)
    for patch in np.unique(skin.patch[some[gap > FAR_M]]):
        own = np.flatnonzero(skin.patch[some] == patch)
        far = own[gap[own] > FAR_M]
        unit = f"unit {skin.unit_names[some[far[0]]]}"
        yield unit if far.size < own.size else f"patch {skin.patch_names[patch]!r}", gap[far].min()
