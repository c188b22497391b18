"""Patches for the fingertips of a robot, from the shapes of its links: to start a topology from."""

from __future__ import annotations

import itertools
import math
import re
import warnings
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from skin.errors import OptionError
from skin.robot.mesh import link_geoms, shape_triangles
from topology.robot.model import Geom, RobotModel

__all__ = ["PITCH_M", "Proposal", "cylinder", "dome", "grid", "proposed"]

PITCH_M = 0.012
"""Straight distance of neighbouring units: their films touch [paper: units of 12 mm]."""


LEAST_M, MOST_M = 0.001, 0.5
"""Smallest and largest sizes of a fingertip [assumed: models in millimetres are beyond]."""
LONGEST_NAME = 40


class Proposal(NamedTuple):
    """A patch: its shape, and where it is on its link."""

    name: str
    shape: dict[str, str | float | int]
    """Keys of the patch in a topology file, `kind` first."""
    reason: str = ""
    """Where its sizes are from."""
    link: str = ""
    xyz_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    rpy_deg: tuple[float, ...] = (0.0, 0.0, 0.0)


def grid(rows: int, columns: int) -> dict[str, str | float | int]:
    """A flat patch."""
    return {"kind": "grid", "rows": rows, "columns": columns, "pitch_m": PITCH_M}


def cylinder(radius_m: float, rows: int, columns: int) -> dict[str, str | float | int]:
    """A grid around an axis."""
    return {
        "kind": "cylinder", "radius_m": _rounded(radius_m), "rows": rows, "columns": columns,
        "pitch_m": _arc_m(radius_m), "row_pitch_m": PITCH_M,
    }  # fmt: skip


def dome(radius_m: float) -> dict[str, str | float | int]:
    """A cap with as many rings as half a sphere has room for."""
    pitch_m = _arc_m(radius_m)
    rings = int(0.5 * math.pi * radius_m / pitch_m + 1e-6)
    return {"kind": "dome", "radius_m": _rounded(radius_m), "rings": rings, "pitch_m": pitch_m}


def proposed(robot: RobotModel, taken: Collection[str] = ()) -> list[Proposal]:
    """A patch for each fingertip: a link with shapes, beyond which no other link has any.

    The largest shape for contacts of the link decides: a sphere, the end of a capsule or an
    ellipsoid gets a dome, a cylinder half of its side, a box or a mesh its largest face. Which side
    of a finger touches things, no model says: the pose is to be looked at. Patches are named after
    their links, and otherwise than those `taken`.

    Raises
    ------
    OptionError
        No link has a shape that a patch fits on, or one is no fingertip by its size.
    LibraryError, SkinError
        A mesh cannot be read.
    """
    shaped = {geom.link for geom in robot.geoms if geom.kind != "plane"}
    inner = set[int]()
    for link in shaped:
        above = robot.links[link].parent
        while above >= 0:
            inner.add(above)
            above = robot.links[above].parent
    found, names = list[Proposal](), {*taken}
    for link in sorted(shaped - inner):
        sized = [(_size(geom), geom) for geom in link_geoms(robot, link, visual=False)]
        _, largest = max(sized, key=lambda one: one[0])
        one = _on_shape(robot.links[link].name, largest)
        name = same = one.name
        for number in itertools.count(2):
            if name not in names:
                break
            name = f"{same}_{number}"
        names.add(name)
        found.append(one._replace(name=name))
    if not found:
        raise OptionError(f"--robot: {robot.path}: must have links with shapes; got none")
    return found


