"""`skin new`: a topology file to start from, with a calibration file for each patch."""

from __future__ import annotations

import json as json_text
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from skin.cli import options
from skin.cli.table import end

if TYPE_CHECKING:
    from skin.robot.propose import Proposal
    from topology import Topology

__all__ = ["new"]

GAP_M = 0.02
"""Between two patches, which are put side by side [assumed]."""
SHAPE = re.compile(
    r"(?P<name>[A-Za-z0-9_][A-Za-z0-9_.-]*)=(?:dome:(?P<ball>\d+(?:\.\d+)?)mm|"
    r"(?:cylinder:(?P<radius>\d+(?:\.\d+)?)mm:)?"
    r"(?P<rows>[1-9]\d{0,2})x(?P<columns>[1-9]\d{0,2}))"
)
FIRST_ID, ALIGNED = 0x100, 0x10
"""First identifier of data frames, and that of which each patch begins with a multiple."""

HEAD = """\
# {name}: units on one bus. Lengths are metres, angles degrees.
#
#   skin check {file}               what hangs where, and the load of the bus
#   skin run {file} --simulate      simulated units in place of the bus
#   skin tare {file}                the zeros of the untouched skin, into the files below
#
# The ready-made topology "palm" has every table of the format as a comment; `skin check
# --schema topology` prints its JSON Schema, by which an editor completes keys and marks mistakes.

format = 1
name = {quoted}
cycle_rate_hz = 250
sync_id = 0x080  # of SYNC; absent: units send freely

[[buses]]
name = "main"
interface = "socketcan"  # "memory": simulated units only; or an interface of python-can
channel = "can0"
bitrate = 1_000_000  # bit/s
data_bitrate = 5_000_000  # bit/s, CAN FD; a classic bus has no such line
"""
PATCH = """
[[patches]]
name = "{name}"{reason}
{shape}{place}
bus = "main"
layout = "f3t-fd64"  # what the bits of a frame mean; on a classic bus "f3t-classic"
first_id = {first_id:#05x}  # of its first frame; others follow: more units move them all
calibration = "{calibration}"
"""
ROBOT = """
[robot]
model = {model}
"""
MEANING = {
    "kind": '"grid", "hex", "cylinder", "dome" or "list"',
    "rows": "along y",
    "columns": "along x, or around",
    "rings": "around the middle unit, of 6, 12, 18, … units, as far as there is room",
    "radius_m": "of the surface that the units are on",
    "pitch_m": "distance of neighbouring units, along the surface",
}
STUB = """\
# Calibration of the units of patch "{name}": any parameter of the unit model, by unit. `skin tare`
# writes zeros here, `skin calibrate` what a bench has measured. All else is as of the model.

format = 1
patch = "{name}"

# [units.r0c0]
# frequency_rest_hz = 4512.5
"""


