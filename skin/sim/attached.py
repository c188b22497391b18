"""Simulated units on buses within the process."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from msgspec.structs import replace

from bus.faults import FaultScript
from bus.memory import MemoryTransport
from bus.transport import Transport
from skin.errors import OptionError, shown
from skin.sim.node import Nodes
from skin.sim.scene import Scene
from skin.sim.scenes.load import open_scene
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.script import SceneFile
from topology import Topology

__all__ = ["in_process", "nodes_of", "own_faults"]


def nodes_of(
    topology: Topology, scene: Literal[True] | str | Path | SceneFile | Scene, seed: int | None
) -> Nodes:
    """Units that play a scene: True for "demo", a name, a file, a loaded one, or a scene; by its
    own seed, or 0, if none is given.

    Raises
    ------
    OptionError
        `scene` is none.
    topology.TopologyError
        There is no such file, or it cannot be played.
    """
    if scene is True:
        return Nodes(topology, seed=seed or 0)
    if isinstance(scene, str | Path):
        return Nodes(topology, open_scene(scene, topology, seed=seed))
    if isinstance(scene, SceneFile):
        script = scene if seed is None else replace(scene, seed=seed)
        return Nodes(topology, ScriptedScene(topology, script))
    if not hasattr(scene, "at"):
        told = "True, a scene, or the name or file of one"
        raise OptionError(f"simulate: must be {told}; got {shown(scene)}")
    return Nodes(topology, scene, seed=seed or 0)


def own_faults(scene: Scene) -> FaultScript | None:
    """What a scene of a file does to the frames itself; None for nothing."""
    own = getattr(scene, "script", None)
    if not isinstance(own, SceneFile) or not own.faults:
        return None
    return FaultScript(seed=own.seed, faults=own.faults)


def in_process(nodes: Nodes) -> list[Transport]:
    """Let units answer on buses within the process; the host's end of each."""
    pairs = [MemoryTransport.pair(index=i) for i in range(len(nodes.topology.buses))]
    nodes.attach([far for _, far in pairs])
    return [near for near, _ in pairs]
