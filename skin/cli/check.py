"""`skin check`: what a topology file says, whether its buses can carry it, and how it sits."""

from __future__ import annotations

import json as json_text
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from skin.cli import options
from skin.cli.table import columns

if TYPE_CHECKING:
    from topology import Topology
    from topology.robot.model import RobotModel
    from topology.summary import BusSummary, PatchSummary, Summary

__all__ = ["check"]

MOST_UNITS = 2000
"""Units of which the fields at each other's chips are looked at: more take some seconds."""


def check(
    file: Annotated[
        str | None, tyro.conf.Positional, options.quiet(options.FILE_HELP, metavar="[FILE]")
    ] = None,
    /,
    *,
    dbc: Annotated[
        Path | None,
        options.quiet("write a DBC file for each bus into this folder, for other CAN tools",
                      metavar="DIR"),
    ] = None,
    schema: Annotated[
        Literal["topology", "scene"] | None,
        options.quiet("print the JSON Schema of topology or scene files, for your editor",
                      metavar="{topology,scene}", constructor=Literal["topology", "scene"]),
    ] = None,
    json: options.Json = False,
) -> int:  # fmt: skip
    """Check a topology file: units, identifiers, frames, and the load of each bus at worst.

    Of a skin on a robot, lists the joints, and says which patches float, are buried or turned over,
    and what is wrong with the model: a mesh that is missing, a link without mass, millimetres.
    Exits with 1 if something is, if a bus cannot carry its cycle rate, or if units are nearer to
    each other than their magnets allow. If the file is wrong, exits with 2, after every problem
    with its line. DBC files are named after the skin and the bus (palm-main.dbc), and hold SYNC,
    the data frames with their scales, heartbeats and configuration.
    """
    import msgspec

    from skin.errors import OptionError
    from topology.load import builtin, load
    from topology.summary import summary

    if schema is not None:
        print(json_text.dumps(_schema(schema), indent=2))
        return 0
    if file is None:
        raise OptionError(
            "skin check: must have a file or the name of a ready-made topology "
            f"({', '.join(builtin)}); got none"
        )
    loaded = load(file, allow_overload=True)
    found = summary(loaded)
    print(_table(found))
    for hint in options.hints(file, loaded):
        print(f"\nnote: {hint}")
    robot = None if loaded.robot is None else _seat(loaded, loaded.robot)
    too_dense = _too_dense(loaded)
    problems = too_dense if robot is None else [*robot["problems"], *too_dense]
    for line in problems:
        print(f"\n{line}")
    files = [] if dbc is None else _write_dbc(loaded, dbc)
    ok = found.ok and not problems
    if json:
        more = {
            **options.without(loaded),
            "too_dense": too_dense,
            "robot": robot,
            "dbc": files,
            "ok": ok,
        }
        print(json_text.dumps(msgspec.to_builtins(found) | more))
    return 0 if ok else 1


def _schema(kind: str) -> dict[str, Any]:
    from topology.json_schema import json_schema

    if kind == "topology":
        return json_schema()
    from skin.sim.scenes.script import SceneFile

    return json_schema(SceneFile)


def _write_dbc(topology: Topology, folder: Path) -> list[dict[str, Any]]:
    """Write the DBC files, and say what is in each."""
    from bus.dbc import write_dbc

    written = write_dbc(topology, folder)
    rows = [(one.bus, str(one.messages), str(one.signals), str(one.path)) for one in written]
    print("\n" + "\n".join(columns(("bus", "messages", "signals", "file"), rows)))
    return [
        {"path": str(one.path.resolve()), "bus": one.bus, "messages": one.messages,
         "signals": one.signals}
        for one in written
    ]  # fmt: skip


def _too_dense(topology: Topology) -> list[str]:
    """What `skin.open` would refuse, as units are too near to each other."""
    from skin.decode.spacing import far_apart

    if far_apart(topology):
        return []
    if topology.n > MOST_UNITS:
        print(f"\nnote: whether {topology.n} units are too near to each other is seen at opening")
        return []
    from skin.compiling import announcer
    from skin.decode.density import sparse_enough
    from skin.errors import TooDenseError

    announcer()
    try:
        sparse_enough(topology)
    except TooDenseError as error:
        return str(error).splitlines()
    return []


