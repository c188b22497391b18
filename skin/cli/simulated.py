"""Simulated units that play a scene: what `skin sim` and `skin run --simulate` share."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bus.faults import FaultScript
    from skin.sim.node import Nodes
    from skin.sim.play import ScriptedScene
    from topology import Topology

__all__ = ["own_faults", "scripted", "unscripted"]


def unscripted(topology: Topology, seed: int | None, noise: bool = True) -> Nodes:
    """Units on which a sphere presses, slides and lifts."""
    from skin.sim.node import Nodes

    return Nodes(topology, seed=seed or 0, noise=noise)


def scripted(topology: Topology, scene: str, seed: int | None, noise: bool = True) -> ScriptedScene:
    """A scene by its name or file, on a skin."""
    from msgspec.structs import replace

    from skin.sim.play import ScriptedScene
    from skin.sim.script_load import load_scene

    script = load_scene(scene, topology)
    if seed is not None:
        script = replace(script, seed=seed)
    if not noise:
        script = replace(script, non_ideal=replace(script.non_ideal, noise=False))
    return ScriptedScene(topology, script)


def own_faults(played: ScriptedScene) -> FaultScript | None:
    """What the scene itself does to the frames."""
    from bus.faults import FaultScript

    own = played.script
    return FaultScript(seed=own.seed, faults=own.faults) if own.faults else None
