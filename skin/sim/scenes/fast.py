"""Scenes faster than real time: all frames are made, without the limits of a bus."""

from __future__ import annotations

import time

import numpy as np

from bus.faults import FaultScript, Injector
from bus.frame import FRAME_DTYPE
from bus.logs import Recording
from skin.errors import SkinError
from skin.sim.node import Served, SimulatedUnits

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
    batches = [nodes.batch(bus) for bus in buses]
    started = time.perf_counter()
    for cycle in range(cycles):
        stamp_ns = 1 + round(1e9 * cycle / topology.cycle_rate_hz)
        for bus, batch in enumerate(batches):
            batch.clear()
            nodes.tick(cycle, batch, bus, stamp_ns)
            left = injectors[bus](batch.frames) if injectors else batch.frames
            nodes.served.frames += left.size
            if recording is not None:
                sync_id = topology.sync_id
                sync = [] if sync_id is None else [_sync(sync_id, cycle, stamp_ns)]
                frames = np.concatenate([*sync, left])
                frames["bus"] = bus
                recording.write(frames)
    nodes.served.seconds += time.perf_counter() - started
    return nodes.served, [injector.injected for injector in injectors]


def _sync(sync_id: int, cycle: int, stamp_ns: int) -> np.ndarray:
    """The SYNC of a cycle."""
    sync = np.zeros(1, FRAME_DTYPE)
    sync["id"], sync["length"], sync["stamp_ns"] = sync_id, 1, stamp_ns
    sync["data"][0, 0] = cycle & 0xFF
    return sync
