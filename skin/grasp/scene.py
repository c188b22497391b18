"""GraspScene: a grasping robot, as a scene for simulated units."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from skin.errors import SkinError
from skin.grasp.object import ROOM_C
from skin.grasp.plant import Plant
from skin.grasp.steps import split
from skin.grasp.touch import DEEPEST_M
from skin.grasp.truth import GraspTruth
from skin.sim.mechanics.springs import under
from skin.sim.thermal import ThermalChain
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator

__all__ = ["GraspScene"]


class GraspScene:
    """Steps a plant to requested instants (a `skin.sim.scene.Scene`).

    Parameters
    ----------
    plant : Plant
    units : UnitSimulator
        Converts displacements to counts.
    temperature_c : dict of int to float, optional
        Of bodies with another temperature than the room.
    gain : ndarray, shape (3, n), optional
        Factors of the units' displacement: 1 normal, 0 a dead unit.
    step_s : float, optional
        Longest step of the engine; chosen if not given.
    forces : callable, optional
        Called before each step with the time in seconds, to set `Plant.pushes`.
    moved : callable, optional
        Called with this scene after the joints have moved, before the truth is returned.

    Attributes
    ----------
    plant : Plant
    truth : GraspTruth
    steps : int
        Of the engine, so far.
    """

    steady = False

    def __init__(
        self, plant: Plant, units: UnitSimulator, *,
        temperature_c: dict[int, float] | None = None,
        gain: np.ndarray | None = None,
        step_s: float | None = None,
        forces: Callable[[float], None] | None = None,
        moved: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        topology = plant.topology
        self.plant, self.units = plant, units
        self.steps = 0
        self.moved = moved
        self._forces = forces
        self._step_s, self._gain = step_s, gain
        self._warmth = np.full(plant.model.nbody, ROOM_C)
        for body, celsius in (temperature_c or {}).items():
            self._warmth[body] = celsius
        self._chain = ThermalChain(topology, ambient=ROOM_C, direct=True)
        self._index = np.full(plant.model.nbody + 1, -2, np.int32)
        self._index[-1] = -1
        self._index[plant.object_bodies] = np.arange(len(plant.objects))
        self._time_s = 0.0
        self._velocity = np.zeros(6)
        self.truth = self._nothing()
        self._update_truth(0.0)

    def set_temperature(self, body: int, celsius: float) -> None:
        """Set the surface temperature of a body, from the next instant on."""
        self._warmth[body] = celsius

    def at(self, time_s: float) -> Truth:
        """Advance to `time_s`; see `Scene`. SkinError if time runs backwards, or the engine
        fails."""
        period_s = time_s - self._time_s
        if period_s < 0.0:
            raise SkinError(
                f"time_s: must not be before {self._time_s:g}, the last one; got {time_s:g}"
            )
        if period_s > 0.0:
            count = split(self.plant, period_s, self._step_s)
            for i in range(count):
                if self._forces is not None:
                    self._forces(self._time_s + i * period_s / count)
                self.plant.step(period_s / count)
            self.steps += count
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
                "give a shorter step_s, or heavier bodies"
            )

    def _nothing(self) -> GraspTruth:
        n, count = self.plant.topology.n, len(self.plant.objects)
        return GraspTruth(
            0.0, Truth.at_rest(n, ROOM_C), self.plant.objects,
            np.zeros((3, count)), np.zeros((3, 3, count)), np.zeros((6, count)),
            np.zeros((6, count)), np.full(n, -1, np.int32), np.zeros(n, bool), np.zeros(n),
            np.zeros(n), np.zeros(n), np.zeros(n, bool),
        )  # fmt: skip

    def _update_truth(self, elapsed_s: float) -> None:
        """Update the truth."""
        plant, truth, touch = self.plant, self.truth, self.plant.touch
        units = truth.units
        truth.time_s = units.time_s = self._time_s
        units.force[...] = touch.force
        np.maximum(units.force[2], 0.0, out=units.force[2])
        np.greater(units.force[2], 0.0, out=units.contact)
        under(plant.mounted.springs, units.force, units.depth_mm, units.displacement_mm)
        np.minimum(units.depth_mm, 1e3 * DEEPEST_M, out=units.depth_mm)  # there it lies on its chip
        if self._gain is not None:
            units.displacement_mm *= self._gain[:2]
            units.depth_mm *= self._gain[2]
        self._sum(units)
        warm = self._chain.step(elapsed_s, units.contact, self._warmth[touch.body], ROOM_C)
        units.temperature[:], units.film_temperature[:] = warm[0], warm[1]
        units.hall_temperature[:] = warm[3]
        truth.touched_by[:] = self._index[touch.body]
        truth.slipping[:], truth.normal_n[:] = touch.slipping, touch.normal_n
        truth.drag_n[:], truth.limit_n[:] = touch.drag_n, touch.limit_n
        np.greater(touch.tip_mm[2], 1e3 * DEEPEST_M, out=truth.bottomed)
        self._update_objects(truth)

    def _update_objects(self, truth: GraspTruth) -> None:
        plant, data = self.plant, self.plant.data
        mujoco: Any = plant.engine
        for i, body in enumerate(plant.object_bodies):
            truth.position[:, i] = data.xipos[body]
            truth.rotation[:, :, i] = data.xmat[body].reshape(3, 3)
            mujoco.mj_objectVelocity(
                plant.model, data, mujoco.mjtObj.mjOBJ_BODY, body, self._velocity, 0
            )
            truth.velocity[:3, i], truth.velocity[3:, i] = self._velocity[3:], self._velocity[:3]
            truth.wrench[:, i] = plant.wrench_on(body)

    def _sum(self, units: Truth) -> None:
        """Wrench and centre of pressure, in the frame of the robot's base."""
        position, rotation = self._poses()
        x, y, z = position
        fx, fy, fz = np.einsum("ijn,jn->in", rotation, units.force)
        units.wrench[:] = [fx.sum(), fy.sum(), fz.sum(), y @ fz - z @ fy, z @ fx - x @ fz,
                           x @ fy - y @ fx]  # fmt: skip
        load = units.force[2].sum()
        units.centroid[:] = position @ units.force[2] / load if load > 0.0 else np.nan

    def _poses(self) -> tuple[np.ndarray, np.ndarray]:
        """Current poses of the units, in the frame of the robot's base."""
        plant, data = self.plant, self.plant.data
        mounted = plant.mounted
        turn = data.xmat[mounted.body].reshape(-1, 3, 3)
        position = np.einsum("nij,jn->in", turn, mounted.place) + data.xpos[mounted.body].T
        rotation = np.einsum("nij,jkn->ikn", turn, mounted.rotation)
        base = plant.base_body
        axes = data.xmat[base].reshape(3, 3).T
        position = axes @ (position - data.xpos[base][:, np.newaxis])
        return position, np.einsum("ij,jkn->ikn", axes, rotation)
