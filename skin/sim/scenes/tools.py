"""Tools of steel that a scene moves past a skin, without contact."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from skin.errors import SceneError
from skin.physics.film_table import load_film_table
from skin.physics.surroundings import Tool
from skin.sim.mechanics.body import Body, penetration
from skin.sim.scenes.motion import Track, frame_of
from skin.sim.scenes.script import SceneFile
from topology import Topology

__all__ = ["MovingTool"]


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
        self._xyz_m = Track("xyz_m", table.keys, (), (0.0, 0.0, 0.0), script.period_s)
        self._lowest_m = np.array([0.0, 0.0, table.radius_m])
        self._body = Body.sphere(table.radius_m)
        moment = self._rotation @ np.array(table.remanent_am2)
        self._tool = Tool((0.0, 0.0, 0.0), table.radius_m, table.permeability, tuple(moment))

    def at(self, time_s: float) -> Tool:
        """The tool at its place at a time.

        Raises
        ------
        SceneError
            It enters a unit, or comes nearer to a film than `HalbachField` is known.
        """
        topology, position = self._topology, self._position(time_s)
        depth_mm = penetration(
            self._body, (np.eye(3), position), topology.position, topology.rotation
        )
        deepest = int(np.argmax(depth_mm))
        if depth_mm[deepest] > 0.0:
            raise SceneError(
                f"{self._where(time_s)}: must be outside of all units (what presses them goes into "
                f"[[bodies]]); got {depth_mm[deepest]:.3g} mm into {topology.unit_names[deepest]}"
            )
        table = load_film_table()
        film = topology.position + 1e-3 * table.film.middle_mm * topology.rotation[:, 2]
        away_mm = 1e3 * np.linalg.norm(film - position[:, np.newaxis], axis=0)
        nearest = int(np.argmin(away_mm))
        if away_mm[nearest] < table.far_mm:
            raise SceneError(
                f"{self._where(time_s)}: must be with its middle {table.far_mm:.3g} mm or more "
                f"from that of any film; got {away_mm[nearest]:.3g} mm from that of "
                f"{topology.unit_names[nearest]}"
            )
        return replace(self._tool, position=tuple(position))

    def _position(self, time_s: float) -> np.ndarray:
        return self._rotation @ (self._xyz_m(time_s) + self._lowest_m) + self._origin
