"""Patches: valid references and shapes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from topology import pose
from topology.check.frames import to_transform
from topology.check.names import all_named, check_name, entries, refer
from topology.check.robot import place_on_link
from topology.layout import Placement, count, overfull, place, widest_pitch_m
from topology.parts import Parts
from topology.report import Report
from topology.schema import Cylinder, Dome, List, ListUnit, Patch
from topology.source import Key, Source

__all__ = ["MOST_UNITS", "Placed", "place_patches"]

MOST_UNITS = 100_000
"""Upper bound of units: at 250 Hz a bus carries 90, so a larger number is a mistake."""

SHORTEST_AXIS = 1e-6

PLACE = ("xyz_m", "normal", "x_axis")
STAND_IN = ListUnit(xyz_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))

TABLES = {"bus": "buses", "layout": "layouts", "model": "models", "frame": "frames"}

_NOT_SHAPE = {"name", "bus", "layout", "model", "frame", "link", "pose", "extended", "calibration",
              "first_id"}  # fmt: skip


@dataclass(frozen=True)
class Placed:
    """A patch with its units.

    Attributes
    ----------
    key : Key
        Its table in the file.
    patch : Patch
    units : Placement
        In the skin frame; in the patch frame where the pose is invalid.
    fixed : ndarray, shape (n,), bool
        Whether the place of each unit is valid.
    turn : ndarray, shape (3, 3), float64
        R_skin_patch.
    """

    key: Key
    patch: Patch
    units: Placement
    fixed: np.ndarray
    turn: np.ndarray


def place_patches(parts: Parts, report: Report) -> list[Placed]:
    """Place every patch with a valid shape; other faults are reported as well."""
    source = parts.source
    known = {
        "bus": parts.buses,
        "layout": parts.layouts,
        "model": parts.models,
        "frame": parts.frames,
    }
    complete = {
        field: all_named(table, parts.file, source, report) for field, table in TABLES.items()
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
                name = getattr(patch, field)
                refer(name, f"a {field}", names, at, source, report, complete[field])
        own = to_transform(patch.pose, (*key, "pose"), source, report)
        base = _carrier(patch, key, parts, report)
        if not _check_shape(patch, key, source, report):
            continue
        total += count(patch)
        if total > MOST_UNITS:
            report.add("too-many", source, key, limit=MOST_UNITS, got=total)
            total -= count(patch)
            continue
        if not named or first[patch.name] != key:
            continue
        sane, fixed = _without_faulty(patch, key, source, report)
        units = place(sane)
        if len(set(units.names)) < len(units.names):
            _check_unit_names(units.names, key, source, report)
        known_pose = own is not None and base is not None
        at = pose.IDENTITY if own is None or base is None else pose.compose(base, own)
        rotation, position = pose.compose(at, (units.rotation, units.position))
        units = Placement(units.names, position, rotation)
        placed.append(Placed(key, sane, units, fixed & known_pose, at[0]))
    return placed


def _carrier(patch: Patch, key: Key, parts: Parts, report: Report) -> pose.Transform | None:
    """T_skin_frame of a patch's parent; None where it is invalid."""
    source = parts.source
    if patch.link is not None:
        robot = parts.file.robot
        return place_on_link(patch.link, key, "frame", robot, parts.links, source, report)
    return parts.frames.get(patch.frame) if report.sound(source, key, "frame", "link") else None


def _check_unit_names(names: tuple[str, ...], key: Key, source: Source, report: Report) -> None:
    first: dict[str, Key] = {}
    for index, name in enumerate(names):
        check_name(name, (*key, "units", index), first, (), source, report)


def _check_shape(patch: Patch, key: Key, source: Source, report: Report) -> bool:
    """Whether a patch can be built: a list if it has units, valid or not."""
    if isinstance(patch, List):
        for index, unit in enumerate(patch.units or ()):
            if unit is not None:
                _check_axes(unit, (*key, "units", index), source, report)
        return bool(patch.units) and report.sound(source, key, "kind")
    shape = {"kind", *patch.__struct_fields__} - _NOT_SHAPE
    if not report.sound(source, key, *shape):
        return False
    if (over := overfull(patch)) is not None:
        name, limit = over
        if limit < 1 and isinstance(patch, Cylinder | Dome):  # no number of them would do
            report.add("pitch-round", source, (*key, "pitch_m"), most=widest_pitch_m(patch),
                       shape=type(patch).__name__.lower(), radius=patch.radius_m,
                       got=patch.pitch_m)  # fmt: skip
        else:
            code = "around" if name == "columns" else "far-side"
            report.add(code, source, (*key, name), limit=limit, got=getattr(patch, name))
    return report.sound(source, key, *shape)


def _without_faulty(
    patch: Patch, key: Key, source: Source, report: Report
) -> tuple[Patch, np.ndarray]:
    """A list with a stand-in for every unit whose place is wrong, and a mask of the others."""
    at = (*key, "units")
    if not isinstance(patch, List) or report.sound(source, at):
        return patch, np.ones(count(patch), bool)
    units, fixed = [], []
    for i, unit in enumerate(patch.units):
        given = unit or STAND_IN
        fixed.append(unit is not None and report.sound(source, (*at, i), *PLACE))
        stand_in = msgspec.structs.replace(STAND_IN, name=given.name, id=given.id, slot=given.slot)
        units.append(given if fixed[-1] else stand_in)
    return msgspec.structs.replace(patch, units=tuple(units)), np.array(fixed)


def _check_axes(unit: ListUnit, at: Key, source: Source, report: Report) -> None:
    if not report.sound(source, at, "normal", "x_axis"):
        return
    axes = {"normal": unit.normal, "x_axis": unit.x_axis}
    for name, axis in axes.items():
        if axis is not None and math.hypot(*axis) < SHORTEST_AXIS:
            report.add("direction", source, (*at, name), length=math.hypot(*axis))
    if unit.x_axis is not None and report.sound(source, at, "normal", "x_axis"):
        across = math.hypot(*np.cross(unit.x_axis, unit.normal))
        if across < 1e-6 * math.hypot(*unit.normal) * math.hypot(*unit.x_axis):
            report.add("x-axis", source, (*at, "x_axis"))
