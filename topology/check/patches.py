"""Patches: references that exist, and shapes that can be built."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topology import pose
from topology.check.frames import to_transform
from topology.check.names import check_name, entries, refer
from topology.layout import Placement, count, place
from topology.parts import Parts
from topology.report import Report
from topology.schema import Cylinder, Dome, List, ListUnit, Patch
from topology.source import Key, Source

__all__ = ["MOST_UNITS", "Placed", "place_patches"]

MOST_UNITS = 100_000
"""More units are refused: at 250 Hz a bus carries 90, so a file that has more is mistaken."""

_NOT_SHAPE = {"name", "bus", "layout", "model", "frame", "pose", "extended", "calibration",
              "first_id"}  # fmt: skip


@dataclass(frozen=True)
class Placed:
    """A patch whose units stand.

    Attributes
    ----------
    key : Key
        Its table in the file.
    patch : Patch
    units : Placement
        In the skin frame; in the patch frame where the pose is wrong.
    fixed : bool
        Whether the pose is sound.
    turn : ndarray, shape (3, 3), float64
        R_skin_patch.
    """

    key: Key
    patch: Patch
    units: Placement
    fixed: bool
    turn: np.ndarray


def place_patches(parts: Parts, report: Report) -> list[Placed]:
    """Place every patch whose shape is sound; whatever else is wrong with it is reported too."""
    source = parts.source
    known = {
        "bus": parts.buses,
        "layout": parts.layouts,
        "model": parts.models,
        "frame": parts.frames,
    }
    first: dict[str, Key] = {}
    placed = []
    total = 0
    for key, patch in entries(parts.file, "patches"):
        named = report.sound(source, key, "name")
        if named:
            check_name(patch.name, key, first, (), source, report)
        for field, names in known.items():
            if report.sound(source, key, field):
                at = (*key, field)
                refer(getattr(patch, field), f"a {field}", names, at, source, report)
        own = to_transform(patch.pose, (*key, "pose"), source, report)
        base = parts.frames.get(patch.frame) if report.sound(source, key, "frame") else None
        if not _check_shape(patch, key, source, report):
            continue
        if total + count(patch) > MOST_UNITS:
            report.add("too-many", source, key, limit=MOST_UNITS, got=total + count(patch))
            continue
        total += count(patch)
        units = place(patch)
        fixed = own is not None and base is not None
        at = pose.compose(base, own) if fixed else pose.IDENTITY
        rotation, position = pose.compose(at, (units.rotation, units.position))
        if named and first[patch.name] == key:
            names = _check_unit_names(patch, key, units.names, source, report)
            units = Placement(names, position, rotation)
            placed.append(Placed(key, patch, units, fixed, at[0]))
    return placed


def _check_unit_names(
    patch: Patch, key: Key, names: tuple[str, ...], source: Source, report: Report
) -> tuple[str, ...]:
    if isinstance(patch, List) and len(set(names)) < len(names):
        first: dict[str, Key] = {}
        for index, name in enumerate(names):
            check_name(name, (*key, "units", index), first, (), source, report)
    return names


def _check_shape(patch: Patch, key: Key, source: Source, report: Report) -> bool:
    shape = {"kind", *patch.__struct_fields__} - _NOT_SHAPE
    if isinstance(patch, List):
        return _check_list(patch, key, source, report)
    if not report.sound(source, key, *shape):
        return False
    match patch:
        case Cylinder():
            around = int(2 * np.pi * patch.radius_m / patch.pitch_m + 1e-6)
            if patch.columns > around:
                report.add("around", source, (*key, "columns"), limit=around, got=patch.columns)
        case Dome():
            far = int(np.pi * patch.radius_m / patch.pitch_m - 0.5)
            if patch.rings > far:
                report.add("far-side", source, (*key, "rings"), limit=far, got=patch.rings)
    return report.sound(source, key, *shape)


def _check_list(patch: List, key: Key, source: Source, report: Report) -> bool:
    for index, unit in enumerate(patch.units or ()):
        if unit is not None:
            _check_axes(unit, (*key, "units", index), source, report)
    if not report.sound(source, key, "kind") or not patch.units or None in patch.units:
        return False
    at = (*key, "units")
    return report.sound(source, at) or all(
        report.sound(source, (*at, i), "xyz_m", "normal", "x_axis")
        for i in range(len(patch.units))
    )  # fmt: skip


def _check_axes(unit: ListUnit, at: Key, source: Source, report: Report) -> None:
    if not report.sound(source, at, "normal", "x_axis"):
        return
    length = np.linalg.norm(unit.normal)
    if length == 0:
        report.add("direction", source, (*at, "normal"))
    elif unit.x_axis is not None:
        across = np.linalg.norm(np.cross(unit.x_axis, unit.normal))
        if not any(unit.x_axis):
            report.add("direction", source, (*at, "x_axis"))
        elif across < 1e-6 * length * np.linalg.norm(unit.x_axis):
            report.add("x-axis", source, (*at, "x_axis"))
