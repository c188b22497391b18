"""The engine's model of a robot and its objects: read, completed and compiled."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from skin.errors import LibraryError, OptionError, SceneError
from skin.sim.grasping.object import GraspObject
from topology import Topology
from topology.pose import from_rpy
from topology.robot.mjcf import MissingMujocoError, mujoco_library

__all__ = ["compile_model", "engine_library", "name_of"]

SERVO_N_PER_M, SERVO_NM_PER_RAD = 2000.0, 2.0
"""Gains of servos for joints without an actuator [assumed: a small gripper, a finger]; with
critical damping for 0.1 kg and 1e-4 kg m²."""
TIED = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""`solimp` of mimic joints [numeric: error of 3 µm, by default 1.2 mm]."""


def engine_library() -> Any:
    """The module of MuJoCo; LibraryError, which names the extra, where it is not installed."""
    try:
        return mujoco_library()
    except MissingMujocoError as error:
        raise LibraryError(str(error)) from None


def name_of(model: Any, kind: str, index: int) -> str:
    """Name of a body, joint or actuator; its number if it has none."""
    return getattr(model, kind)(index).name or f"{kind}{index}"


def compile_model(
    path: Path, topology: Topology, objects: Sequence[GraspObject | str]
) -> tuple[Any, list[int]]:
    """A compiled model with the objects in it, and the bodies of these.

    Contacts of the engine between links with skin and the objects are excluded: the skin makes
    those forces.

    Parameters
    ----------
    path : Path
        MJCF or URDF.
    topology : Topology
        Its patches hang on links.
    objects : sequence of GraspObject or str
        New ones, and names of bodies of the model.

    Raises
    ------
    SceneError
        The model cannot be read, or an object is invalid.
    OptionError
        A name that the model does not have.
    """
    mujoco = engine_library()
    with _named(path):
        spec = mujoco.MjSpec.from_file(os.fspath(path))
    spec.compiler.fusestatic = False  # URDF would lose the links that are fixed
    names = _named_bodies(spec)
    for thing in objects:
        if isinstance(thing, GraspObject):
            if thing.name in names:
                raise OptionError(
                    f"objects: must have names of their own; got {thing.name!r}, a body of {path}"
                )
            _add(mujoco, spec, thing)
            names.append(thing.name)
        elif thing not in names:
            raise OptionError.unknown("objects", thing, names)
    links = [link for link in topology.patch_links if link]
    for link in links:
        if link not in names:
            raise OptionError.unknown(f"{path}: link of a patch", link, names)
    _leave_contacts(mujoco, spec, set(links))
    _tie_joints(mujoco, spec)
    _add_servos(mujoco, spec)
    with _named(path):
        model = spec.compile()
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    wanted = [thing.name if isinstance(thing, GraspObject) else thing for thing in objects]
    return model, [_checked(model, name) for name in wanted]


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Turn what the engine says about a model into a SceneError."""
    try:
        yield
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise SceneError(f"{path}: must be a model that MuJoCo reads; got: {reason}") from None


def _named_bodies(spec: Any) -> list[str]:
    """Names of all bodies, in order; those without one are given their number."""
    for i, body in enumerate(spec.bodies):
        if not body.name:
            body.name = f"body{i}"
    return [body.name for body in spec.bodies]


def _checked(model: Any, name: str) -> int:
    """The body of an object; SceneError where it has no mass or no surface."""
    body = model.body(name).id
    first, count = model.body_geomadr[body], model.body_geomnum[body]
    solid = [g for g in range(first, first + count)
             if model.geom_contype[g] or model.geom_conaffinity[g]]  # fmt: skip
    if not solid:
        raise SceneError(
            f"object {name!r}: must have a geom that collides (contype or conaffinity not 0); "
            f"got {count} geoms, none of which does"
        )
    if model.body_jntnum[body] and not model.body_mass[body] > 0.0:
        raise SceneError(f"object {name!r}: must have a mass above 0 kg; got 0")
    return body


def _add(mujoco: Any, spec: Any, thing: GraspObject) -> None:
    rotation = from_rpy(*np.radians(thing.rpy_deg))
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    body = spec.worldbody.add_body(
        name=thing.name, pos=list(thing.position_m), quat=quaternion.tolist()
    )
    body.add_freejoint()
    size = [*thing.size_m, 0.0, 0.0][:3]
    kinds = mujoco.mjtGeom
    shape: dict[str, Any] = {
        "type": getattr(kinds, f"mjGEOM_{thing.shape.upper()}"), "size": size
    }  # fmt: skip
    if thing.shape == "mesh":
        assert thing.file is not None
        spec.add_mesh(name=thing.name, file=str(Path(thing.file).resolve()), scale=size)
        shape = {"type": kinds.mjGEOM_MESH, "meshname": thing.name}
    body.add_geom(mass=thing.mass_kg, friction=[thing.friction, 0.005, 0.0001], **shape)


def _leave_contacts(mujoco: Any, spec: Any, links: set[str]) -> None:
    """Exclude all engine contacts between links with skin and other bodies, except those with geoms
    that the skin cannot touch."""
    left = {frozenset((pair.bodyname1, pair.bodyname2)) for pair in spec.excludes}
    for link in sorted(links):
        for body in spec.bodies:
            pair = frozenset((link, body.name))
            felt = all(g.type != mujoco.mjtGeom.mjGEOM_HFIELD for g in body.geoms)
            if len(pair) == 2 and pair not in left and felt and len(body.geoms):
                left.add(pair)
                spec.add_exclude(bodyname1=link, bodyname2=body.name)


def _tie_joints(mujoco: Any, spec: Any) -> None:
    """Couple mimic joints to micrometres, as the skin assumes, where the model does not set their
    softness: MuJoCo's default allows a millimetre under the force of a grasp."""
    for equality in spec.equalities:
        as_ever = np.array_equal(equality.solimp, mujoco.MjSpec().add_equality().solimp)
        if equality.type == mujoco.mjtEq.mjEQ_JOINT and as_ever:
            equality.solimp = TIED


def _add_servos(mujoco: Any, spec: Any) -> None:
    """Add a position servo to each joint of a model without actuators, such as a URDF, except mimic
    joints; targets have the limits of the joint."""
    if len(spec.actuators):
        return
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    gains = {slide: (SERVO_N_PER_M, 0.1), hinge: (SERVO_NM_PER_RAD, 1e-4)}
    tied = mujoco.mjtEq.mjEQ_JOINT
    following = {equality.name1 for equality in spec.equalities if equality.type == tied}
    for joint in spec.joints:
        if joint.type not in gains or joint.name in following:
            continue
        gain, inertia = gains[joint.type]
        servo = spec.add_actuator(
            name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED, biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        )  # fmt: skip
        servo.gainprm[0] = gain
        servo.biasprm[1], servo.biasprm[2] = -gain, -2.0 * (gain * inertia) ** 0.5
        limited = joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE
        if limited or (joint.limited == mujoco.mjtLimited.mjLIMITED_AUTO and any(joint.range)):
            servo.ctrllimited, servo.ctrlrange = True, joint.range
