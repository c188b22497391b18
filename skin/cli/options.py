"""Arguments that several commands share: their help texts and the errors about them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

if TYPE_CHECKING:
    import numpy as np

    from topology import Topology
    from topology.files import Kind

__all__ = [
    "FILE_HELP",
    "Calibration",
    "Channel",
    "DType",
    "Fast",
    "File",
    "FileOrNone",
    "Interface",
    "Json",
    "Listening",
    "Log",
    "Map",
    "Picture",
    "Scene",
    "Seed",
    "Sweeps",
    "Sync",
    "Until",
    "Write",
    "check_folder",
    "check_seconds",
    "chosen",
    "given",
    "hints",
    "mapped",
    "named_in_file",
    "never_tared",
    "quiet",
    "refuse_both",
    "uncalibrated",
    "unreachable",
]


def quiet(help: str, **options: Any) -> Any:
    """An argument whose default needs no word in its help."""
    return tyro.conf.arg(help=help, help_behavior_hint="", **options)


FILE_HELP = "topology file, or the name of a ready-made one"

File = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE", help=FILE_HELP)]

FileOrNone = Annotated[str | None, tyro.conf.Positional, quiet(FILE_HELP, metavar="[FILE]")]
"""Of commands that print a schema without any file; see `given`."""

Calibration = Annotated[
    Path | None,
    quiet(
        "calibration file to write, or a folder of one for each patch; otherwise those that the "
        "topology names, or TOPOLOGY.PATCH.calibration.toml next to it",
        metavar="FILE|DIR",
        aliases=["-o"],
    ),
]

Write = Annotated[bool, quiet("add the lines that name new calibration files to the topology file")]
"""See `named_in_file`."""

Json = Annotated[bool, quiet("end with one JSON object")]

Fast = Annotated[bool, quiet("as fast as possible instead of in real time")]

Picture = Annotated[Path, tyro.conf.arg(metavar="FILE.png", help="where to write the picture")]
"""A PNG file."""

Listening = Annotated[float, tyro.conf.arg(metavar="SECONDS", help="how long to listen")]

Until = Annotated[
    float | None,
    quiet("stop after this time; otherwise at Ctrl-C", metavar="SECONDS", constructor=float),
]

Interface = Annotated[
    str | None,
    quiet("use this interface for every bus instead of the file's", metavar="NAME"),
]

Channel = Annotated[
    str | None,
    quiet(
        "use these channels instead of the file's, one for each bus: can0,can1",
        metavar="NAMES",
    ),
]

Sync = Annotated[
    Literal["host", "bus"], tyro.conf.arg(help="who sends SYNC: this host, or another node")
]

Scene = Annotated[
    str | None, quiet("play this scene, ready-made or from a file", metavar="NAME|FILE")
]

Seed = Annotated[
    int | None,
    quiet(
        "seed of the simulated noise; otherwise the scene's, or 0", metavar="INT", constructor=int
    ),
]

Sweeps = Annotated[
    Literal[0, 1, 2] | None,
    quiet(
        "how cross-talk of neighbours is taken off: 0 only at rest, the rest in sigma; 1 as of the "
        "last cycle; 2 accurately; otherwise 1, or as in the run that was recorded",
        metavar="{0,1,2}",
        constructor=Literal[0, 1, 2],
    ),
]

DType = Annotated[
    Literal["float32", "float64"] | None,
    quiet(
        "type of the numbers and of the arithmetic that makes them; otherwise float32, or as in "
        "the run that was recorded",
        metavar="{float32,float64}",
        constructor=Literal["float32", "float64"],
    ),
]

Log = Annotated[
    Path | None,
    quiet("write down what the buses carry: .log, .log.gz or .blf", metavar="FILE"),
]


Map = tyro.conf.UseAppendAction[Annotated[tuple[str, ...], quiet(
    "a channel by its name or number in the log, and its bus, if it is not as the topology has it",
    metavar="FILE_CHANNEL=BUS",
)]]  # fmt: skip
"""See `mapped`."""


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


def chosen(**given: Any) -> dict[str, Any]:
    """The options of `skin.options.Options` that were given: the others keep their defaults, or,
    of a recording, what they were in its run."""
    return {name: value for name, value in given.items() if value is not None}


def given(file: str | None, command: str) -> str:
    """The topology of a command that needs one after all."""
    from skin.errors import SkinError
    from topology.load import builtin

    if file is None:
        raise SkinError(
            f"skin {command}: must have a file or the name of a ready-made topology "
            f"({', '.join(builtin)}); got none"
        )
    return file


def check_seconds(
    seconds: float | None, at_most: float | None = None, option: str = "--seconds"
) -> None:
    """Refuse a time that never passes, and one beyond `at_most`."""
    from skin.errors import SkinError

    if seconds is None or (seconds > 0.0 and (at_most is None or seconds <= at_most)):
        return
    limit = "" if at_most is None else f" and at most {at_most:g}"
    raise SkinError(f"{option}: must be above 0{limit}; got {seconds:g}")


def refuse_both(option: str, other: str, value: object) -> None:
    """Refuse `other`, if it is given, with an option that makes it void."""
    from skin.errors import SkinError

    if value is not None:
        raise SkinError(f"{other}: must not be given with {option}; got {value!r}")


def check_folder(option: str, path: Path | None, over: Kind | None = None) -> None:
    """Refuse a file that cannot be written, or is there and not of the kind `over`, before the work
    and not after."""
    from skin.errors import SkinError
    from topology.files import check_over

    if path is None:
        return
    folder = path.absolute().parent
    if not folder.is_dir():
        raise SkinError(f"{option}: must be in a folder that exists; got '{path}'")
    if path.is_dir() or not os.access(folder, os.W_OK):
        raise SkinError(f"{option}: must be a file that can be written; got '{path}'")
    if over is not None:
        check_over(path, over)


def named_in_file(topology: Topology, files: Mapping[str, Path], write: bool) -> dict[str, str]:
    """Name calibration files that were written in the topology file, or print the lines to add.

    Returns
    -------
    dict of str to str
        Lines that the topology file lacks, by patch.
    """
    from topology.load import is_builtin
    from topology.naming import calibration_lines, name_calibrations

    path = topology.path
    if path is None or is_builtin(path):
        return {}
    lines = calibration_lines(path, files)
    added = name_calibrations(path, lines) if write else {}
    for patch, line in lines.items():
        if patch in added:
            print(f"{path}:{added[patch]}: added to patch {patch!r}: {line}")
        else:
            print(f"{path}: not used until its patch {patch!r} has the line: {line}")
    return {patch: line for patch, line in lines.items() if patch not in added}


def unreachable(file: str, topology: Topology) -> str | None:
    """What is wrong with the first bus that no other process could ever be on, if there is one."""
    for i, bus in enumerate(topology.buses):
        if bus.interface == "memory":
            return (
                f"{file}: buses[{i}] {bus.name!r}: interface: must be one that other processes can "
                "reach; got 'memory' (try --interface socketcan --channel vcan0, or --interface "
                "udp_multicast --channel 239.74.163.2)"
            )
    return None


def never_tared(topology: Topology) -> list[str]:
    """Units whose zeros were not taken in their places; none on buses within the process."""
    return lacking(topology, topology.tared)


def uncalibrated(topology: Topology) -> list[str]:
    """Units whose laws are those of their model; likewise."""
    return lacking(topology, topology.calibrated)


def lacking(topology: Topology, known: np.ndarray) -> list[str]:
    """Units of a real bus, shape (n,), that are not among those `known`."""
    if topology.in_process:
        return []
    missing: np.ndarray = topology.feels & ~known
    return [
        name for name, is_missing in zip(topology.unit_names, missing, strict=True) if is_missing
    ]


def refuse_simulated(topology: Topology, output: Path | None) -> None:
    """Refuse zeros of simulated units in place of those that a real bus has given."""
    from skin.errors import SkinError

    if output is None and not topology.in_process:
        raise SkinError(
            f"--output: must be given with --simulate, since {topology.name!r} is on a real bus, "
            "whose zeros simulated ones would replace; got none"
        )


def share_of(valid: int, cycles: int, topology: Topology) -> float | None:
    """Share of valid readings; None where no unit can have one (`counts_only` layouts)."""
    readings = cycles * int(topology.feels.sum())
    return valid / max(1, readings) if topology.feels.any() else None


def percent(share: float | None) -> str:
    """A share as text."""
    return "none: the layout has counts only" if share is None else f"{100 * share:.2f} %"


def hints(file: str, topology: Topology, *, will_tare: bool = False) -> list[str]:
    """A line about units that were never tared, and one about those without a calibration."""
    found = []
    if names := never_tared(topology):
        units = f"unit {names[0]} has" if len(names) == 1 else f"{len(names)} units have"
        now = ", or touch nothing for a second" if will_tare else ""
        found.append(f"{units} never been tared: skin tare {file}{now}")
    if names := uncalibrated(topology):
        units = f"unit {names[0]} has" if len(names) == 1 else f"{len(names)} units have"
        found.append(f"{units} no calibration: sigma holds the spread from unit to unit")
    return found
