"""Plant: a robot with a skin, and objects, moved by MuJoCo and the forces of the skin.

These forces are explicit: a body of mass m on springs k oscillates at ``w = sqrt(k / m)``, and a
step above ``2 / w`` is unstable. For many bodies w² is at most the sum, over both bodies of a
contact, of the largest ``sum_i k_i (1 / m + r_i² / I)`` [Gershgorin].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from bus.compiled.jit import bound
from skin.errors import OptionError, SceneError
from skin.physics.force_law import at, slope
from skin.sim.grasping.model import compile_model, engine_library, name_of
from skin.sim.grasping.object import GraspObject
from skin.sim.grasping.records import Bodies, Mounted, Surfaces, Touch
from skin.sim.grasping.touch import DEEPEST_M, feel
from skin.sim.mechanics.rays import MESH, PLANE
from skin.sim.mechanics.springs import Springs
from topology import Topology

__all__ = ["Plant"]

FELT = (0, 2, 3, 4, 5, 6, 7)
"""Kinds of geom that a skin can touch: all except height fields."""

INSIDE_M = 1e-6
"""Largest depth of a unit in an object at the start [numeric]."""

SHARE = 0.6
"""Step relative to ``2 / w``, reduced for viscosity [numeric: a pinched box diverges between 1.6
and 2.0, a ball between 2.5 and 3.2, since w is a bound]."""

LONGEST_S = 2e-3
"""Longest step, without contact: that of MuJoCo's own models."""


