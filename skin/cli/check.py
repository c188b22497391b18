"""`skin check`: what a topology file says, whether its buses can carry it, and how it sits."""

from __future__ import annotations

import json as json_text
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from skin.cli import options
from skin.cli.table import table

if TYPE_CHECKING:
    from topology import Topology
    from topology.robot.model import RobotModel

__all__ = ["check"]

TABLES = {
    "buses": ("name", "units", "frames", "ids", "cycle_ms", "load", "max_load",
              "highest_rate_hz"),
    "patches": ("name", "units", "disabled", "layouts", "buses", "ids", "nearest_mm"),
    "joints": ("name", "lower", "upper"),
    "seats": ("name", "link", "distance_mm", "tilt_deg"),
    "dbc": ("bus", "messages", "signals", "path"),
}  # fmt: skip
"""Parts of the report that people see as tables, and their columns."""


def check(
    file: Annotated[str | None, tyro.conf.Positional, options.arg("[FILE]")] = None,
    /,
    *,
    dbc: Annotated[Path | None, options.arg("DIR")] = None,
    schema: Annotated[Literal["topology", "scene"] | None, options.arg("{topology,scene}")] = None,
    json: options.Json = False,
) -> int:
    """Check a topology file: units, identifiers, frames, and the load of each bus at worst.

    Of a skin on a robot, lists the joints, and says which patches float, are buried or turned over,
    and what is wrong with the model: a mesh that is missing, a link without mass, millimetres.
    Exits with 1 if something is, if a bus cannot carry its cycle rate, or if units are nearer to
    each other than their magnets allow. If the file is wrong, exits with 2, after every problem
    with its line. DBC files are named after the skin and the bus (palm-main.dbc), and hold SYNC,
    the data frames with their scales, heartbeats.

    Parameters
    ----------
    file
        topology file, or the name of a ready-made one
    dbc
        write a DBC file for each bus into this folder, for other CAN tools
    schema
        print the JSON Schema of topology or scene files, for your editor
    """
    from skin.errors import OptionError
    from topology.load import builtin, load
    from topology.schema import json_schema
    from topology.summary import summary

    if schema == "topology":
        print(json_text.dumps(json_schema(), indent=2))
        return 0
    if schema == "scene":
        from skin.sim.scenes.script import SceneFile

        print(json_text.dumps(json_schema(SceneFile), indent=2))
        return 0
    if file is None:
        raise OptionError(
            "skin check: must have a file or the name of a ready-made topology "
            f"({', '.join(builtin)}); got none"
        )
    loaded = load(file, allow_overload=True)
    written: list[dict[str, Any]] = []
    if dbc is not None:
        from bus.dbc import write_dbc

        written = [
            asdict(one) | {"path": str(one.path.resolve())} for one in write_dbc(loaded, dbc)
        ]
    found, rate = summary(loaded), f"{loaded.cycle_rate_hz:g} Hz"
    robot = None if loaded.robot is None else _seat(loaded, loaded.robot)
    too_dense = _too_dense(loaded)
    problems = [
        f"bus {bus['name']!r} cannot carry {rate}: worst-case load {bus['load']:.1%}, "
        f"limit {bus['max_load']:.1%}"
        for bus in found["buses"] if not bus["ok"]
    ] + too_dense + (robot["problems"] if robot else [])  # fmt: skip
    report = found | {
        **options.without(loaded), "too_dense": too_dense, "robot": robot,
        "dbc": written, "ok": not problems,
    }  # fmt: skip
    if json:
        print(json_text.dumps(report))
    else:
        print(f"{loaded.name}: {loaded.n} units, {len(loaded.frames)} frames a cycle, {rate}")
        parts = report if robot is None else report | {
            "joints": robot["joints"], "seats": robot["patches"],
        }  # fmt: skip
        for name, shown in TABLES.items():
            if rows := parts.get(name):
                print(f"\n{table(map(_with_hex, rows), *shown)}")
    options.note([*found["warnings"], *options.hints(file, loaded)])
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0


def _with_hex(row: dict[str, Any]) -> dict[str, Any]:
    """A row whose identifiers are as data sheets have them."""
    return row | {"ids": [hex(one) for one in row["ids"]]} if row.get("ids") else row


def _too_dense(topology: Topology) -> list[str]:
    """What `skin.open` would refuse, as units are too near to each other."""
    from skin.decode.density import sparse_enough
    from skin.errors import TooDenseError

    try:
        sparse_enough(topology)
    except TooDenseError as error:
        return str(error).splitlines()
    return []


def _seat(topology: Topology, robot: RobotModel) -> dict[str, Any]:
    """The robot of a skin, and how patches sit on it."""
    import msgspec

    from skin.errors import LibraryError
    from skin.robot.mount import check_model, check_patches

    limits = zip(robot.joint_names, robot.lower.tolist(), robot.upper.tolist(), strict=True)
    try:
        problems, patches = check_model(robot), check_patches(topology)
    except LibraryError as error:
        options.note([f"how the skin sits on the robot was not checked: {error}"])
        problems, patches = [], []
    return {
        "model": str(robot.path),
        "links": list(robot.names),
        "joints": [
            {"name": name, "lower": None if math.isnan(low) else low,
             "upper": None if math.isnan(high) else high}
            for name, low, high in limits
        ],
        "patches": [msgspec.to_builtins(patch) for patch in patches],
        "problems": [*problems, *(text for patch in patches for text in patch.problems)],
    }  # fmt: skip
