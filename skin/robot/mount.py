"""Whether the units of a skin sit on the surfaces of their links, with advice where they do not."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from skin.errors import LibraryError, SkinError
from skin.robot.joints import units_on_links
from skin.robot.mesh import distance_to, link_geoms, read_mesh, shape_triangles
from topology import Topology
from topology.robot.model import Geom, RobotModel

__all__ = ["PatchMount", "check_model", "check_patches"]

DISTANCE_MM = 10.0
"""Tolerance of the distance of a unit's sensing face to its link's surface [assumed: the height of
a unit and its mount]."""
TILT_DEG = 30.0
"""Tolerance of its normal to the surface's [assumed: a unit of 12 mm on a finger's rounding]."""
INVERTED_DEG = 150.0
"""Tilt above which a unit faces into its link [assumed]."""
LARGEST_M = 10.0
"""Size above which a robot is in millimetres [assumed: no hand or humanoid is larger]."""
LARGEST_SHAPE_M, SMALLEST_M = 3.0, 0.001
"""The same for a shape of a link; a robot or a mesh below the other was divided by 1000 in vain
[assumed]."""


class PatchMount(msgspec.Struct, frozen=True, kw_only=True):
    """Fit of a patch on its link."""

    name: str
    link: str
    """Empty on the skin frame."""
    units: int
    distance_mm: tuple[float, float] | None = None
    """Smallest and largest distance to the surface, negative inside; None without one."""
    tilt_deg: float | None = None
    """Largest angle between a unit's outward normal and the surface's."""
    problems: tuple[str, ...] = ()


def check_model(robot: RobotModel) -> list[str]:
    """Faults of a model, independent of the skin: scale, masses, meshes; with advice.

    Raises
    ------
    LibraryError
        trimesh is not installed, and there is a mesh.
    """
    found = []
    span = np.abs(robot.forward(robot.home)[:, :3, 3]).max()
    if span > LARGEST_M:
        found.append(
            f"{_at(robot)}: lengths must be metres; got links {span:.4g} m apart: if they are "
            "millimetres, divide every xyz of the model by 1000"
        )
    elif 0.0 < span < SMALLEST_M:
        found.append(
            f"{_at(robot)}: lengths must be metres; got links within {1e3 * span:.3g} mm: if they "
            "were divided by 1000 twice, multiply every xyz of the model by 1000"
        )
    carried = _carried(robot)
    for link, moved in zip(robot.links, carried, strict=True):
        if link.mass is not None and (link.mass < 0.0 or (link.mass == 0.0 and moved <= 0.0)):
            found.append(
                f"{_at(robot, link.line)}: link {link.name!r} mass: must be positive; got "
                f"{link.mass:g}: give its <inertial> the mass that the link has, or leave it out"
            )
    reported = set()
    for geom in robot.geoms:
        if geom.mesh is None or (geom.mesh, geom.scale) not in reported:
            reported.add((geom.mesh, geom.scale))
            found += _shape_problems(robot, geom)
    return found


def _carried(robot: RobotModel) -> np.ndarray:
    """Mass carried by each joint that moves, with all links fixed to it, shape (L,), kg; NaN where
    the model does not give it, and for fixed links."""
    carrier = list(range(len(robot.links)))
    carried = np.full(len(carrier), np.nan)
    for index, link in enumerate(robot.links):
        if link.driver >= 0 and link.name:
            carried[index] = 0.0
        elif link.parent >= 0:
            carrier[index] = carrier[link.parent]
        carried[carrier[index]] += link.mass or 0.0
    return carried


def _at(robot: RobotModel, line: int = 0) -> str:
    return f"{robot.path}:{line}" if line else str(robot.path)


def _shape_problems(robot: RobotModel, geom: Geom) -> list[str]:
    kind = "mesh" if geom.mesh is not None else geom.kind
    where = f"{_at(robot, geom.line)}: link {robot.links[geom.link].name!r} {kind}"
    extent = 2.0 * max(geom.size, default=0.0)
    advice = "divide its lengths by 1000"
    if geom.mesh is not None:
        try:
            triangles = read_mesh(Path(geom.mesh)) * np.array(geom.scale)
        except LibraryError:
            raise
        except SkinError as error:
            return [f"{where}: {error}: correct its filename, or bring the file"]
        extent = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
        advice = 'give it scale="0.001 0.001 0.001"'
        if extent < SMALLEST_M:
            return [f"{where}: must be in metres; got {extent:.3g} m across: if it is drawn in "
                    "metres, leave out its scale"]  # fmt: skip
    # a floor may belong to the root
    if extent > LARGEST_SHAPE_M and kind != "plane" and (geom.mesh is not None or geom.link):
        return [f"{where}: must be in metres; got {extent:.4g} m across: if it is drawn in "
                f"millimetres, {advice}"]  # fmt: skip
    return []


def check_patches(topology: Topology) -> list[PatchMount]:
    """Fit of each patch on its link: its collision shapes, or its visual ones if it has none.

    Raises
    ------
    SkinError
        The topology has no robot.
    LibraryError
        trimesh is not installed.
    """
    link, position, rotation = units_on_links(topology)
    robot = topology.robot
    assert robot is not None
    found = []
    for index, name in enumerate(topology.patch_names):
        units = np.flatnonzero(topology.patch == index)
        carrier = topology.patch_links[index]
        fit = PatchMount(name=name, link=carrier, units=units.size)
        triangles = _triangles(robot, int(link[units[0]])) if carrier else np.zeros((0, 3, 3))
        if len(triangles):
            distance, normal = distance_to(triangles, position[:, units])
            along = np.clip(np.sum(normal * -rotation[units, :, 2].T, axis=0), -1.0, 1.0)
            distance_mm, tilt = 1e3 * distance, np.degrees(np.arccos(along))
            names = [topology.unit_names[unit] for unit in units]
            fit = PatchMount(
                name=name, link=carrier, units=units.size,
                distance_mm=(float(distance_mm.min()), float(distance_mm.max())),
                tilt_deg=float(tilt.max()),
                problems=tuple(_problems(names, carrier, distance_mm, tilt)),
            )  # fmt: skip
        found.append(fit)
    return found


def _triangles(robot: RobotModel, link: int) -> np.ndarray:
    """Those of the readable shapes of a link, shape (f, 3, 3), in its frame."""
    parts = [np.zeros((0, 3, 3))]
    for geom in link_geoms(robot, link, visual=False):
        try:
            parts.append(shape_triangles(geom))
        except LibraryError:
            raise
        except SkinError:
            continue  # `check_model` reports it
    return np.concatenate(parts)


def _problems(
    names: list[str], link: str, distance_mm: np.ndarray, tilt_deg: np.ndarray
) -> list[str]:
    found = []
    worst = int(np.argmax(np.abs(distance_mm)))
    if abs(distance_mm[worst]) > DISTANCE_MM:
        side = "off" if distance_mm[worst] > 0.0 else "inside"
        count = int(np.count_nonzero(np.abs(distance_mm) > DISTANCE_MM))
        found.append(
            f"{names[worst]}: must be within {DISTANCE_MM:g} mm of the surface of {link!r}; got "
            f"{abs(distance_mm[worst]):.1f} mm {side} ({count} of {len(names)} units): correct the "
            "pose of the patch, whose lengths are metres in the link's frame"
        )
    worst = int(np.argmax(tilt_deg))
    if tilt_deg[worst] > TILT_DEG:
        count = int(np.count_nonzero(tilt_deg > TILT_DEG))
        inverted = np.median(tilt_deg) > INVERTED_DEG
        advice = (
            "its normals point into the link: turn the patch by rpy_deg = [180, 0, 0]"
            if inverted
            else "turn the patch, or bend it (cylinder, dome, list)"
        )
        found.append(
            f"{names[worst]}: must be tilted by at most {TILT_DEG:g}° to the surface of {link!r}; "
            f"got {tilt_deg[worst]:.1f}° ({count} of {len(names)} units): {advice}"
        )
    return found
