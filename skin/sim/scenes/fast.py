"""Scenes faster than real time: all frames are made, without the limits of a bus."""

from __future__ import annotations

import time

import numpy as np

from bus.faults import FaultScript, Injector
from bus.frame import FRAME_DTYPE, FrameBatch
from bus.logs import Recording
from skin.errors import SkinError
from skin.sim.node import Served, SimulatedUnits
from topology import Topology

__all__ = ["play"]


def play(
    nodes: SimulatedUnits,
    seconds: float,
    script: FaultScript | None = None,
    recording: Recording | None = None,
) -> tuple[Served, list[dict[str, int]]]:
    """Play the scene of simulated units at full speed.

    Parameters
    ----------
    nodes : SimulatedUnits
    seconds : float
        Of the scene; SkinError if shorter than a cycle.
    script : FaultScript, optional
        Faults of the frames.
    recording : Recording, optional
        Records the frames, and the SYNC of a host at the start of each cycle.

    Returns
    -------
    served : Served
        Its frames are those that remain after the faults.
    injected : list of dict
        Counts of the faults, for each bus.
    """
    topology = nodes.topology
    cycles = round(seconds * topology.cycle_rate_hz)
    if cycles < 1:
        raise SkinError(f"seconds: must hold a cycle at least; got {seconds:g}")
    buses = range(len(topology.buses))
    injectors = [] if script is None else [
        Injector(script, topology=topology, index=bus) for bus in buses
    ]  # fmt: skip
    # room for the data frames of a cycle and for a heartbeat of every board
    batch = FrameBatch(2 * int(np.bincount(topology.frames.bus).max()) + 1)
    stamps_ns = 1 + np.rint(1e9 / topology.cycle_rate_hz * np.arange(cycles)).astype(np.int64)
    served, started = nodes.served, time.perf_counter()
    sampled = 0
    for cycle in range(cycles):
        if cycle == sampled:
            sampled += nodes.foresee(cycle, cycles - cycle)
        for bus in buses:
            batch.clear()
            nodes.tick(cycle, batch, bus, int(stamps_ns[cycle]))
            left = injectors[bus](batch.frames) if injectors else batch.frames
            served.frames += left.size
            if recording is not None:
                recording.write(_with_sync(left, topology, bus, cycle, stamps_ns[cycle]))
    served.seconds += time.perf_counter() - started
    return served, [injector.injected for injector in injectors]


def _with_sync(
    frames: np.ndarray, topology: Topology, bus: int, cycle: int, stamp_ns: int
) -> np.ndarray:
    """The frames of a cycle of a bus after the SYNC that they answer, if there is one."""
    sync_id = topology.buses[bus].sync_id
    sync = np.zeros(0 if sync_id is None else 1, FRAME_DTYPE)
    if sync_id is not None:
        sync["id"], sync["length"], sync["stamp_ns"] = sync_id, 1, stamp_ns
        sync["data"][0, 0] = cycle & 0xFF
    both = np.concatenate([sync, frames])
    both["bus"] = bus
    return both