def _seat(topology: Topology, robot: RobotModel) -> dict[str, Any]:
    """The robot of a skin, and how patches sit on it; its problems are not printed."""
    import msgspec

    from skin.errors import LibraryError
    from skin.robot.mount import check_model, check_patches

    limits = zip(robot.joint_names, robot.lower.tolist(), robot.upper.tolist(), strict=True)
    joints = [
        {"name": name, "lower": None if math.isnan(low) else low,
         "upper": None if math.isnan(high) else high}
        for name, low, high in limits
    ]  # fmt: skip
    print(f"\nrobot {robot.name}: {len(robot.names)} links, {len(joints)} joints")
    rows = [(one["name"], *("" if one[end] is None else f"{one[end]:.4g}"
             for end in ("lower", "upper"))) for one in joints]  # fmt: skip
    print("\n".join(columns(("joint", "from", "to (rad, m)"), rows)))
    try:
        problems, patches = check_model(robot), check_patches(topology)
    except LibraryError as error:
        print(f"\nnote: how the skin sits on the robot was not checked: {error}")
        problems, patches = [], []
    rows = [
        (patch.name, patch.link or "on the skin frame",
         "no shape to check against" if patch.distance_mm is None
         else f"{patch.distance_mm[0]:.2f} to {patch.distance_mm[1]:.2f} mm",
         "" if patch.tilt_deg is None else f"{patch.tilt_deg:.1f}°")
        for patch in patches
    ]  # fmt: skip
    print("\n" + "\n".join(columns(("patch", "link", "off its surface", "largest tilt"), rows)))
    return {
        "model": str(robot.path),
        "links": list(robot.names),
        "joints": joints,
        "patches": [msgspec.to_builtins(patch) for patch in patches],
        "problems": [*problems, *(text for patch in patches for text in patch.problems)],
    }


def _table(found: Summary) -> str:
    disabled = f", {found.disabled} disabled" if found.disabled else ""
    lines = [
        f"{found.name}: {found.units} units{disabled}, {found.frames} frames a cycle, "
        f"{found.neighbours:.1f} neighbours a unit",
        "",
        *columns(["bus", "units", "frames", "ids", "cycle", "load", "limit", "at most"],
                  [_bus_row(bus) for bus in found.buses]),
        "",
        *columns(["patch", "units", "layout", "bus", "ids", "nearest"],
                  [_patch_row(patch) for patch in found.patches]),
    ]  # fmt: skip
    for text in found.warnings:
        lines += ["", f"note: {text}"]
    for bus in found.buses:
        if not bus.ok:
            lines += [
                "",
                f"bus {bus.name!r} cannot carry {bus.cycle_rate_hz:g} Hz: worst-case load "
                f"{bus.load:.1%}, limit {bus.max_load:.1%}",
            ]
    return "\n".join(lines)


def _bus_row(bus: BusSummary) -> list[str]:
    rate = "" if bus.highest_rate_hz is None else f"{bus.highest_rate_hz:.1f} Hz"
    return [bus.name, str(bus.units), str(bus.frames), _ids(bus.ids), f"{bus.cycle_ms:.3f} ms",
            f"{bus.load:.1%} at {bus.cycle_rate_hz:g} Hz", f"{bus.max_load:.1%}", rate]  # fmt: skip


def _patch_row(patch: PatchSummary) -> list[str]:
    off = f" ({patch.disabled} off)" if patch.disabled else ""
    near = "" if patch.nearest_mm is None else f"{patch.nearest_mm:.2f} mm"
    return [patch.name, f"{patch.units}{off}", ", ".join(patch.layouts), ", ".join(patch.buses),
            _ids(patch.ids), near]  # fmt: skip


def _ids(ids: tuple[int, int] | None) -> str:
    return "" if ids is None else f"{ids[0]:#05x}–{ids[1]:#05x}"
