"""Attachments that make a recording replayable: topology with calibration, options, stencil.

The topology is attached as arrays with all that decodes, so that a replay needs no other file.
"""

from __future__ import annotations

import dataclasses
import io
import json
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from bus.errors import LogError
from skin.errors import SkinError, check_number
from skin.io.record.container import RecordedFile
from skin.options import Options
from topology import Topology, TopologyError
from topology.files import read_arrays
from topology.packed import TEXTS, from_arrays, is_calibration, to_arrays

__all__ = ["Setup", "attachments", "differences", "read_setup"]

RUN, ARRAYS, STENCIL = "run.json", "topology.npz", "stencil.npz"


def attachments(topology: Topology, options: Options, deadline_s: float | None) -> dict[str, bytes]:
    """Attachments of a run, by name; see `skin.pipeline.Pipeline`."""
    given = options.report()
    given.pop("stencil", None)  # attached separately
    run = {"topology": topology.name, "options": given, "deadline_s": deadline_s}
    found = {RUN: json.dumps(run, indent=1).encode(), ARRAYS: _archive(topology)}
    if options.stencil is not None:
        options.stencil.write(file := io.BytesIO())
        found[STENCIL] = file.getvalue()
    return found


@dataclasses.dataclass(frozen=True)
class Setup:
    """Setup of a run; see `skin.pipeline.Pipeline`."""

    topology: Topology
    options: Options
    deadline_s: float | None


def read_setup(recorded: RecordedFile) -> Setup:
    """Setup of a run, from the attachments of its recording.

    Raises
    ------
    bus.LogError
        An attachment is missing or damaged.
    """
    file, attached = recorded.path, recorded.attached
    for name in (RUN, ARRAYS):
        if name not in attached:
            got = ", ".join(map(repr, attached)) or "nothing"
            if recorded.damage:
                raise LogError(f"{recorded.damage[0]}: of the topology and options, which come "
                               f"before all frames and states, {got} can be read")  # fmt: skip
            raise LogError(
                f"{file}: must be a recording of a skin, with {name!r} attached; got {got}"
            )
    try:
        run = json.loads(attached[RUN])
        given, deadline_s = dict(run["options"]), run["deadline_s"]
        if deadline_s is not None:
            check_number("deadline_s", deadline_s, 1e-6, 3600.0)
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        raise LogError(f"{file}: {RUN}: must be what a recording writes; got {error}") from None
    with tempfile.TemporaryDirectory() as folder:
        topology = _topology(file, attached[ARRAYS], Path(folder) / ARRAYS)
        try:
            if given.get("slip") is not None:
                given["slip"] = _slip(given["slip"])
            if STENCIL in attached:
                from skin.physics.stencil import Stencil

                place = Path(folder) / STENCIL
                place.write_bytes(attached[STENCIL])
                given["stencil"] = Stencil.load(place, topology)
            options = Options(**given)
        except (SkinError, TopologyError, TypeError, AttributeError) as error:
            raise LogError(f"{file}: {RUN}: must be options of a run; got: {error}") from None
    return Setup(topology, options, deadline_s)


def differences(recorded: Topology, given: Topology) -> tuple[list[str], bool]:
    """Names of what differs between two skins, and whether their calibrations do."""
    names = ("name", "unit_names", "patch_names", "layouts")
    found = [name for name in names if getattr(recorded, name) != getattr(given, name)]
    if [bus.name for bus in recorded.buses] != [bus.name for bus in given.buses]:
        found.append("buses")
    one, other = to_arrays(recorded), to_arrays(given)
    arrays = [name for name in one if name != TEXTS and not np.array_equal(one[name], other[name])]
    others = [name for name in arrays if not is_calibration(name)]
    return [*found, *others], len(others) < len(arrays)


def _slip(values: dict[str, Any]) -> Any:
    from skin.contact.slip import SlipSettings

    known: dict[str, Any] = {k: math.nan if v is None else v for k, v in values.items()}
    return SlipSettings(**known)


def _archive(topology: Topology) -> bytes:
    file = io.BytesIO()
    arrays: dict[str, Any] = to_arrays(dataclasses.replace(topology, path=None))
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def _topology(file: Path, data: bytes, place: Path) -> Topology:
    place.write_bytes(data)
    try:
        return from_arrays(read_arrays(place))
    except (OSError, ValueError) as error:
        raise LogError(f"{file}: {ARRAYS}: must be arrays of a topology; got: {error}") from None
