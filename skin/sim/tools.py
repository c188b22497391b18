"""Tools of steel that a scene moves past a skin: where they are, and that they touch nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from skin.errors import SceneError
from skin.sim.body import Body, reach
from skin.sim.motion import Track, frame_of
from skin.sim.script import SceneFile
from skin.sim.surroundings import Tool
from topology import Topology

__all__ = ["OUTSIDE", "MovingTool"]

OUTSIDE = "outside of all units (what presses them goes into [[bodies]])"
"""Where a tool must be."""


class MovingTool:
    """One tool of a scene file.

    Parameters
    ----------
    script : SceneFile
    index : int
        Which of its tools.
    topology : Topology
    """

    def __init__(self, script: SceneFile, index: int, topology: Topology) -> None:
        table = script.tools[index]
        self._topology = topology
        self._where = partial(script.where, "tools", index)
        self._rotation, self._origin = frame_of(topology, table.on)
        self._xyz_m = Track("xyz_m", table.keys, (), (0.0, 0.0, 0.0))
        self._lowest_m = np.array([0.0, 0.0, table.radius_m])
        self._body = Body.sphere(table.radius_m)
        moment = self._rotation @ np.array(table.remanent_am2)
        self._tool = Tool((0.0, 0.0, 0.0), table.radius_m, table.permeability, tuple(moment))

    def at(self, time_s: float) -> Tool:
        """The tool where it is at a time.

        Raises
        ------
        SceneError
            If it is in a unit.
        """
        if touched := self.touches(time_s):
            raise SceneError(f"{self._where(time_s)}: must be {OUTSIDE}; got {touched}")
        return replace(self._tool, position=tuple(self._position(time_s)))

    def touches(self, time_s: float) -> str:
        """How deep it is in which unit, in words; empty where it touches none."""
        topology = self._topology
        depth_mm, _ = reach(
            self._body, (np.eye(3), self._position(time_s)), topology.position, topology.rotation,
            radius_m=topology.parameters["radius_m"], face="disc",
        )  # fmt: skip
        deepest = int(np.argmax(depth_mm))
        unit = topology.unit_names[deepest]
        return f"{depth_mm[deepest]:.3g} mm into {unit}" if depth_mm[deepest] > 0.0 else ""

    def _position(self, time_s: float) -> np.ndarray:
        return self._rotation @ (self._xyz_m(time_s) + self._lowest_m) + self._origin
