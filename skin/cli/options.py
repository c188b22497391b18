"""Arguments that several commands share: their help texts and the errors about them."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

if TYPE_CHECKING:
    import numpy as np

    from skin.live import Skin
    from topology import Topology
    from topology.files import Kind

__all__ = [
    "FILE_HELP",
    "Bus",
    "Calibration",
    "File",
    "Json",
    "Listening",
    "Log",
    "Map",
    "Simulate",
    "Sync",
    "Until",
    "arg",
    "check_folder",
    "check_seconds",
    "hints",
    "lacking",
    "load",
    "mapped",
    "named_in_file",
    "note",
    "note_scene",
    "open_skin",
    "refuse_both",
    "without",
]

SHOWN = 8
"""Patches that a line names."""


def arg(metavar: str, *aliases: str, help: str | None = None) -> Any:
    """An argument whose default needs no word; its help is in the docstring of the command."""
    return tyro.conf.arg(metavar=metavar, aliases=aliases, help=help, help_behavior_hint="")


FILE_HELP = "topology file, or the name of a ready-made one"

File = Annotated[str, tyro.conf.Positional, arg("FILE", help=FILE_HELP)]

Log = Annotated[Path | None, tyro.conf.Positional, arg("[LOG]", help="recorded log of that skin")]

Calibration = Annotated[Path | None, arg(
    "FILE|DIR", "-o", help="calibration file to write, or a folder of one for each patch; "
    "otherwise those that the topology names, or TOPOLOGY.PATCH.calibration.toml next to it",
)]  # fmt: skip

Json = Annotated[bool, tyro.conf.arg(help="end with one JSON object", help_behavior_hint="")]

Listening = Annotated[float, tyro.conf.arg(metavar="SECONDS", help="how long to listen")]

Until = Annotated[float | None, arg("SECONDS", help="stop after this time; otherwise at Ctrl-C")]

Bus = Annotated[str | None, arg(
    "INTERFACE:CHANNEL", help="use this interface for every bus, and these channels, one for each, "
    "in place of the file's: socketcan:can0,can1",
)]  # fmt: skip
"""See `load`."""

Sync = Annotated[
    Literal["host", "bus"], tyro.conf.arg(help="who sends SYNC: this host, or another node")
]

Simulate = Annotated[tuple[str, ...] | None, arg(
    "[SCENE]", help="simulated units, in this process, in place of the buses; they play this "
    "scene, ready-made or from a file, or else are pressed all over",
)]  # fmt: skip

Map = tyro.conf.UseAppendAction[Annotated[tuple[str, ...], arg(
    "FILE_CHANNEL=BUS", help="a channel by its name or number in the log, and its bus, if it is "
    "not as the topology has it",
)]]  # fmt: skip
"""See `mapped`."""


def load(file: str, bus: str | None = None, **how: Any) -> Topology:
    """A topology on the buses that are given as `Bus`, or else its own."""
    from topology import load as load_file

    interface, _, channel = (bus or "").partition(":")
    return load_file(file, **how).on(interface=interface or None, channel=channel or None)


@contextmanager
def open_skin(
    file: str,
    *,
    bus: str | None,
    sync: Literal["host", "bus"],
    simulate: tuple[str, ...] | None,
    record: Path | None = None,
) -> Iterator[Skin]:
    """The skin that a command runs, with what is worth knowing said before its first cycle."""
    import skin
    from skin.errors import OptionError

    scene: str | bool = False
    if simulate is not None:
        if len(simulate) > 1:
            raise OptionError(f"--simulate: must be one scene; got {' '.join(simulate)}")
        if sync != "host":
            raise OptionError(f"--sync: must be 'host' with --simulate; got {sync!r}")
        refuse_both("--simulate", "--bus", bus)
        scene = simulate[0] if simulate else True
    loaded = load(file, bus)
    if not scene:
        note(hints(file, loaded, will_tare=True))
    with skin.open(loaded, sync=sync, simulate=scene, record=record) as opened:
        note_scene(opened.nodes and opened.nodes.scene)
        yield opened


def note(lines: Iterable[str]) -> None:
    """Say what is worth knowing and no fault."""
    for line in lines:
        print(f"note: {line}", file=sys.stderr)


def note_scene(scene: object) -> None:
    """Say what a simulated scene touches."""
    for body in getattr(scene, "bodies", ()):
        shown = ", then ".join(body.places[:SHOWN]) + (", …" if len(body.places) > SHOWN else "")
        print(f"scene: {body.name} on {shown}", file=sys.stderr)


def mapped(map: tuple[str, ...], *logs: str | Path | None) -> dict[str, Any]:
    """The argument ``channels`` of `skin.decode_log`, where it is given for these logs."""
    from skin.errors import OptionError
    from skin.io.record import is_recording

    found: dict[str, str] = {}
    for one in map:
        channel, _, bus = one.rpartition("=")
        if not channel or not bus or channel in found:
            raise OptionError(f"--map: must be FILE_CHANNEL=BUS, each channel once; got {one!r}")
        found[channel] = bus
    if found and any(log is None or is_recording(log) for log in logs):
        raise OptionError("--map: must be given with logs, and not with recordings or buses")
    return {"channels": found} if found else {}


def check_seconds(seconds: float | None) -> None:
    """Refuse a time that never passes."""
    from skin.errors import OptionError

    if seconds is not None and not seconds > 0.0:
        raise OptionError(f"--seconds: must be above 0; got {seconds:g}")


def refuse_both(option: str, other: str, value: object) -> None:
    """Refuse `other`, if it is given, with an option that makes it void."""
    from skin.errors import OptionError

    if value is not None:
        raise OptionError(f"{other}: must not be given with {option}; got {value!r}")


def check_folder(option: str, path: Path | None, over: Kind | None = None) -> None:
    """Refuse a file that cannot be written, or is there and not of the kind `over`, before the work
    and not after."""
    from skin.errors import OptionError
    from topology.files import check_over

    if path is None:
        return
    folder = path.absolute().parent
    if not folder.is_dir():
        raise OptionError(f"{option}: must be in a folder that exists; got '{path}'")
    if path.is_dir() or not os.access(folder, os.W_OK):
        raise OptionError(f"{option}: must be a file that can be written; got '{path}'")
    if over is not None:
        check_over(path, over)


def named_in_file(topology: Topology, files: Mapping[str, Path]) -> dict[str, dict[str, str]]:
    """Of a report: ``files`` that were written, and ``lines`` that the topology file lacks to use
    them, which are said, too; both by patch."""
    from skin.calibrate.files import named_file
    from topology.load import is_builtin

    path, lines = topology.path, {}
    full = {patch: file.resolve() for patch, file in files.items()}
    for patch, file in full.items():
        known = named_file(topology, patch)
        if path is not None and not is_builtin(path) and (known is None or known.resolve() != file):
            place = os.path.relpath(file, path.resolve().parent)
            lines[patch] = f"calibration = {json.dumps(place)}"
    note(f"{path}: {full[patch]} is not used until patch {patch!r} has the line: {line}"
         for patch, line in lines.items())  # fmt: skip
    return {"files": {patch: str(file) for patch, file in full.items()}, "lines": lines}


def lacking(topology: Topology, known: np.ndarray) -> list[str]:
    """Units of which something is not known; none on buses within the process."""
    if topology.in_process:
        return []
    missing: np.ndarray = topology.feels & ~known
    return [
        name for name, is_missing in zip(topology.unit_names, missing, strict=True) if is_missing
    ]


def without(topology: Topology) -> dict[str, list[str]]:
    """Units whose zeros were not taken in their places, and those whose laws are of their model."""
    return {
        "never_tared": lacking(topology, topology.tared),
        "uncalibrated": lacking(topology, topology.calibrated),
    }


CUT_OFF = (
    "with too short a signal on the wire: it ends before what a working unit reads (look at scale, "
    "offset and length in the layout)"
)


def hints(
    file: str,
    topology: Topology,
    *,
    will_tare: bool = False,
    more: Iterable[tuple[list[str], str]] = (),
) -> list[str]:
    """A line about units that were never tared, one about those without a calibration, one about
    each channel that the wire cuts off, and `more` about units that have something."""
    from skin.decode.limits import clipped

    now = ", or touch nothing for a second" if will_tare else ""
    untared, unknown = without(topology).values()
    found = [
        (untared, f"never been tared: skin tare {file}{now}"),
        (unknown, "no calibration: sigma holds the spread from unit to unit"),
        *(
            (lacking(topology, ~units), f"{channel!r} {CUT_OFF}")
            for channel, units in clipped(topology).items()
        ),
        *more,
    ]
    return [
        f"unit {names[0]} has {text}" if len(names) == 1 else f"{len(names)} units have {text}"
        for names, text in found
        if names
    ]
