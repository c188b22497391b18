"""World: a grasp in MuJoCo with an open skin: one `State` a cycle, and the truth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

import skin.opening
from skin.errors import OptionError, check_number, shown
from skin.live import Skin
from skin.sim.grasping.episode import Episode
from skin.sim.grasping.model import name_of
from skin.sim.grasping.object import GraspObject
from skin.sim.grasping.plant import Plant
from skin.sim.grasping.scene import GraspScene, GraspTruth
from skin.state import State
from topology import Topology

__all__ = ["Joints", "World", "grasp"]

Vector = Sequence[float] | np.ndarray


def grasp(
    topology: Topology | str | Path,
    objects: Iterable[GraspObject | str] = (),
    *,
    model: str | Path | None = None,
    episode: Episode | None = None,
    seed: int = 0,
    noise: bool = True,
    pace: bool = False,
    **options: Any,
) -> World:
    """Open a skin on a robot in MuJoCo, with objects within its reach.

    Parameters
    ----------
    topology, objects, model, episode, seed, noise
        See `skin.sim.grasping.scene.GraspScene`.
    pace : bool
        Real time; False runs at full speed.
    **options
        Of `skin.open`: ``want``, ``options``, ``record``, …

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
    scene = GraspScene(topology, objects, model=model, episode=episode, seed=seed, noise=noise)
    return World(scene, pace=pace, seed=seed, **options)


class Joints(Mapping[str, float]):
    """Joints of a plant: reading one returns its position, setting one sets the target of its
    actuator.

    Actuators have names as well. Radian and metre; newton and newton metre for motors.
    """

    def __init__(self, plant: Plant) -> None:
        model, kinds = plant.model, plant.engine.mjtTrn
        self._model, self._data = model, plant.data
        movable = [j for j in range(model.njnt) if model.jnt_type[j] >= 2]
        self._place = {name_of(model, "joint", j): int(model.jnt_qposadr[j]) for j in movable}
        self._actuator = {name_of(model, "actuator", a): a for a in range(model.nu)}
        self._driven = tuple(self._actuator)
        for a in range(model.nu):
            if model.actuator_trntype[a] == kinds.mjTRN_JOINT:
                joint = name_of(model, "joint", int(model.actuator_trnid[a, 0]))
                self._actuator.setdefault(joint, a)

    def __getitem__(self, name: str) -> float:
        if name not in self._place:
            raise OptionError.unknown("joint", name, self._place)
        return float(self._data.qpos[self._place[name]])

    def __setitem__(self, name: str, target: float) -> None:
        """Set the target of an actuator, from the next cycle on.

        Raises
        ------
        OptionError
            No such joint, one without an actuator, or a target outside its limits.
        """
        if name in self._place and name not in self._actuator:
            raise OptionError(
                f"joint {name!r}: must have an actuator; got none: the model lets it follow"
            )
        lower, upper = self.limits(name)
        is_number = isinstance(target, Real) and not isinstance(target, bool)
        if not (is_number and lower <= target <= upper and math.isfinite(target)):
            raise OptionError(
                f"joint {name!r}: must be a target from {lower:g} to {upper:g}, its limits; "
                f"got {shown(target)}"
            )
        self._data.ctrl[self._actuator[name]] = target

    def __iter__(self) -> Iterator[str]:
        return iter(self._place)

    def __len__(self) -> int:
        return len(self._place)

    @property
    def targets(self) -> dict[str, float]:
        """Current targets, by actuator."""
        return dict(zip(self._driven, self._data.ctrl.tolist(), strict=True))

    def limits(self, name: str) -> tuple[float, float]:
        """Least and largest target of a joint."""
        if name not in self._actuator:
            raise OptionError.unknown("joint", name, self._actuator)
        actuator = self._actuator[name]
        if not self._model.actuator_ctrllimited[actuator]:
            return -math.inf, math.inf
        lower, upper = self._model.actuator_ctrlrange[actuator]
        return float(lower), float(upper)


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