class Plant:
    """Engine and skin, step by step.

    Parameters
    ----------
    path : Path
        Model of the robot: MJCF or URDF.
    topology : Topology
        Its patches hang on links of a robot.
    objects : sequence of GraspObject or str
    springs : Springs, optional
        Laws of the units; those of the topology if not given.
    mounted_at : tuple of ndarray, optional
        True poses of the units at home, shapes (3, n) and (3, 3, n), if they differ from the
        topology.

    Attributes
    ----------
    engine : module
    model, data : mujoco.MjModel, mujoco.MjData
    base_body : int
        Its frame is the skin's.
    objects : tuple of str
    object_bodies : ndarray, shape (o,), int32
    mounted, surfaces, bodies, touch : NamedTuple
        See `skin.sim.grasping.records`.
    pushes : ndarray, shape (b, 6)
        Other wrenches on the bodies: newton, and newton metre about the centre of mass.

    Raises
    ------
    SceneError, OptionError, LibraryError
        An invalid model or object; MuJoCo is not installed.
    """

    def __init__(
        self, path: Path, topology: Topology, objects: Sequence[GraspObject | str], *,
        springs: Springs | None = None,
        mounted_at: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> None:  # fmt: skip
        self.engine = mujoco = engine_library()
        self.topology = topology
        self.model, bodies = compile_model(path, topology, objects)
        self.objects = tuple(o.name if isinstance(o, GraspObject) else o for o in objects)
        self.object_bodies = np.array(bodies, np.int32)
        self.data = data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, data)
        self.bodies = Bodies(
            data.xpos, data.xipos, data.xmat, data.geom_xpos, data.geom_xmat, data.xfrc_applied
        )
        robot = topology.robot
        base = "" if robot is None else robot.link_names[robot.base]
        found = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, base)
        self.base_body = max(found, 0)
        self.mounted = _mounted(self.model, topology, springs, mounted_at)
        self.mounted.weight[...] = self._weights()
        self.surfaces = self._surfaces(objects)
        self.touch = Touch.nothing(topology.n)
        self.pushes = np.zeros((self.model.nbody, 6))
        self._rim_m = _rims(self.model)
        self._longest_s = min(LONGEST_S, float(self.model.opt.timestep))
        self._elapsed_s = np.zeros(1)
        self._feel = bound(
            feel, self.bodies, self.mounted, self.surfaces, self.touch, self._elapsed_s
        )
        self._begin()

    def advance(self, period_s: float) -> None:
        """Advance by a period, in the fewest steps that are stable for the present contacts."""
        step_s = self._longest_s
        units = np.flatnonzero(self.touch.body >= 0)
        if units.size:
            law = at(self.mounted.springs.normal, units)
            stiffness = 1e3 * np.maximum(slope(0.0, law), slope(1e3 * DEEPEST_M, law))
            square = 0.0
            for bodies in (self.mounted.body[units], self.touch.body[units]):
                sums = np.bincount(bodies, stiffness * self._inverse_masses()[bodies])
                square += float(sums.max())
            if square > 0.0:
                step_s = min(step_s, SHARE * 2.0 / math.sqrt(square))
        count = max(1, math.ceil(period_s / step_s * (1.0 - 1e-9)))
        for _ in range(count):
            self.step(period_s / count)

    def step(self, dt_s: float) -> None:
        """Advance the engine by one step, and compute the forces at its end."""
        mujoco, model, data = self.engine, self.model, self.data
        model.opt.timestep = dt_s
        mujoco.mj_step2(model, data)
        mujoco.mj_step1(model, data)
        data.xfrc_applied[:] = self.pushes
        self._elapsed_s[0] = dt_s
        self._feel()

    def look(self) -> None:
        """Compute and add the forces at the engine's current poses, for a step of 0."""
        self._elapsed_s[0] = 0.0
        self._feel()

    def set_mass(self, body: int, mass_kg: float) -> None:
        """Set the mass of a body, with the same distribution."""
        model = self.model
        before = float(model.body_mass[body])
        model.body_mass[body] = mass_kg
        model.body_inertia[body] *= mass_kg / before
        while True:
            model.body_subtreemass[body] += mass_kg - before
            if body == 0:
                break
            body = int(model.body_parentid[body])

    def wrench_on(self, body: int) -> np.ndarray:
        """Wrench of the skin on a body, shape (6,): newton, and newton metre about its centre of
        mass."""
        return self.data.xfrc_applied[body] - self.pushes[body]

    def velocity_of(self, body: int) -> np.ndarray:
        """Velocity of the centre of mass of a body, and its turning, shape (6,), frame of the
        world."""
        found, kind = np.zeros(6), self.engine.mjtObj.mjOBJ_BODY
        self.engine.mj_objectVelocity(self.model, self.data, kind, body, found, 0)
        return np.roll(found, 3)  # the engine has the turning first

    def energy_j(self) -> float:
        """Kinetic and potential energy, including that of the elastomer."""
        self.engine.mj_energyPos(self.model, self.data)
        self.engine.mj_energyVel(self.model, self.data)
        return float(self.data.energy.sum() + self.touch.energy_j.sum())

    def _begin(self) -> None:
        """Find contacts at the start: contacts between links are excluded, as they are joined
        there; an object must not be in contact."""
        self.engine.mj_step1(self.model, self.data)
        start = Touch.nothing(self.topology.n)
        scratch = self.bodies._replace(wrench=np.zeros((self.model.nbody, 6)))
        surfaces, mounted = self.surfaces, self.mounted
        for _ in range(self.model.nbody):
            feel(scratch, mounted, surfaces, start, np.zeros(1))
            deep = np.flatnonzero(1e-3 * start.tip_mm[2] > INSIDE_M)
            if not deep.size:
                break
            for unit in deep:
                self._joined(int(unit), int(start.body[unit]), 1e-3 * float(start.tip_mm[2, unit]))
        self.look()

    def _joined(self, unit: int, body: int, depth_m: float) -> None:
        if body in self.object_bodies or not self.model.body_weldid[body]:
            raise SceneError(
                f"object {name_of(self.model, 'body', body)!r}: must start outside the skin; got "
                f"{1e3 * depth_m:.2f} mm inside it at {self.topology.unit_names[unit]}: move it, "
                "or open the hand"
            )
        same = self.mounted.body == self.mounted.body[unit]
        self.mounted.weight[np.ix_(same, self.surfaces.body == body)] = 0.0

    def _inverse_masses(self) -> np.ndarray:
        """Inverse mass of every body at its rim, shape (b,), 1/kg: at most the trace of its inverse
        inertia there."""
        middle, rotational = self.model.body_invweight0.T
        of_free = middle + rotational * self._rim_m**2
        of_link = 3.0 * middle  # the mean over directions, of which one may have the whole sum
        return np.where(self.model.body_dofnum == 6, of_free, of_link)

    def _weights(self) -> np.ndarray:
        """Effect of each unit on each geom, shape (n, g)."""
        model = self.model
        links = set(self.mounted.body.tolist())
        tree = model.body_rootid[self.mounted.body[0]] if self.topology.n else -1
        weight = np.zeros((self.topology.n, model.ngeom))
        for g in range(model.ngeom):
            solid = model.geom_contype[g] or model.geom_conaffinity[g]
            if not solid or model.geom_type[g] not in FELT:
                continue
            body = int(model.geom_bodyid[g])
            of_robot = body != 0 and model.body_rootid[body] == tree
            weight[:, g] = 0.5 if body in links else 1.0
            near = {body, int(model.body_parentid[body])} if of_robot else {body}
            for link in links:
                if link in near or (of_robot and model.body_parentid[link] == body):
                    weight[self.mounted.body == link, g] = 0.0
        return weight

    def _surfaces(self, objects: Sequence[GraspObject | str]) -> Surfaces:
        model = self.model
        kind = np.array(model.geom_type, np.int32)
        static = np.array(model.geom_friction[:, 0])
        kinetic, compliance = static.copy(), np.zeros(model.ngeom)
        for thing, body in zip(objects, self.object_bodies, strict=True):
            own = model.geom_bodyid == body
            if isinstance(thing, GraspObject):
                static[own] = thing.friction
                kinetic[own] = thing.friction * thing.kinetic_share
                compliance[own] = thing.compliance_mm_per_n
        return Surfaces(
            kind, np.array(model.geom_bodyid, np.int32), np.array(model.geom_size),
            np.where(kind == PLANE, np.inf, model.geom_rbound), static, kinetic, compliance,
            *_hulls(model),
        )  # fmt: skip


