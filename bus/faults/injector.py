"""Injector: the faults of a script, done to frames, and counted.

What was done is counted by kind, so that a test can hold it against what the receiver has counted.
Which frames are hit depends on the seed and on the frames alone, not on how they fall into batches,
nor, where the script goes by a scene's time, on how fast the machine is.
A frame that a fault has put in is never hit by another, so that what comes out is bounded by what
went in.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from bus.faults.script import FaultScript, check_script
from bus.faults.stages import STAGES
from bus.frame import ECHO, FRAME_DTYPE
from topology import Topology

__all__ = ["Injector"]


class Injector:
    """Frames in, the same with faults out; for live frames and those of a log.

    Parameters
    ----------
    script : FaultScript
    seed : int, optional
        In place of the script's own.
    topology : Topology, optional
        The skin.
    index : int
        Bus of the topology whose frames these are.
    clock : callable, optional
        Gives the time, in ns, by which the script goes, asked for once for each call. If not given,
        the script goes by the stamps of the frames.

    Attributes
    ----------
    injected : dict of str to int
        How often each kind has struck: frames withheld, changed, moved or put in.
    """

    def __init__(
        self,
        script: FaultScript,
        seed: int | None = None,
        topology: Topology | None = None,
        *,
        index: int = 0,
        clock: Callable[[], int] | None = None,
    ) -> None:
        check_script(script, topology)
        self.injected: dict[str, int] = {}
        self._clock = clock
        seed = script.seed if seed is None else seed
        self._stages = [
            STAGES[type(fault)](fault, topology, index, np.random.default_rng([seed, index, i]))
            for i, fault in enumerate(script.faults)
        ]
        for stage in self._stages:
            self.injected.setdefault(stage.kind, 0)

    def __call__(self, records: np.ndarray) -> np.ndarray:
        """Pass frames of one bus on, in its order.

        Parameters
        ----------
        records : ndarray, shape (m,), FRAME_DTYPE

        Returns
        -------
        ndarray, shape (k,), FRAME_DTYPE
            A copy.
        """
        frames = np.array(records, FRAME_DTYPE)
        frames["origin"] &= ECHO
        unstamped = frames["stamp_ns"] == 0
        if unstamped.any():
            frames["stamp_ns"][unstamped] = time.time_ns()
        now_ns = None if self._clock is None else self._clock()
        for stage in self._stages:
            before = stage.injected
            frames = stage(frames, now_ns)
            self.injected[stage.kind] += stage.injected - before
        frames["origin"] &= ECHO
        return frames
