"""`skin new`: a topology file to start from, with a calibration file for each patch."""

from __future__ import annotations

import json as json_text
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from skin.cli import options

if TYPE_CHECKING:
    from topology import Topology

__all__ = ["new"]

GAP_M = 0.02
"""Between two patches, which are put side by side [assumed]."""
FIRST_ID, ALIGNED = 0x100, 0x10
"""First identifier of data frames, and that of which each patch begins with a multiple."""
LAYOUTS = {True: ("f3t-classic", 1), False: ("f3t-fd64", 5)}
"""Of a classic bus, and of CAN FD: wire layout, and units that a frame carries."""
COMMENTS_AT = 44
"""Column of the comments, which are marked by two signs below."""

HEAD = """\
# {name}: units of {pitch_mm:g} mm pitch on one bus. Lengths are metres, angles degrees.
#
#   skin check {file}               what hangs where, and the load of the bus
#   skin run {file} --simulate      simulated units in place of the bus
#   skin tare {file}                the zeros of the untouched skin, into the files below
#
# The ready-made topology "palm" has every table of the format as a comment; `skin check
# --schema topology` prints its JSON Schema, by which an editor completes keys and marks mistakes.

format = 1
name = {quoted}

[[buses]]
name = "main"
interface = {interface}  ## "memory": simulated units only
channel = {channel}
bitrate = 1_000_000  ## bit/s
{data_bitrate}cycle_rate_hz = {rate_hz:g}
sync_id = 0x080  ## of SYNC; absent: units send freely
"""
FD = "data_bitrate = 5_000_000  ## bit/s, CAN FD\n"
PATCH = """
[[patches]]
name = "{name}"
kind = "grid"  ## or "hex", "cylinder", "dome", "list"
rows = {rows}  ## along y
columns = {columns}  ## along x
pitch_m = {pitch_m:g}  ## distance of neighbouring units
pose = {{ xyz_m = [{x_m:.4g}, 0.0, 0.0], rpy_deg = [0, 0, 0] }}  ## of its middle; z out of it
bus = "main"
layout = "{layout}"  ## what the bits of a frame mean
first_id = {first_id:#05x}  ## of its first frame; others follow
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
    name: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="NAME", help="writes NAME.toml")
    ],
    /,
    *,
    patches: Annotated[
        tuple[str, ...],
        tyro.conf.arg(metavar="PATCH=ROWSxCOLUMNS [...]", help="patches, and how many units each"),
    ] = ("palm=4x4",),
    pitch_mm: Annotated[
        float, tyro.conf.arg(metavar="MM", help="distance of neighbouring units")
    ] = 12.0,
    bus: Annotated[
        str,
        tyro.conf.arg(
            metavar="INTERFACE:CHANNEL",
            help="that carries the units: socketcan, memory (simulated units only), or one of "
            "python-can",
        ),
    ] = "socketcan:can0",
    rate_hz: Annotated[float, tyro.conf.arg(metavar="HZ", help="cycles a second")] = 250.0,
    classic: Annotated[
        bool, options.quiet("a classic CAN bus, one unit a frame; otherwise CAN FD, five a frame")
    ] = False,
    json: options.Json = False,
) -> int:
    """Write a commented topology file, and a calibration file to be filled for each of its patches.

    The patches lie side by side; move each to its place. Files that exist are left as they are, and
    the exit status is 2.
    """
    from skin.errors import check_numbers
    from topology.files import NO_KIND, whole_file

    check_numbers(1.0, 500.0, pitch_mm=pitch_mm)
    check_numbers(0.1, 1e5, rate_hz=rate_hz)
    interface, _, channel = bus.partition(":")
    file = name if name.suffix == ".toml" else name.with_name(f"{name.name}.toml")
    text = HEAD.format(
        name=file.stem, quoted=json_text.dumps(file.stem), file=file, pitch_mm=pitch_mm,
        rate_hz=rate_hz, interface=json_text.dumps(interface), channel=json_text.dumps(channel),
        data_bitrate="" if classic else FD,
    )  # fmt: skip
    written: dict[Path, str] = {}
    x_m, first_id, (layout, each) = 0.0, FIRST_ID, LAYOUTS[classic]
    for number, one in enumerate(patches):
        patch, rows, columns = _patch(one)
        half_m = 5e-4 * columns * pitch_mm
        x_m += half_m if number else 0.0
        calibration = f"{file.stem}.{patch}.calibration.toml"
        text += PATCH.format(
            name=patch, rows=rows, columns=columns, pitch_m=1e-3 * pitch_mm, x_m=x_m,
            layout=layout, first_id=first_id, calibration=calibration,
        )  # fmt: skip
        written[file.with_name(calibration)] = STUB.format(name=patch)
        x_m += half_m + GAP_M
        frames = -(-rows * columns // each)
        first_id += -(-frames // ALIGNED) * ALIGNED
    text = "".join(map(_aligned, text.splitlines()))
    written = {file: text, **written}
    for path in written:
        options.check_folder("NAME", path, NO_KIND)
    loaded = _tried(text, file)
    for path, content in reversed(written.items()):
        with whole_file(path, "w", over=NO_KIND, encoding="utf-8") as out:
            out.write(content)
    for path in written:
        print(f"written: {path}")
    print(f"next: skin check {file}; skin run {file} --simulate; skin tare {file}")
    if json:
        print(json_text.dumps({"topology": loaded.name, "units": loaded.n,
                               "files": [str(path.resolve()) for path in written]}))  # fmt: skip
    return 0


def _patch(text: str) -> tuple[str, int, int]:
    """Name, rows and columns of a patch."""
    from skin.errors import OptionError

    found = re.fullmatch(r"([A-Za-z0-9_][A-Za-z0-9_.-]*)=([1-9]\d{0,2})x([1-9]\d{0,2})", text)
    if found is None:
        raise OptionError(f"--patches: must be NAME=ROWSxCOLUMNS, as in palm=8x8; got {text!r}")
    return found[1], int(found[2]), int(found[3])


def _aligned(row: str) -> str:
    """A line whose comment is in the column of all."""
    code, mark, comment = row.partition("  ## ")
    return f"{code:<{COMMENTS_AT - 1}} # {comment}\n" if mark else f"{code}\n"


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
