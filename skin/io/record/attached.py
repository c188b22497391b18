"""Attachments that make a recording replayable: topology, options, stencil, zeros.

The topology is attached as arrays, so that a replay needs no other file; its source files are
attached as well, for people.
"""

from __future__ import annotations

import dataclasses
import io
import json
import math
import tempfile
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bus.errors import LogError
from skin.errors import SkinError, check_number
from skin.options import Options
from topology import Topology, TopologyError
from topology.files import read_arrays, read_regular
from topology.packed import from_arrays, to_arrays

__all__ = ["Setup", "attachments", "read_setup"]

FORMAT = 1
RUN, ARRAYS, STENCIL, ZEROS = "run.json", "topology.npz", "stencil.npz", "zeros.npz"
LARGEST_SOURCE = 2_000_000


def attachments(
    topology: Topology, options: Options, deadline_s: float | None, zeros: bytes | None
) -> dict[str, bytes]:
    """Attachments of a run, by name.

    Parameters
    ----------
    topology : Topology
    options : Options
    deadline_s : float or None
        See `skin.pipeline.Pipeline`.
    zeros : bytes or None
        The file of zeros to be taken up, empty if it did not exist; None without one.
    """
    given = options.report()
    given.pop("stencil", None)  # attached separately
    run = {"format": FORMAT, "topology": topology.name, "options": given,
           "deadline_s": deadline_s, "zeros": zeros is not None}  # fmt: skip
    found = {
        RUN: json.dumps(run, indent=1).encode(),
        ARRAYS: _archive(to_arrays(dataclasses.replace(topology, path=None))),
    }
    if options.stencil is not None:
        with tempfile.TemporaryDirectory() as folder:
            options.stencil.save(Path(folder) / STENCIL)
            found[STENCIL] = (Path(folder) / STENCIL).read_bytes()
    if zeros:
        found[ZEROS] = zeros
    return found | _sources(topology)


@dataclasses.dataclass(frozen=True)
class Setup:
    """Setup of a run.

    Attributes
    ----------
    topology : Topology
    options : Options
    deadline_s : float or None
    zeros : bytes or None
        See `attachments`.
    """

    topology: Topology
    options: Options
    deadline_s: float | None
    zeros: bytes | None


def read_setup(file: Path, attached: Mapping[str, bytes]) -> Setup:
    """Setup of a run, from the attachments of its recording.

    Raises
    ------
    bus.LogError
        An attachment is missing or damaged.
    """
    for name in (RUN, ARRAYS):
        if name not in attached:
            raise LogError(f"{file}: must be a recording of a skin, with {name!r} attached; "
                           f"got {', '.join(map(repr, attached)) or 'nothing'}")  # fmt: skip
    try:
        run = json.loads(attached[RUN])
        form, given, takes_zeros = run["format"], dict(run["options"]), run["zeros"]
        deadline_s = run["deadline_s"]
        if deadline_s is not None:
            check_number("deadline_s", deadline_s, 1e-6, 3600.0)
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        raise LogError(f"{file}: {RUN}: must be what a recording writes; got {error}") from None
    if form != FORMAT:
        raise LogError(f"{file}: {RUN}: format: must be {FORMAT}; got {form!r}")
    with tempfile.TemporaryDirectory() as folder:
        arrays = _arrays(file, attached[ARRAYS], Path(folder))
        try:
            topology = from_arrays(arrays)
        except ValueError as error:
            raise LogError(f"{file}: {ARRAYS}: {error}") from None
        try:
            if "tare" in given:  # name in earlier recordings
                given["auto_tare"] = given.pop("tare")
            given.setdefault("capacity", 16)  # of earlier recordings
            if "slip" in given and given["slip"] is not None:
                given["slip"] = _slip(given["slip"])
            if STENCIL in attached:
                from skin.physics.stencil import Stencil

                place = Path(folder) / STENCIL
                place.write_bytes(attached[STENCIL])
                given["stencil"] = Stencil.load(place, topology)
            options = Options(**given)
        except (SkinError, TopologyError, TypeError, AttributeError) as error:
            raise LogError(f"{file}: {RUN}: must be options of a run; got: {error}") from None
    return Setup(topology, options, deadline_s, attached.get(ZEROS, b"") if takes_zeros else None)


def _slip(values: dict[str, Any]) -> Any:
    from skin.contact.slip import SlipSettings

    known: dict[str, Any] = {k: math.nan if v is None else v for k, v in values.items()}
    return SlipSettings(**known)


def _archive(arrays: dict[str, np.ndarray]) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def _arrays(file: Path, data: bytes, folder: Path) -> dict[str, np.ndarray]:
    place = folder / ARRAYS
    place.write_bytes(data)
    try:
        return read_arrays(place)
    except (OSError, ValueError) as error:
        raise LogError(f"{file}: {ARRAYS}: must be arrays of a topology; got: {error}") from None


def _sources(topology: Topology) -> dict[str, bytes]:
    """The source files of the topology that can be read: its own, and those of its calibrations."""
    if topology.path is None:
        return {}
    found: dict[str, bytes] = {}
    try:
        text = read_regular(topology.path, LARGEST_SOURCE)
        found[topology.path.name] = text
        for patch in tomllib.loads(text.decode()).get("patches", ()):
            named = patch.get("calibration")
            if isinstance(named, str):
                place = topology.path.parent / named
                found[place.name] = read_regular(place, LARGEST_SOURCE)
    except (OSError, ValueError):  # the replay uses the arrays
        return found
    return found
