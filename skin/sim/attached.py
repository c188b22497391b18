"""Simulated units on buses within the process."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from msgspec.structs import replace

from bus.faults import FaultScript
from bus.memory import MemoryTransport
from bus.transport import Transport
from skin.errors import OptionError, shown
from skin.sim.node import SimulatedUnits
from skin.sim.scene import Scene
from skin.sim.scenes.load import load_scene
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.script import SceneFile
from topology import Topology

__all__ = ["in_process", "nodes_of", "own_faults"]


def nodes_of(
    topology: Topology,
    scene: Literal[True] | str | Path | SceneFile | Scene,
    seed: int | None,
    repeat: bool = False,
) -> SimulatedUnits:
    """Units that play a scene: True for "demo", a name, a file, a loaded one, or a scene; with its
    own seed, or 0, if none is given; with `repeat` it starts again at its end.

    Raises
    ------
    OptionError
        `scene` is not one, or cannot repeat, since it is not from a file.
    topology.TopologyError
        There is no such file, or it cannot be played.
    """
    if scene is True:
        return SimulatedUnits(topology, seed=seed or 0)
    if isinstance(scene, str | Path):
        scene = load_scene(scene, topology)
    if isinstance(scene, SceneFile):
        given = {} if seed is None else {"seed": seed}
        script = replace(scene, repeat=repeat or scene.repeat, **given)
        return SimulatedUnits(topology, ScriptedScene(topology, script))
    if not hasattr(scene, "at"):
        expected = "True, a scene, or the name or file of one"
        raise OptionError(f"simulate: must be {expected}; got {shown(scene)}")
    if repeat:
        raise OptionError(f"repeat: must be given with the file of a scene; got {shown(scene)}")
    return SimulatedUnits(topology, scene, seed=seed or 0)


def own_faults(scene: Scene) -> FaultScript | None:
    """The faults of a scene file; None without any."""
    own = getattr(scene, "script", None)
    if not isinstance(own, SceneFile) or not own.faults:
        return None
    return FaultScript(seed=own.seed, faults=own.faults)


def in_process(nodes: SimulatedUnits) -> list[Transport]:
    """Connect units to buses within the process; returns the host's end of each."""
    pairs = [MemoryTransport.pair(index=i) for i in range(len(nodes.topology.buses))]
    nodes.attach([far for _, far in pairs])
    return [near for near, _ in pairs]
