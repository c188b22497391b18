"""GraspScene: a grasping robot, as a scene for simulated units, and its truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import topology as topology_package
from skin.errors import (
    MOST_SEED,
    OptionError,
    SceneError,
    SkinError,
    check_flag,
    check_number,
    shown,
)
from skin.physics.halbach import FELT_M, HalbachField
from skin.sim.grasping.episode import Episode
from skin.sim.grasping.object import ROOM_C, GraspObject
from skin.sim.grasping.plant import Plant
from skin.sim.grasping.touch import DEEPEST_M
from skin.sim.mechanics.springs import under
from skin.sim.thermal import ThermalChain
from skin.sim.truth import Truth, sum_wrench, wrench_map
from skin.sim.unit import UnitSimulator
from topology import Topology

__all__ = ["GraspScene", "GraspTruth"]

APART_M = 10.0
"""Distance between links: beyond the range of films."""

LEAST_NOISE = 0.5
"""Fraction of a unit's own noise: with less, its counts would be FROZEN [derived:
docs/guides/faults.md]."""

NOISES = ("frequency_noise_hz", "field_noise_ut", "gel_noise_relative")


@dataclass(slots=True)
class GraspTruth:
    """n units and o objects at one instant, before any noise; valid until the next cycle.

    Attributes
    ----------
    time_s : float
    units : Truth
        Forces and temperatures of the units, in their frames.
    object_names : tuple of str
    position : ndarray, shape (3, o)
        Centres of mass, metre, frame of the world.
    rotation : ndarray, shape (3, 3, o)
    velocity : ndarray, shape (6, o)
        Of the centre of mass, metre per second, and turning, radian per second; frame of the world.
    wrench : ndarray, shape (6, o)
        Wrench of the skin on each object: newton, and newton metre about its centre of mass.
    touched_by : ndarray, shape (n,), int32
        Object on each unit; -1 for none, -2 for a link or the surroundings.
    slipping : ndarray, shape (n,), bool
    normal_n, drag_n, limit_n : ndarray, shape (n,)
        Newton: along the object's normal, across it, and the limit of friction.
    bottomed : ndarray, shape (n,), bool
        Pressed until the film would lie on its chip, where the elastic laws end.
    """

    time_s: float
    units: Truth
    object_names: tuple[str, ...]
    position: np.ndarray
    rotation: np.ndarray
    velocity: np.ndarray
    wrench: np.ndarray
    touched_by: np.ndarray
    slipping: np.ndarray
    normal_n: np.ndarray
    drag_n: np.ndarray
    limit_n: np.ndarray
    bottomed: np.ndarray

    def margin(self, index: int = 0) -> float:
        """Free fraction of the friction on an object; NaN without contact."""
        mine = self.touched_by == index
        limit = float(self.limit_n[mine].sum())
        return 1.0 - float(self.drag_n[mine].sum()) / limit if limit > 0.0 else float("nan")


class GraspScene:
    """A robot with its skin and objects, stepped to requested instants (a `skin.sim.truth.Scene`),
    for `skin.open(..., simulate=scene)` and `skin.sim.node.SimulatedUnits`.

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

    Attributes
    ----------
    plant : Plant
    units : UnitSimulator
        Converts displacements to counts.
    truth : GraspTruth
    surface_c : ndarray, shape (b,)
        Temperatures of the bodies, degree Celsius; may be set between two instants.
    moved : callable, or None
        Called after the joints have moved, before the truth is returned.

    Raises
    ------
    OptionError, SceneError, LibraryError, topology.TopologyError
        Invalid arguments; the message says what to do.
    """

    def __init__(
        self,
        topology: Topology | str | Path,
        objects: Iterable[GraspObject | str] = (),
        *,
        model: str | Path | None = None,
        episode: Episode | None = None,
        seed: int = 0,
        noise: bool = True,
    ) -> None:
        check_number("seed", seed, 0, MOST_SEED, whole=True)
        check_flag("noise", noise)
        loaded = topology if isinstance(topology, Topology) else topology_package.load(topology)
        robot = loaded.robot
        if robot is None:
            raise OptionError(
                f"{loaded.path or loaded.name}: must have [robot] model, the file of the robot "
                "that the skin is on; got none"
            )
        path = robot.path if model is None else Path(model)
        if not path.is_file():
            raise SceneError(f"model: must be an MJCF or URDF file; got {str(path)!r}, not there")
        given = _objects(objects)
        drawn = Episode() if episode is None else episode
        drawn.check(loaded)
        if not noise or drawn.noise < LEAST_NOISE:  # constant counts are no fault
            never = np.zeros_like(loaded.parameters["frozen_cycles"])
            loaded = _changed(loaded, frozen_cycles=never)
        self.plant = plant = Plant(
            path, loaded, drawn.objects(given), springs=drawn.springs(loaded),
            mounted_at=drawn.poses(loaded),
        )  # fmt: skip
        scaled = {name: drawn.noise * loaded.parameters[name] for name in NOISES}
        scaled["gel_current_20c_ua"] = drawn.gel * loaded.parameters["gel_current_20c_ua"]
        field = HalbachField(_with_distant_links(loaded), reach_m=FELT_M)
        self.units = UnitSimulator(_changed(loaded, **scaled), seed=seed, noise=noise, field=field)
        self.moved: Callable[[], Any] | None = None
        self._gain = np.broadcast_to(drawn.gain, (3, loaded.n))
        self.surface_c = np.full(plant.model.nbody, ROOM_C)
        for body, thing in zip(plant.object_bodies, given, strict=True):
            if isinstance(thing, GraspObject):
                self.surface_c[body] = thing.temperature_c
        self._chain = ThermalChain(loaded, ambient=ROOM_C, direct=True)
        self._index = np.full(plant.model.nbody + 1, -2, np.int32)
        self._index[-1] = -1
        self._index[plant.object_bodies] = np.arange(len(plant.objects))
        self._time_s = 0.0
        count, touch = len(plant.objects), plant.touch
        self.truth = GraspTruth(
            0.0, Truth.at_rest(loaded.n, ROOM_C), plant.objects, np.zeros((3, count)),
            np.zeros((3, 3, count)), np.zeros((6, count)), np.zeros((6, count)),
            np.full(loaded.n, -1, np.int32), touch.slipping, touch.normal_n, touch.drag_n,
            touch.limit_n, np.zeros(loaded.n, bool),
        )  # fmt: skip
        self._update_truth(0.0)

    def at(self, time_s: float) -> Truth:
        """Advance to `time_s`; see `Scene`. SkinError if time runs backwards, or the engine
        fails."""
        period_s = time_s - self._time_s
        if period_s < 0.0:
            raise SkinError(
                f"time_s: must not be before {self._time_s:g}, the last one; got {time_s:g}"
            )
        if period_s > 0.0:
            self.plant.advance(period_s)
            self._check()
            if self.moved is not None:
                self.moved()
        self._time_s = time_s
        self._update_truth(period_s)
        return self.truth.units

    def _check(self) -> None:
        """The engine resets itself when numbers diverge, and counts that."""
        data = self.plant.data
        if any(data.warning[kind].number for kind in range(4, 7)) or not np.all(
            np.isfinite(data.qpos)
        ):
            raise SkinError(
                f"world: must stay finite; got accelerations without bound at {self._time_s:g} s: "
                "give heavier bodies, or a shorter timestep in the model"
            )

    def _update_truth(self, elapsed_s: float) -> None:
        plant, truth, touch = self.plant, self.truth, self.plant.touch
        units = truth.units
        truth.time_s = units.time_s = self._time_s
        np.copyto(units.force, touch.force)
        np.maximum(units.force[2], 0.0, out=units.force[2])
        np.greater(units.force[2], 0.0, out=units.contact)
        under(plant.mounted.springs, units.force, units.depth_mm, units.displacement_mm)
        np.minimum(units.depth_mm, 1e3 * DEEPEST_M, out=units.depth_mm)  # there it lies on its chip
        units.displacement_mm *= self._gain[:2]
        units.depth_mm *= self._gain[2]
        position, rotation = self.unit_poses()
        sum_wrench(wrench_map(position, rotation), position, units)
        warm = self._chain.step(elapsed_s, units.contact, self.surface_c[touch.body], ROOM_C)
        units.temperature[:], units.film_temperature[:] = warm[0], warm[1]
        units.hall_temperature[:] = warm[3]
        truth.touched_by[:] = self._index[touch.body]
        np.greater(touch.tip_mm[2], 1e3 * DEEPEST_M, out=truth.bottomed)
        for i, body in enumerate(plant.object_bodies):
            truth.position[:, i] = plant.data.xipos[body]
            truth.rotation[:, :, i] = plant.data.xmat[body].reshape(3, 3)
            truth.velocity[:, i] = plant.velocity_of(body)
            truth.wrench[:, i] = plant.wrench_on(body)

    def unit_poses(self) -> tuple[np.ndarray, np.ndarray]:
        """Current poses of the units, shapes (3, n) and (3, 3, n), in the frame of the robot's
        base."""
        plant, data = self.plant, self.plant.data
        mounted = plant.mounted
        turn = data.xmat[mounted.body].reshape(-1, 3, 3)
        position = np.einsum("nij,jn->in", turn, mounted.place) + data.xpos[mounted.body].T
        rotation = np.einsum("nij,jkn->ikn", turn, mounted.rotation)
        base = plant.base_body
        axes = data.xmat[base].reshape(3, 3).T
        position = axes @ (position - data.xpos[base][:, np.newaxis])
        return position, np.einsum("ij,jkn->ikn", axes, rotation)


def _changed(topology: Topology, **parameters: np.ndarray) -> Topology:
    return dataclasses.replace(topology, parameters={**topology.parameters, **parameters})


def _with_distant_links(topology: Topology) -> Topology:
    """The same with its links far apart: films act on their own link only, whose distances stay."""
    links = list(topology.patch_links)
    link = np.array([links.index(name) for name in links])[topology.patch]
    position = topology.position.copy()
    position[0] += APART_M * link
    return dataclasses.replace(topology, position=position)


def _objects(objects: Any) -> list[GraspObject | str]:
    if isinstance(objects, GraspObject | str) or not isinstance(objects, Iterable):
        objects = [objects]
    given = list(objects)
    for thing in given:
        if not isinstance(thing, GraspObject | str):
            raise OptionError(
                f"objects: must be GraspObjects or names of bodies; got {shown(thing)}"
            )
    return given
