"""A topology as named arrays, for a recording or another process, with all fields as in memory.

Changes after loading are included: other buses, exact units, zeros. Nothing is pickled. Damage
shows by the checksum of what carries the arrays, a recording of another version by their names and
shapes. Indices are checked, since kernels follow them unchecked.
"""

from __future__ import annotations

import base64
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_type_hints

import msgspec
import numpy as np

from topology.arrays import Frames, Topology, seal
from topology.model import PARAMETERS, TABLES
from topology.wire import CHANNELS

__all__ = ["TEXTS", "from_arrays", "is_calibration", "packed", "to_arrays", "unpacked"]

TEXTS = "texts"
FRAMES, PARAMETER = "frames_", "parameter_"
MOST_PARTS = 16
"""Frames that make one set of units, at most (`topology.wire`)."""

_FIELDS = get_type_hints(Topology)
_PLAIN = [name for name, kind in _FIELDS.items() if kind is np.ndarray]
_Texts = msgspec.defstruct(
    "_Texts",
    [(k, v) for k, v in _FIELDS.items() if k not in (*_PLAIN, "frames", "parameters")],
    forbid_unknown_fields=True,
)
"""Fields other than arrays."""
_NAMES = (
    *_PLAIN,
    *(f"{FRAMES}{name}" for name in get_type_hints(Frames)),
    *(f"{PARAMETER}{name}" for name in PARAMETERS),
)
_NOT_OF_UNITS = ("neighbour_", "patch_", FRAMES)
"""Beginnings of the names of arrays whose last axis is not that of the units."""
_ROWS = {
    "position": (3,), "rotation": (3, 3), "scale": (len(CHANNELS),), "offset": (len(CHANNELS),),
    "wired": (len(CHANNELS),), **{f"{PARAMETER}{name}": (size,) for name, size in TABLES.items()},
}  # fmt: skip
"""Axes before that of the units."""


def is_calibration(name: str) -> bool:
    """Whether an array of `to_arrays`, by its name, is part of the calibration.

    Examples
    --------
    >>> is_calibration("tared"), is_calibration("position")
    (True, False)
    """
    return name.startswith(PARAMETER) or name in ("calibrated", "tared")


def to_arrays(topology: Topology) -> dict[str, np.ndarray]:
    """Arrays, by name; all other fields are one of them, as JSON. Options of a bus without a form
    in JSON become strings."""
    texts = {name: getattr(topology, name) for name in _Texts.__struct_fields__}
    known = {
        **vars(topology),
        **{f"{FRAMES}{name}": value for name, value in vars(topology.frames).items()},
        **{f"{PARAMETER}{name}": value for name, value in topology.parameters.items()},
    }
    found = {TEXTS: np.array(msgspec.json.encode(texts, enc_hook=_plain).decode())}
    return found | {name: known[name] for name in _NAMES}


def from_arrays(arrays: Mapping[str, np.ndarray]) -> Topology:
    """The topology of such arrays, which become read-only.

    Raises
    ------
    ValueError
        They are not those of a topology, or of another version.
    """
    try:
        texts: Any = msgspec.json.decode(str(arrays[TEXTS]), type=_Texts, dec_hook=_own)
    except (LookupError, ValueError) as error:
        got = f"must be buses, layouts and names of a topology; got {error}"
        raise ValueError(f"{TEXTS}: {got}") from None
    n = len(texts.unit_names)
    for name in _NAMES:
        if name not in arrays:
            raise ValueError(f"{name}: must be there, as this version of f3t-skin has it; got none")
        found, shape = arrays[name].shape, (*_ROWS.get(name, ()), n)
        if not name.startswith(_NOT_OF_UNITS) and found != shape:
            raise ValueError(f"{name}: must be of shape {shape}; got {found}")
    _check_indices(arrays, texts)
    fields: dict[str, Any] = {
        **msgspec.structs.asdict(texts), **{name: arrays[name] for name in _PLAIN}
    }  # fmt: skip
    topology = Topology(
        **fields,
        frames=Frames(**_beginning(FRAMES, arrays)),
        parameters=_beginning(PARAMETER, arrays),
    )
    seal(topology)
    return topology


def _check_indices(arrays: Mapping[str, np.ndarray], texts: Any) -> None:
    """Raise ValueError unless all indices are of something that is there."""
    n, start, frames = len(texts.unit_names), arrays["neighbour_start"], arrays["frames_can_id"]
    m = arrays["neighbour_index"].size
    limits = {
        "patch": (0, len(texts.patch_names)), "frames_bus": (0, len(texts.buses)),
        "frames_layout": (0, len(texts.layouts)), "frames_units": (-1, n),
        "frames_part": (0, MOST_PARTS), "neighbour_index": (0, n), "neighbour_start": (0, m + 1),
    }  # fmt: skip
    for name, (low, high) in limits.items():
        found = arrays[name]
        if found.dtype != np.int32 or not ((low <= found) & (found < high)).all():
            raise ValueError(f"{name}: must be int32 from {low} to {high - 1}; got others")
        if name.startswith(FRAMES) and found.shape[:1] != frames.shape:
            raise ValueError(f"{name}: must be one for each of {frames.size} frames; got others")
    if start.shape != (n + 1,) or start[0] or start[-1] != m or (np.diff(start) < 0).any():
        raise ValueError(
            f"neighbour_start: must be ends of the neighbours of {n} units; got {start}"
        )


def _beginning(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The known arrays whose names begin so, by the rest of their names."""
    return {name.removeprefix(prefix): arrays[name] for name in _NAMES if name.startswith(prefix)}


def _plain(value: object) -> object:
    """A value in the form for JSON: lists for the arrays of a robot, where null is NaN."""
    return value.tolist() if isinstance(value, np.ndarray) else str(value)


def _own(kind: type, value: Any) -> Any:
    return Path(value) if kind is Path else np.array(value, float)


def packed(topology: Topology) -> str:
    """A topology as text, for another process."""
    archive = io.BytesIO()
    np.savez_compressed(archive, allow_pickle=False, **to_arrays(topology))
    return base64.b64encode(archive.getvalue()).decode()


def unpacked(text: str) -> Topology:
    """The topology of a text that `packed` made; its arrays are read-only.

    Raises
    ------
    ValueError
        It is not one.

    Examples
    --------
    >>> import topology
    >>> unpacked(packed(topology.load("palm"))).n
    64
    """
    try:
        data = io.BytesIO(base64.b64decode(text, validate=True))
        with np.load(data, allow_pickle=False) as archive:
            arrays = dict(archive)
    except (ValueError, EOFError, OSError, AttributeError, TypeError, zipfile.BadZipFile) as error:
        raise ValueError(f"topology: must be text of a packed one; got: {error}") from None
    return from_arrays(arrays)
