"""`skin new`: a topology file to start from, with a calibration file for each patch."""

from __future__ import annotations

import json as json_text
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import tyro

from skin.cli import options

if TYPE_CHECKING:
    from topology import Topology

__all__ = ["new"]

GAP_M = 0.02
"""Between two patches, which are put side by side [assumed]."""
FIRST_ID, ALIGNED = 0x100, 0x10
"""First identifier of data frames, and that of which each patch begins with a multiple."""
PER_FRAME = {"f3t-fd64": 5, "f3t-classic": 1}
"""Units that a frame carries."""

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
COMMENTS_AT = 44
"""Column of comments behind a value."""
STUB = """\
# Calibration of the units of patch "{name}": any parameter of the unit model, by unit. `skin tare`
# writes zeros here, `skin calibrate` what a bench has measured. All else is as of the model.

format = 1
patch = "{name}"

# [units.r0c0]
# frequency_rest_hz = 4512.5
"""


class _Patch(NamedTuple):
    skin: str
    name: str
    rows: int
    columns: int

    @property
    def calibration(self) -> str:
        return f"{self.skin}.{self.name}.calibration.toml"


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
) -> int:  # fmt: skip
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
    wanted = [_patch(file.stem, text) for text in patches]
    files = [file, *(file.with_name(patch.calibration) for patch in wanted)]
    for path in files:
        options.check_folder("NAME", path, NO_KIND)
    layout = "f3t-classic" if classic else "f3t-fd64"
    text = _aligned(HEAD.format(
        name=file.stem, quoted=_quoted(file.stem), file=file, pitch_mm=pitch_mm, rate_hz=rate_hz,
        interface=_quoted(interface), channel=_quoted(channel), data_bitrate="" if classic else FD,
    ) + _patches(wanted, layout, 1e-3 * pitch_mm))  # fmt: skip
    loaded = _tried(text, file)
    for path, patch in zip(files[1:], wanted, strict=True):
        with whole_file(path, "w", over=NO_KIND, encoding="utf-8") as out:
            out.write(STUB.format(name=patch.name))
    with whole_file(file, "w", over=NO_KIND, encoding="utf-8") as out:
        out.write(text)
    for path in files:
        print(f"written: {path}")
    print(f"next: skin check {file}; skin run {file} --simulate; skin tare {file}")
    if json:
        print(json_text.dumps({"topology": loaded.name, "units": loaded.n,
                               "files": [str(path.resolve()) for path in files]}))  # fmt: skip
    return 0


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


def _quoted(text: str) -> str:
    return json_text.dumps(text)


def _aligned(text: str) -> str:
    """Comments that are marked by two signs, in one column."""
    rows = [row.partition("  ## ") for row in text.splitlines()]
    return "".join(
        f"{code:<{COMMENTS_AT - 1}} # {comment}\n" if mark else f"{code}\n"
        for code, mark, comment in rows
    )


def _patch(skin: str, text: str) -> _Patch:
    from skin.errors import OptionError

    found = re.fullmatch(r"([A-Za-z0-9_][A-Za-z0-9_.-]*)=([1-9]\d{0,2})x([1-9]\d{0,2})", text)
    if found is None:
        raise OptionError(f"--patches: must be NAME=ROWSxCOLUMNS, as in palm=8x8; got {text!r}")
    return _Patch(skin, found[1], int(found[2]), int(found[3]))


def _patches(wanted: list[_Patch], layout: str, pitch_m: float) -> str:
    """The patches, side by side, each with identifiers of its own."""
    parts, x_m, first_id = [], 0.0, FIRST_ID
    for i, patch in enumerate(wanted):
        half_m = 0.5 * patch.columns * pitch_m
        x_m += half_m if i else 0.0
        parts.append(PATCH.format(
            **patch._asdict(), calibration=patch.calibration, pitch_m=pitch_m, layout=layout,
            first_id=first_id, x_m=x_m,
        ))  # fmt: skip
        x_m += half_m + GAP_M
        frames = -(-patch.rows * patch.columns // PER_FRAME[layout])
        first_id += -(-frames // ALIGNED) * ALIGNED
    return "".join(parts)
