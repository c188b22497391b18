"""World: a grasp in MuJoCo with an open skin: one `State` a cycle, and the truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import skin.opening
from skin.errors import OptionError, check_number, shown
from skin.live import Skin
from skin.sim.grasping.episode import Episode
from skin.sim.grasping.joints import Joints
from skin.sim.grasping.object import GraspObject
from skin.sim.grasping.scene import GraspScene, GraspTruth, grasp_scene
from skin.state import State
from topology import Topology

__all__ = ["World", "grasp"]

Vector = Sequence[float] | np.ndarray


def grasp(
    model: Topology | str | Path,
    topology: Topology | str | Path | None = None,
    objects: Iterable[GraspObject | str] = (),
    *,
    episode: Episode | None = None,
    seed: int = 0,
    noise: bool = True,
    step_s: float | None = None,
    self_touch: bool = True,
    pace: bool = False,
    **options: Any,
) -> World:
    """Open a skin on a robot in MuJoCo, with objects within its reach.

    Parameters
    ----------
    model : str, Path or Topology
        MJCF or URDF; alone, a topology, whose ``[robot] model`` it is.
    topology : Topology, str or Path, optional
        With a link of the model for every patch.
    objects, episode, seed, noise, step_s, self_touch
        See `skin.sim.grasping.scene.grasp_scene`.
    pace : bool
        Real time; False runs at full speed.
    **options
        Of `skin.open`: ``want``, ``estimator``, ``log``, ``record``, …

    Returns
    -------
    World

    Raises
    ------
    OptionError, SceneError, LibraryError, topology.TopologyError
        Invalid arguments; the message says what to do.

    Examples
    --------
    >>> cube = GraspObject(name="cube", size_m=(0.02, 0.02, 0.03), mass_kg=0.06)
    >>> with grasp("gripper", objects=[cube]) as world:
    ...     world.joints["left"] = world.joints["right"] = 0.03
    ...     for state in world:
    ...         if world.time_s >= 0.5:
    ...             break
    ...     world.truth.object_names, int((world.truth.touched_by == 0).sum())
    (('cube',), 32)
    """
    if topology is None:
        own, file = model, None
    elif isinstance(model, Topology):
        raise OptionError(f"model: must be an MJCF or URDF file; got {shown(model)}")
    else:
        own, file = topology, model
    scene = grasp_scene(
        own, objects, model=file, episode=episode, seed=seed, noise=noise, step_s=step_s,
        self_touch=self_touch,
    )  # fmt: skip
    return World(scene, pace=pace, seed=seed, **options)


class World:
    """A scene of a grasp with its open skin; iterate over it for one `State` a cycle.

    Attributes
    ----------
    skin : Skin
    scene : GraspScene
    joints : Joints
        ``world.joints["left"] = 0.03`` sets a target, from the next cycle on; reading returns the
        position.
    """

    def __init__(self, scene: GraspScene, *, pace: bool = False, **options: Any) -> None:
        self.scene = scene
        self.joints = Joints(scene.plant)
        topology = scene.plant.topology
        self.skin: Skin = skin.opening.open(topology, simulate=scene, pace=pace, **options)
        scene.moved = self._moved
        self._moved()

    @property
    def truth(self) -> GraspTruth:
        """The true state, as of the last cycle."""
        return self.scene.truth

    @property
    def time_s(self) -> float:
        """Of the last cycle, since the start."""
        return self.scene.truth.time_s

    def push(self, name: str, force_n: Vector, torque_nm: Vector = (0.0, 0.0, 0.0)) -> None:
        """Push an object at its centre of mass, from the next cycle on, until the next call.

        Parameters
        ----------
        name : str
            An object or a link.
        force_n, torque_nm : three numbers
            Newton and newton metre, frame of the world.

        Raises
        ------
        OptionError
            No such object, or no three finite numbers.
        """
        model = self.scene.plant.model
        names = [model.body(i).name for i in range(1, model.nbody)]
        if name not in names:
            raise OptionError.unknown("push", name, names)
        for where, given in (("force_n", force_n), ("torque_nm", torque_nm)):
            if np.shape(given) != (3,):
                raise OptionError(f"push: {where}: must be three numbers; got {shown(given)}")
            for value in given:
                check_number(f"push: {where}", value, -1e6, 1e6)
        self.scene.plant.pushes[model.body(name).id] = [*force_n, *torque_nm]

    def warm(self, name: str, celsius: float) -> None:
        """Set the surface temperature of an object, from the next cycle on.

        Raises
        ------
        OptionError
            No such object, or no temperature.
        """
        check_number("warm: celsius", celsius, -273.15, 1000.0)
        self.scene.surface_c[self._object("warm", name)] = celsius

    def weigh(self, name: str, mass_kg: float) -> None:
        """Set the mass of an object, from the next cycle on, with the same distribution.

        Raises
        ------
        OptionError
            No such object, or no mass.
        """
        check_number("weigh: mass_kg", mass_kg, 1e-6, 1e3)
        self.scene.plant.set_mass(self._object("weigh", name), mass_kg)

    def _object(self, where: str, name: str) -> int:
        """Body of an object."""
        plant = self.scene.plant
        if name not in plant.objects:
            raise OptionError.unknown(where, name, plant.objects)
        return int(plant.object_bodies[plant.objects.index(name)])

    def __iter__(self) -> Iterator[State]:
        return iter(self.skin)

    def __enter__(self) -> World:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the skin; may be called twice."""
        self.skin.close()

    def __repr__(self) -> str:
        """Units, objects and the time."""
        names = ", ".join(self.truth.object_names) or "no objects"
        return f"<World {self.skin.topology.name!r}: {names}, {self.time_s:.3f} s>"

    def _moved(self) -> None:
        """Report the joints' positions to the skin, as encoders would."""
        robot = self.skin.topology.robot
        if robot is None:
            return
        limits = zip(robot.joint_names, robot.lower.tolist(), robot.upper.tolist(), strict=True)
        self.skin.move_joints({  # the engine's limits yield a little
            name: max(lower, min(self.joints[name], upper))
            for name, lower, upper in limits if name in self.joints
        })  # fmt: skip