def new(
    name: Annotated[Path, tyro.conf.Positional, options.arg("NAME")],
    /,
    *,
    patches: Annotated[tuple[str, ...], tyro.conf.arg(metavar="PATCH=SHAPE [...]")] = (),
    robot: Annotated[Path | None, options.arg("FILE")] = None,
    json: options.Json = False,
) -> int:
    """Write a commented topology file, and a calibration file to be filled for each of its patches.

    All units are on one bus of CAN FD: change pitch, place and bus in the file. Files that exist
    are left as they are, and the exit status is 2.

    Parameters
    ----------
    name
        writes NAME.toml
    patches
        patches side by side: palm=4x4 (rows, columns), tip=dome:10mm (radius),
        side=cylinder:10mm:3x4; one of 4x4 if neither these nor a robot are given
    robot
        URDF or MJCF: a patch for each fingertip, by the shapes of its links
    """
    from topology.files import NO_KIND, whole_file

    file = name if name.suffix == ".toml" else name.with_name(f"{name.name}.toml")
    text = HEAD.format(name=file.stem, quoted=json_text.dumps(file.stem), file=file)
    found = [_patch(one) for one in patches or (() if robot else ("palm=4x4",))]
    if robot is not None:
        model = os.path.relpath(robot, file.parent)
        text += ROBOT.format(model=json_text.dumps(model))
        found += _fingertips(robot, {one.name for one in found})
    stubs: dict[Path, str] = {}
    edge_m, first_id = -GAP_M, FIRST_ID
    for one in found:
        units, width_m = _extent(one)
        if one.link:
            xyz_m, link = [*one.xyz_m], f"link = {json_text.dumps(one.link)}\n"
        else:
            x_m = edge_m + GAP_M + 0.5 * width_m if stubs else 0.0
            edge_m, xyz_m, link = x_m + 0.5 * width_m, [round(x_m, 5), 0.0, 0.0], ""
        place = f"{link}pose = {{ xyz_m = {xyz_m}, rpy_deg = {[*one.rpy_deg]} }}"
        calibration = f"{file.stem}.{one.name}.calibration.toml"
        text += PATCH.format(
            name=one.name, reason=f"  # {one.reason}: look at its place" if one.reason else "",
            shape="".join(map(_line, one.shape.items())), first_id=first_id,
            place=f"{place}  # of its middle; z out of it", calibration=calibration,
        )  # fmt: skip
        stubs[file.with_name(calibration)] = STUB.format(name=one.name)
        first_id += -(-units // ALIGNED) * ALIGNED  # enough for one unit a frame
    for path in (file, *stubs):
        options.check_folder("NAME", path, NO_KIND)
    loaded = _tried(text, file)
    for path, content in (*stubs.items(), (file, text)):
        with whole_file(path, "w", over=NO_KIND, encoding="utf-8") as out:
            out.write(content)
    end({"topology": loaded.name, "units": loaded.n,
         "files": [str(path.resolve()) for path in (file, *stubs)]}, json)  # fmt: skip
    if not json:
        print(f"next: skin check {file}; skin run {file} --simulate; skin tare {file}")
    return 0


def _patch(text: str) -> Proposal:
    """A patch as it is asked for."""
    from skin.errors import OptionError
    from skin.robot.propose import Proposal, cylinder, dome, grid

    found = SHAPE.fullmatch(text)
    if found is None:
        expected = "NAME=ROWSxCOLUMNS, NAME=dome:RADIUSmm or NAME=cylinder:RADIUSmm:ROWSxCOLUMNS"
        raise OptionError(f"--patches: must be {expected}, as in palm=8x8; got {text!r}")
    rows, columns = int(found["rows"] or 0), int(found["columns"] or 0)
    radius_m = 1e-3 * float(found["radius"] or found["ball"] or 0.0)
    if found["ball"]:
        return Proposal(found["name"], dome(radius_m))
    shape = cylinder(radius_m, rows, columns) if found["radius"] else grid(rows, columns)
    return Proposal(found["name"], shape)


def _fingertips(robot: Path, taken: set[str]) -> list[Proposal]:
    """Patches on the fingertips of a model, of other names than those that are taken."""
    from skin.robot.propose import proposed
    from topology.robot import read_model

    return proposed(read_model(robot), taken)


def _extent(one: Proposal) -> tuple[int, float]:
    """Number of units, and width along x."""
    from skin.robot.propose import PITCH_M
    from topology.layout import place
    from topology.schema import Cylinder, Dome, Grid

    kinds = {"grid": Grid, "cylinder": Cylinder, "dome": Dome}
    keys: dict[str, Any] = {name: one.shape[name] for name in one.shape if name != "kind"}
    kind: Any = kinds[str(one.shape["kind"])]
    placed = place(kind(name="", bus="", layout="", first_id=0, **keys))
    return len(placed.names), float(np.ptp(placed.position[0])) + PITCH_M


def _line(item: tuple[str, Any]) -> str:
    """A key with its value, and its meaning where that is not said by its name."""
    name, value = item
    meaning = f"  # {MEANING[name]}" if name in MEANING else ""
    return f"{name} = {json_text.dumps(value)}{meaning}\n"


def _tried(text: str, file: Path) -> Topology:
    """The topology of a text, which is refused before anything is written; more units than its bus
    carries are for the user to part, and `skin check` says so."""
    from skin.errors import OptionError
    from topology import TopologyError, load

    trial = file.with_name(f".{file.stem}.check.toml")
    try:
        trial.write_text(text, encoding="utf-8")
        return load(trial, allow_no_calibration=True, allow_overload=True)
    except TopologyError as error:
        raise OptionError(str(error).replace(str(trial), str(file))) from None
    finally:
        trial.unlink(missing_ok=True)
