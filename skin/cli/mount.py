"""`skin mount`: how the patches of a skin sit on the links of a robot model."""

from __future__ import annotations

import json as json_text
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from skin.cli import options
from skin.cli.table import columns

if TYPE_CHECKING:
    from skin.robot.mount import PatchMount
    from topology.robot.model import RobotModel

__all__ = ["mount"]


def mount(
    model: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL", help="URDF or MJCF of the robot")
    ],
    file: Annotated[
        str | None,
        tyro.conf.Positional,
        options.quiet("topology file with this model; otherwise links are listed only",
                      metavar="[FILE]"),
    ] = None,
    /,
    *,
    output: Annotated[
        Path | None,
        options.quiet("write a copy of the model with a link or site for each unit; next to the "
                      "model", metavar="OUT", aliases=["-o"]),
    ] = None,
    distance_mm: Annotated[
        float, tyro.conf.arg(help="most distance of a unit from its link's surface")
    ] = 10.0,
    tilt_deg: Annotated[float, tyro.conf.arg(help="most tilt of a unit to it")] = 30.0,
    json: options.Json = False,
) -> int:  # fmt: skip
    """List links and joints of a robot model, and check that units lie on the links' surfaces.

    Exits with 1 if a patch floats, is buried or turned over, if a mesh is missing, a link has no
    mass, or lengths are millimetres. Nothing is written then.
    """
    import msgspec

    from skin.errors import SkinError, check_numbers
    from skin.robot.mount import check_model, check_patches
    from skin.robot.write import write_mounted
    from topology.load import load
    from topology.robot.read import read_model

    check_numbers(1e-3, 1e6, distance_mm=distance_mm, tilt_deg=tilt_deg)
    if output is not None and file is None:
        raise SkinError("--output: must be given with a topology; got none")
    robot = read_model(model)
    print(_listed(robot))
    problems = check_model(robot)
    patches: list[PatchMount] = []
    loaded = None
    if file is not None:
        loaded = load(file, allow_overload=True)
        if loaded.robot is None or loaded.robot.path.resolve() != model.resolve():
            own = "none" if loaded.robot is None else str(loaded.robot.path)
            raise SkinError(f"{file}: robot model: must be {model}; got {own}")
        patches = check_patches(loaded, distance_mm=distance_mm, tilt_deg=tilt_deg)
        print("\n" + _patches(patches))
    found = [*problems, *(problem for patch in patches for problem in patch.problems)]
    for text in found:
        print(f"\n{text}")
    ok = not found
    if output is not None and loaded is not None and ok:
        write_mounted(loaded, output)
        print(f"\n{output}: {loaded.n} units written")
    elif output is not None:
        print(f"\n{output}: not written, as long as something is wrong")
    if json:
        print(json_text.dumps({
            "model": str(model), "links": list(robot.names), "joints": _joints(robot),
            "patches": [msgspec.to_builtins(patch) for patch in patches],
            "problems": found, "output": str(output) if output is not None and ok else None,
            "ok": ok,
        }))  # fmt: skip
    return 0 if ok else 1


def _joints(robot: RobotModel) -> list[dict[str, Any]]:
    limits = zip(robot.joint_names, robot.lower.tolist(), robot.upper.tolist(), strict=True)
    return [
        {"name": name, "lower": _number(low), "upper": _number(high)} for name, low, high in limits
    ]


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value


def _listed(robot: RobotModel) -> str:
    shapes = [sum(geom.link == link for geom in robot.geoms) for link in range(len(robot.parent))]
    rows = []
    for link, name in enumerate(robot.link_names):
        driver = robot.driver[link]
        limits = ""
        if driver >= 0 and not math.isnan(robot.lower[driver]):
            limits = f"{robot.lower[driver]:.4g} to {robot.upper[driver]:.4g}"
        led = robot.joint_names[driver] if driver >= 0 else ""
        follows = f" (follows {led})" if led not in ("", robot.joints[link]) else ""
        above = robot.link_names[robot.parent[link]] if robot.parent[link] >= 0 else ""
        joint = f"{robot.joints[link]}{follows}"
        rows.append([name, above, joint, robot.kinds[link], limits, str(shapes[link])])
    head = ["link", "on", "joint", "kind", "limits (rad, m)", "shapes"]
    named, joints = len(robot.names), len(robot.joint_names)
    return "\n".join([f"{robot.name}: {named} links, {joints} joints", "", *columns(head, rows)])


def _patches(patches: list[PatchMount]) -> str:
    rows = []
    for patch in patches:
        distance = tilt = ""
        if patch.distance_mm is not None and patch.tilt_deg is not None:
            distance = f"{patch.distance_mm[0]:.2f} to {patch.distance_mm[1]:.2f} mm"
            tilt = f"{patch.tilt_deg:.1f}°"
        state = "wrong" if patch.problems else ""
        if patch.distance_mm is None:
            state = "no shape to check against" if patch.link else "on the skin frame"
        rows.append([patch.name, patch.link, str(patch.units), distance, tilt, state])
    head = ["patch", "link", "units", "distance to surface", "largest tilt", ""]
    return "\n".join(columns(head, rows))