def _hulls(model: Any) -> tuple[np.ndarray, np.ndarray]:
    """Faces of the convex hull of each mesh, by which the engine has contacts too, shape (p, 4),
    frame of the geom, and the first face of each geom and the first behind it, shape (g, 2)."""
    planes, of_geom = [np.zeros((0, 4))], np.zeros((model.ngeom, 2), np.int64)
    count = 0
    for g in np.flatnonzero(model.geom_type == MESH):
        mesh = model.geom_dataid[g]
        first = model.mesh_vertadr[mesh]
        corners = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        planes.append(np.unique(ConvexHull(corners).equations.round(9), axis=0))
        of_geom[g] = count, count + len(planes[-1])
        count += len(planes[-1])
    return np.concatenate(planes), of_geom


def _rims(model: Any) -> np.ndarray:
    """Radius about the centre of mass of each body within which its geoms are, shape (b,)."""
    radius = np.zeros(model.nbody)
    off = np.linalg.norm(model.geom_pos - model.body_ipos[model.geom_bodyid], axis=1)
    np.maximum.at(
        radius, model.geom_bodyid, np.where(model.geom_rbound, off + model.geom_rbound, 0)
    )
    return radius


def _mounted(
    model: Any, topology: Topology, springs: Springs | None,
    mounted_at: tuple[np.ndarray, np.ndarray] | None,
) -> Mounted:  # fmt: skip
    """Poses of the units on their links, from those in the base frame at home."""
    robot = topology.robot
    if robot is None or not all(topology.patch_links):
        floating = [name for name, link in zip(topology.patch_names, topology.patch_links,
                                               strict=True) if not link]  # fmt: skip
        raise OptionError(
            f"{topology.path or topology.name}: must have [robot] model and a link for every patch "
            f"to be simulated on a robot; got none for {floating or list(topology.patch_names)}"
        )
    position, rotation = mounted_at or (topology.position, topology.rotation)
    poses = robot.forward(robot.home)
    link = np.array([robot.link_names.index(name) for name in topology.patch_links])
    T_base_link = poses[link[topology.patch]]
    turn = T_base_link[:, :3, :3]
    body = np.array([model.body(name).id for name in topology.patch_links], np.int32)
    return Mounted(
        np.ascontiguousarray(body[topology.patch]),
        np.ascontiguousarray(np.einsum("nji,nj->in", turn, position.T - T_base_link[:, :3, 3])),
        np.ascontiguousarray(np.einsum("nji,jkn->ikn", turn, rotation)),
        np.zeros((topology.n, model.ngeom)),
        Springs.of(topology) if springs is None else springs,
    )
