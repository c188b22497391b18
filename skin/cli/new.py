"""`skin new`: a topology file to start from, with a calibration file for each patch."""

from __future__ import annotations

import json as json_text
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from skin.cli import options
from skin.cli.table import end

if TYPE_CHECKING:
    from topology import Topology

__all__ = ["new"]

PITCH_M, GAP_M = 0.012, 0.02
"""Between two units, and between two patches, which are put side by side [assumed]."""
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
name = "{name}"
kind = "grid"  # or "hex", "cylinder", "dome", "list"
rows = {rows}  # along y
columns = {columns}  # along x
pitch_m = {pitch_m}  # distance of neighbouring units
pose = {{ xyz_m = [{x_m:.4g}, 0.0, 0.0], rpy_deg = [0, 0, 0] }}  # of its middle; z out of it
bus = "main"
layout = "f3t-fd64"  # what the bits of a frame mean; on a classic bus "f3t-classic"
first_id = {first_id:#05x}  # of its first frame; others follow: more rows move them all
calibration = "{calibration}"
"""
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
    patches: Annotated[tuple[str, ...], tyro.conf.arg(metavar="PATCH=ROWSxCOLUMNS [...]")] = (
        "palm=4x4",
    ),
    json: options.Json = False,
) -> int:
    """Write a commented topology file, and a calibration file to be filled for each of its patches.

    The patches lie side by side on one bus of CAN FD: change pitch, place and bus in the file.
    Files that exist are left as they are, and the exit status is 2.

    Parameters
    ----------
    name
        writes NAME.toml
    patches
        patches, and how many units each
    """
    from topology.files import NO_KIND, whole_file

    file = name if name.suffix == ".toml" else name.with_name(f"{name.name}.toml")
    text = HEAD.format(name=file.stem, quoted=json_text.dumps(file.stem), file=file)
    stubs: dict[Path, str] = {}
    x_m, first_id = 0.0, FIRST_ID
    for number, one in enumerate(patches):
        patch, rows, columns = _patch(one)
        half_m = 0.5 * columns * PITCH_M
        x_m += half_m if number else 0.0
        calibration = f"{file.stem}.{patch}.calibration.toml"
        text += PATCH.format(
            name=patch, rows=rows, columns=columns, pitch_m=PITCH_M, x_m=x_m, first_id=first_id,
            calibration=calibration,
        )  # fmt: skip
        stubs[file.with_name(calibration)] = STUB.format(name=patch)
        x_m += half_m + GAP_M
        first_id += -(-rows * columns // ALIGNED) * ALIGNED  # enough for one unit a frame
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


def _patch(text: str) -> tuple[str, int, int]:
    """Name, rows and columns of a patch."""
    from skin.errors import OptionError

    found = re.fullmatch(r"([A-Za-z0-9_][A-Za-z0-9_.-]*)=([1-9]\d{0,2})x([1-9]\d{0,2})", text)
    if found is None:
        raise OptionError(f"--patches: must be NAME=ROWSxCOLUMNS, as in palm=8x8; got {text!r}")
    return found[1], int(found[2]), int(found[3])


def _tried(text: str, file: Path) -> Topology:
    """The topology of a text, which is refused before anything is written."""
    from skin.errors import OptionError
    from topology import TopologyError, load

    trial = file.with_name(f".{file.stem}.check.toml")
    try:
        trial.write_text(text, encoding="utf-8")
        return load(trial, allow_no_calibration=True)
    except TopologyError as error:
        raise OptionError(str(error).replace(str(trial), str(file))) from None
    finally:
        trial.unlink(missing_ok=True)
