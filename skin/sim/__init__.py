"""Simulated units: scenes with known truth, the physics of a unit, frames on a bus.

The forward direction, from the physics alone: no code is shared with `skin.decode`.

::

    import skin.sim, topology

    palm = topology.load("palm")
    skin.sim.scenes.names  # ready-made ones
    scene = skin.sim.load_scene("press", palm)  # or a file of your own
    skin.open(palm, simulate=scene)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from skin.sim import scenes

if TYPE_CHECKING:
    from skin.sim.grasping.episode import Episode, Ranges
    from skin.sim.grasping.object import GraspObject
    from skin.sim.grasping.world import World, grasp
    from skin.sim.scenes.load import load_scene, open_scene

__all__ = [
    "Episode", "GraspObject", "Ranges", "World", "grasp", "load_scene", "open_scene", "scenes",
]  # fmt: skip

_HOMES = {
    "Episode": "skin.sim.grasping.episode",
    "GraspObject": "skin.sim.grasping.object",
    "Ranges": "skin.sim.grasping.episode",
    "World": "skin.sim.grasping.world",
    "grasp": "skin.sim.grasping.world",
    "load_scene": "skin.sim.scenes.load",
    "open_scene": "skin.sim.scenes.load",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'skin.sim' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