def _on_shape(link: str, geom: Geom) -> Proposal:
    """The patch on a shape of a link."""
    _check_size(link, geom)
    turn, middle = np.array(geom.rotation).reshape(3, 3), np.array(geom.xyz)
    away = middle if np.linalg.norm(middle) > 1e-6 else turn[:, 2]
    away = away / np.linalg.norm(away)  # from the joint to the tip
    reason = f"by the {geom.kind} of the link"
    match geom.kind:
        case "sphere" | "ellipsoid":
            radius = min(geom.size)
            shape, outward, place = dome(radius), away, middle + radius * away
        case "capsule":
            radius, half = geom.size
            end = turn[:, 2] * math.copysign(1.0, turn[:, 2] @ away)
            shape, outward, place = dome(radius), end, middle + (half + radius) * end
        case "cylinder":
            radius, half = geom.size
            shape = cylinder(radius, _many(2.0 * half), _many(math.pi * radius))
            outward, place = turn[:, 0], middle + radius * turn[:, 0]
            return _placed(link, shape, reason, outward, turn[:, 2], place)
        case _:
            low, high = _bounds(geom)
            size, centre = high - low, 0.5 * (low + high)
            if geom.kind != "mesh":
                size, centre = 2.0 * np.array(geom.size), np.zeros(3)
            else:
                turn, middle = np.eye(3), np.zeros(3)  # bounds are those in the link's frame
            x, y, z = np.argsort(-size)
            shape = grid(_many(float(size[y])), _many(float(size[x])))
            side = turn[:, z]
            place = middle + turn @ centre + 0.5 * size[z] * side
            return _placed(link, shape, reason, side, turn[:, y], place)
    across = np.eye(3)[int(np.argmin(np.abs(outward)))]
    return _placed(link, shape, reason, outward, np.cross(outward, across), place)


def _check_size(link: str, geom: Geom) -> None:
    """Refuse shapes that are no fingertip."""
    sizes = np.array(geom.size)
    if geom.kind == "mesh":
        low, high = _bounds(geom)
        sizes = 0.5 * (high - low)
    radius = {
        "sphere": sizes[0],
        "ellipsoid": min(sizes),
        "capsule": sizes[0],
        "cylinder": sizes[0],
    }
    least, length = radius.get(geom.kind, LEAST_M), 2.0 * max(sizes)
    got = f"{length:g} m" if length > MOST_M else f"{least:g} m"
    if not LEAST_M <= least <= length <= MOST_M:
        raise OptionError(
            f"--robot: link {link!r}: a fingertip must be {LEAST_M:g} m in radius at least and "
            f"{MOST_M:g} m long at most; got a {geom.kind} of {got} (lengths of models are metres)"
        )


def _placed(
    link: str, shape: dict[str, str | float | int], reason: str, outward: np.ndarray,
    along: np.ndarray, place: np.ndarray,
) -> Proposal:  # fmt: skip
    """A patch whose z points outward and whose y is along a direction across it."""
    y = along / np.linalg.norm(along)
    axes = np.column_stack([np.cross(y, outward), y, outward])
    with warnings.catch_warnings():  # an upright side: roll and yaw turn about one axis
        warnings.filterwarnings("ignore", "Gimbal lock")
        angles = Rotation.from_matrix(axes).as_euler("xyz", degrees=True)
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", link).lstrip(".-")[:LONGEST_NAME] or "tip"
    return Proposal(name, shape, reason, link, tuple(map(_rounded, place)),
                    tuple(round(float(angle), 2) + 0.0 for angle in angles))  # fmt: skip


def _bounds(geom: Geom) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest coordinates, shape (3,)."""
    corners = shape_triangles(geom).reshape(-1, 3)
    return corners.min(axis=0), corners.max(axis=0)


def _size(geom: Geom) -> float:
    """About the volume of a shape, m³."""
    match geom.kind:
        case "box" | "ellipsoid":
            return 8.0 * math.prod(geom.size)
        case "sphere":
            return 8.0 * geom.size[0] ** 3
        case "capsule" | "cylinder":
            return 8.0 * geom.size[0] ** 2 * (geom.size[1] + geom.size[0])
        case "mesh":
            low, high = _bounds(geom)
            return float(np.prod(high - low))
    return 0.0


def _many(length_m: float) -> int:
    """Units along a length, one at least."""
    return max(int(length_m / PITCH_M + 1e-6), 1)


def _arc_m(radius_m: float) -> float:
    """Distance along an arc of units whose straight distance is the pitch; one unit alone has the
    whole of a small ball."""
    half = min(0.5 * PITCH_M / radius_m, 1.0)
    return _rounded(2.0 * radius_m * math.asin(half) + 5e-6)


def _rounded(metres: float) -> float:
    """To a hundredth of a millimetre."""
    return round(float(metres), 5) + 0.0
