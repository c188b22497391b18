"""The scene of a grasp, from a model, a topology and objects."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

import topology as topology_package
from skin.errors import MOST_SEED, OptionError, SceneError, check_flag, check_number, shown
from skin.grasp.episode import Episode
from skin.grasp.object import GraspObject
from skin.grasp.plant import Plant
from skin.grasp.scene import GraspScene
from skin.grasp.steps import longest_step_s, worst_touch
from skin.physics.halbach import FELT_M, HalbachField
from skin.sim.unit import UnitSimulator
from topology import Topology

__all__ = ["grasp_scene"]

APART_M = 10.0
"""Distance between links: beyond the range of films."""

LEAST_NOISE = 0.5
"""Fraction of a unit's own noise: with less, its counts would be FROZEN [derived:
docs/guides/faults.md]."""

NOISES = ("frequency_noise_hz", "field_noise_ut", "gel_noise_relative")


def grasp_scene(
    topology: Topology | str | Path,
    objects: Iterable[GraspObject | str] = (),
    *,
    model: str | Path | None = None,
    episode: Episode | None = None,
    seed: int = 0,
    noise: bool = True,
    step_s: float | None = None,
    self_touch: bool = True,
) -> GraspScene:
    """A scene for `skin.open(..., simulate=scene)` and `skin.sim.node.SimulatedUnits`.

    Parameters
    ----------
    topology : Topology, str or Path
        With ``[robot] model``, and a link for every patch.
    objects : iterable of GraspObject or str
        New ones, and names of bodies of the model.
    model : str or Path, optional
        Model to simulate, MJCF or URDF, if it is not that of the topology.
    episode : Episode, optional
        Deviations of this world from the files.
    seed : int
        Of the noise.
    noise : bool
        False: quantisation only; constant counts are no fault then.
    step_s : float, optional
        Longest step of the engine; chosen from stiffness over mass if not given.
    self_touch : bool
        Whether links touch each other.

    Raises
    ------
    OptionError, SceneError, LibraryError, topology.TopologyError
        Invalid arguments; the message says what to do.
    """
    check_number("seed", seed, 0, MOST_SEED, whole=True)
    check_flag("noise", noise)
    check_flag("self_touch", self_touch)
    loaded = topology if isinstance(topology, Topology) else topology_package.load(topology)
    robot = loaded.robot
    if robot is None:
        raise OptionError(
            f"{loaded.path or loaded.name}: must have [robot] model, the file of the robot that "
            "the skin is on; got none"
        )
    path = robot.path if model is None else Path(model)
    if not path.is_file():
        raise SceneError(f"model: must be an MJCF or URDF file; got {str(path)!r}, not there")
    given = _objects(objects)
    drawn = Episode() if episode is None else episode
    drawn.check(loaded)
    if not noise or drawn.noise < LEAST_NOISE:
        loaded = _without_watch(loaded)
    plant = Plant(
        path, loaded, drawn.objects(given), springs=drawn.springs(loaded),
        mounted_at=drawn.poses(loaded), self_touch=self_touch,
    )  # fmt: skip
    if step_s is not None:
        _check_step(plant, step_s)
    scaled = {name: drawn.noise * loaded.parameters[name] for name in NOISES}
    scaled["gel_current_20c_ua"] = drawn.gel * loaded.parameters["gel_current_20c_ua"]
    noisy = dataclasses.replace(loaded, parameters={**loaded.parameters, **scaled})
    units = UnitSimulator(
        noisy,
        seed=seed,
        noise=noise,
        field=HalbachField(_with_distant_links(loaded), reach_m=FELT_M),
    )
    warmth = {
        int(body): thing.temperature_c
        for body, thing in zip(plant.object_bodies, given, strict=True)
        if isinstance(thing, GraspObject)
    }
    gain = None if bool((drawn.gain == 1.0).all()) else drawn.gain
    return GraspScene(plant, units, temperature_c=warmth, gain=gain, step_s=step_s)


def _without_watch(topology: Topology) -> Topology:
    """The same without detection of frozen counts."""
    parameters = topology.parameters
    never = np.zeros_like(parameters["frozen_cycles"])
    return dataclasses.replace(topology, parameters={**parameters, "frozen_cycles": never})


def _with_distant_links(topology: Topology) -> Topology:
    """The same with its links far apart: films act on their own link only, whose distances stay."""
    links = list(topology.patch_links)
    link = np.array([links.index(name) for name in links])[topology.patch]
    position = topology.position.copy()
    position[0] += APART_M * link
    return dataclasses.replace(topology, position=position)


def _objects(objects: Any) -> list[GraspObject | str]:
    try:
        given = [objects] if isinstance(objects, GraspObject | str) else list(objects)
    except TypeError:
        given = [objects]
    for thing in given:
        if not isinstance(thing, GraspObject | str):
            raise OptionError(
                f"objects: must be GraspObjects or names of bodies; got {shown(thing)}"
            )
    return given


def _check_step(plant: Plant, step_s: float) -> None:
    """Require a step that is stable in the worst grasp of these objects."""
    longest_s = longest_step_s(plant, worst_touch(plant))
    is_number = isinstance(step_s, Real) and not isinstance(step_s, bool)
    if not is_number or not 0.0 < step_s <= longest_s * (1.0 + 1e-9):
        raise OptionError(
            f"step_s: must be above 0 and at most {longest_s:.2g} s, as stiffness over mass of a "
            f"grasped object asks; got {shown(step_s)}: leave it out, and it is chosen"
        )
