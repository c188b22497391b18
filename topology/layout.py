"""Places of the units of a patch: grid, hex, cylinder, dome, list.

Every patch is centred: the middle of its units (the apex of a curved patch) is at the origin of the
patch frame, and the outward normal there is the patch's +z. So a curved patch becomes the flat one
as its radius grows. The unit frame has z *into* the skin:

- grid, hex: x_unit = x_patch, y_unit = -y_patch, z_unit = -z_patch;
- cylinder (axis along y_patch): x_unit goes around, y_unit = -y_patch;
- dome: x_unit points away from the apex along the meridian (of the apex unit: x_patch).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topology.pose import from_axes
from topology.schema import Cylinder, Dome, Grid, Hex, List, Patch

__all__ = ["Placement", "count", "overfull", "place", "widest_pitch_m"]

HEX_ROW = np.sqrt(0.75)


@dataclass(frozen=True)
class Placement:
    """Units of one patch in the patch frame.

    Attributes
    ----------
    names : tuple of str, length n
        "r3c4" (rows and columns), "17", or the name given in the file.
    position : ndarray, shape (3, n), float64
        Metre, patch frame.
    rotation : ndarray, shape (3, 3, n), float64
        Columns are the unit's axes in the patch frame.
    """

    names: tuple[str, ...]
    position: np.ndarray
    rotation: np.ndarray


def count(patch: Patch) -> int:
    """Number of units of a patch, without placing them."""
    match patch:
        case List():
            return len(patch.units)
        case Dome():
            return int(_rings(patch).sum())
        case _:
            return patch.rows * patch.columns


def overfull(patch: Patch) -> tuple[str, int] | None:
    """The key of a curved patch with more units than its shape has room for, and that room."""
    match patch:
        case Cylinder():
            around = int(2 * np.pi * patch.radius_m / patch.pitch_m + 1e-6)
            return ("columns", around) if patch.columns > around else None
        case Dome():
            far = max(int(np.pi * patch.radius_m / patch.pitch_m - 0.5), 0)
            return ("rings", far) if patch.rings > far else None
    return None


def widest_pitch_m(patch: Cylinder | Dome) -> float:
    """The widest pitch that leaves room for one column around a cylinder, or one ring of a dome."""
    return np.pi * patch.radius_m * (2.0 if isinstance(patch, Cylinder) else 1.0 / 1.5)


def place(patch: Patch) -> Placement:
    """Place the units of a patch: row by row, ring by ring, or as listed."""
    match patch:
        case List():
            return _place_list(patch)
        case Dome():
            return _place_dome(patch)
        case _:
            return _place_rows(patch)


def _row_pitch(patch: Grid | Hex | Cylinder) -> float:
    """Distance of the rows, metres."""
    given = getattr(patch, "row_pitch_m", None)
    if given is not None:
        return given
    return patch.pitch_m * (HEX_ROW if _staggered(patch) else 1.0)


def _staggered(patch: Grid | Hex | Cylinder) -> bool:
    return isinstance(patch, Hex) or (isinstance(patch, Cylinder) and patch.stagger)


def _place_rows(patch: Grid | Hex | Cylinder) -> Placement:
    row, column = (a.ravel() for a in np.indices((patch.rows, patch.columns)))
    names = tuple(f"r{r}c{c}" for r in range(patch.rows) for c in range(patch.columns))
    across = column + 0.5 * (row % 2) * _staggered(patch)
    x = patch.pitch_m * (across - (across.min() + across.max()) / 2)
    y = _row_pitch(patch) * (row - (patch.rows - 1) / 2)
    zero = np.zeros_like(x)
    if isinstance(patch, Cylinder):
        angle = x / patch.radius_m
        normal = np.stack([np.sin(angle), zero, np.cos(angle)])
        around = np.stack([np.cos(angle), zero, -np.sin(angle)])
        position = patch.radius_m * normal
        position[1] = y
        position[2] -= patch.radius_m
    else:
        position = np.stack([x, y, zero])
        normal = np.stack([zero, zero, zero + 1])
        around = np.stack([zero + 1, zero, zero])
    return Placement(names, position, from_axes(normal, around))


def _rings(patch: Dome) -> np.ndarray:
    """Units in each ring: as many as keep the straight distance of the rings, at most 6 k."""
    k = np.arange(1, patch.rings + 1)
    step = patch.pitch_m / patch.radius_m
    polar = step * k
    room = np.sin(step / 2) / np.maximum(np.sin(polar), 1e-9)
    fit = np.floor(np.pi / np.arcsin(np.clip(room, 0, 1)) + 1e-9)
    return np.concatenate([[1], np.clip(fit, 1, 6 * k)]).astype(int)


def _place_dome(patch: Dome) -> Placement:
    rings = _rings(patch)
    ring = np.repeat(np.arange(rings.size), rings)
    turn = np.concatenate([np.arange(m) / m for m in rings])
    # Odd rings are rotated by half a step, so that their units sit in the gaps of the ring before.
    longitude = 2 * np.pi * (turn + 0.5 * (ring % 2) / rings[ring])
    polar = patch.pitch_m / patch.radius_m * ring
    cos, sin = np.cos(longitude), np.sin(longitude)
    normal = np.stack([np.sin(polar) * cos, np.sin(polar) * sin, np.cos(polar)])
    meridian = np.stack([np.cos(polar) * cos, np.cos(polar) * sin, -np.sin(polar)])
    position = patch.radius_m * normal
    position[2] -= patch.radius_m
    return Placement(tuple(map(str, range(ring.size))), position, from_axes(normal, meridian))


def _place_list(patch: List) -> Placement:
    units = patch.units
    position = np.array([u.xyz_m for u in units]).T
    normal = np.array([u.normal for u in units]).T
    normal = normal / np.linalg.norm(normal, axis=0)
    upright = np.where(np.abs(normal[0]) < 0.9, 0, 1)  # x of the patch, or y near the normal
    x_axis = np.eye(3)[:, upright]
    for i, unit in enumerate(units):
        if unit.x_axis is not None:
            x_axis[:, i] = unit.x_axis
    names = tuple(u.name or str(i) for i, u in enumerate(units))
    return Placement(names, position, from_axes(normal, x_axis))
