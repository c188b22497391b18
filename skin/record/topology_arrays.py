"""A topology as named arrays, and back: as it was in a run, whatever became of its files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from bus.errors import LogError
from topology import CHANNELS, Topology
from topology.arrays import Frames
from topology.model import TABLES, UnitModel
from topology.schema import Bus
from topology.wire import WireLayout

__all__ = ["differences", "from_arrays", "to_arrays"]

TEXTS = "texts"
FRAMES, PARAMETER = "frames_", "parameter_"
OF_FRAMES = ("bus", "can_id", "layout", "part", "units")
KINDS = {
    "patch": "i4", "enabled": "?", "position": "f8", "rotation": "f8", "area": "f8",
    "calibrated": "?", "tared": "?", "scale": "f8", "offset": "f8", "wired": "?",
    "neighbour_start": "i4", "neighbour_index": "i4",
    "frames_bus": "i4", "frames_can_id": "u4", "frames_layout": "i4", "frames_part": "i4",
    "frames_units": "i4",
}  # fmt: skip
"""Types of all arrays but the parameters, which are f8."""
PARAMETERS = tuple(field.name for field in msgspec.structs.fields(UnitModel))


class _Texts(msgspec.Struct, forbid_unknown_fields=True):
    """What is no array."""

    name: str
    buses: tuple[Bus, ...]
    layouts: tuple[WireLayout, ...]
    unit_names: tuple[str, ...]
    patch_names: tuple[str, ...]
    patch_frames: tuple[str, ...]


def to_arrays(topology: Topology) -> dict[str, np.ndarray]:
    """Arrays, by name; what is none is one of them, as JSON."""
    texts = {name: getattr(topology, name) for name in _Texts.__struct_fields__}
    found: dict[str, Any] = {TEXTS: np.array(json.dumps(msgspec.to_builtins(texts)))}
    for name in KINDS:
        frames = name.removeprefix(FRAMES)
        found[name] = getattr(*((topology.frames, frames) if frames != name else (topology, name)))
    return found | {f"{PARAMETER}{name}": value for name, value in topology.parameters.items()}


def from_arrays(where: str, arrays: Mapping[str, np.ndarray]) -> Topology:
    """The topology of arrays.

    Raises
    ------
    bus.LogError
        They are not those of a topology, or of one of another version.
    """

    def refuse(name: str, expected: str, got: object) -> LogError:
        return LogError(f"{where}: {name}: must be {expected}; got {got}")

    if TEXTS not in arrays:
        raise refuse(TEXTS, "there", "none")
    try:
        texts = msgspec.json.decode(str(arrays[TEXTS]).encode(), type=_Texts)
    except msgspec.DecodeError as error:
        raise refuse(TEXTS, "buses, layouts and names of a topology", error) from None
    n, known = len(texts.unit_names), {**KINDS, **{f"{PARAMETER}{p}": "f8" for p in PARAMETERS}}
    shapes = _shapes(n, arrays)
    for name, kind in known.items():
        found = arrays.get(name)
        if found is None:
            raise refuse(name, "there, as this version of f3t-skin has it", "none")
        if found.dtype != np.dtype(kind) or found.shape != shapes[name]:
            raise refuse(name, f"{np.dtype(kind)} of shape {shapes[name]}",
                         f"{found.dtype} of shape {found.shape}")  # fmt: skip
        if kind == "f8" and not np.isfinite(found).all():
            raise refuse(name, "finite", "a number that is not")
    limits = {
        "patch": (0, len(texts.patch_names)), "frames_bus": (0, len(texts.buses)),
        "frames_layout": (0, len(texts.layouts)), "frames_units": (-1, n), "frames_part": (0, 16),
        "neighbour_index": (0, n), "neighbour_start": (0, arrays["neighbour_index"].size + 1),
    }  # fmt: skip
    for name, (low, high) in limits.items():
        values = arrays[name]
        if values.size and not (low <= values.min() and values.max() < high):
            raise refuse(name, f"from {low} to {high - 1}", f"{values.min()} to {values.max()}")
    start = arrays["neighbour_start"]
    if n == 0 or not texts.buses or start[0] or (np.diff(start) < 0).any() or (
        start[-1] != arrays["neighbour_index"].size
    ):  # fmt: skip
        raise refuse("neighbour_start", "a graph of units", "none")
    for array in arrays.values():
        array.flags.writeable = False
    of_units: dict[str, Any] = {n: arrays[n] for n in KINDS if not n.startswith(FRAMES)}
    told: dict[str, Any] = {name: getattr(texts, name) for name in texts.__struct_fields__}
    return Topology(
        **told,
        path=None,
        frames=Frames(*(arrays[f"{FRAMES}{name}"] for name in OF_FRAMES)),
        parameters={name: arrays[f"{PARAMETER}{name}"] for name in PARAMETERS},
        **of_units,
    )


def _shapes(n: int, arrays: Mapping[str, np.ndarray]) -> dict[str, tuple[int, ...]]:
    """Shape of each array; those of f frames, and how many neighbours there are, are free."""
    f = arrays["frames_bus"].size if "frames_bus" in arrays else 0
    units = arrays.get("frames_units", np.zeros((f, 1)))
    slots = units.shape[1] if units.ndim == 2 else 1
    channels = (len(CHANNELS), n)
    near = arrays.get("neighbour_index", np.zeros(0)).size
    of_units = {name: (n,) for name in ("patch", "enabled", "area", "calibrated", "tared")}
    of_frames = {f"{FRAMES}{name}": (f,) for name in OF_FRAMES[:-1]}
    parameters = {
        f"{PARAMETER}{name}": (TABLES[name], n) if name in TABLES else (n,) for name in PARAMETERS
    }
    return {
        **of_units, **of_frames, **parameters, "position": (3, n), "rotation": (3, 3, n),
        "scale": channels, "offset": channels, "wired": channels, "neighbour_start": (n + 1,),
        "neighbour_index": (near,), "frames_units": (f, slots),
    }  # fmt: skip


def differences(recorded: Topology, given: Topology) -> list[str]:
    """What is not the same in two topologies, in words; empty if they decode the same."""
    found = []
    for name in ("name", "unit_names", "patch_names"):
        one, other = getattr(recorded, name), getattr(given, name)
        if one != other:
            found.append(f"{name.replace('_', ' ')}: {_shown(one, other)}")
    if found and recorded.n != given.n:
        return found
    buses = [bus.name for bus in recorded.buses], [bus.name for bus in given.buses]
    if buses[0] != buses[1]:
        found.append(f"buses: {_shown(*map(tuple, buses))}")
    if recorded.layouts != given.layouts:
        found.append("layouts of the frames")
    one, other = to_arrays(recorded), to_arrays(given)
    for name, values in one.items():
        theirs = other.get(name)
        if name == TEXTS or theirs is None:
            continue
        if values.shape != theirs.shape:
            found.append(f"{name.removeprefix(PARAMETER)}: {values.shape} and {theirs.shape}")
        elif not np.array_equal(values, theirs):
            found.append(name.removeprefix(PARAMETER) + _units(values, theirs, given))
    return found


def _units(values: np.ndarray, theirs: np.ndarray, topology: Topology) -> str:
    """Whose values differ, where they are of units."""
    if values.shape[-1:] != (topology.n,):
        return ""
    units = np.flatnonzero((values != theirs).reshape(-1, topology.n).any(axis=0))
    more = f" and {units.size - 1} more" if units.size > 1 else ""
    return f" of {topology.unit_names[units[0]]}{more}"


def _shown(one: Any, other: Any) -> str:
    """Two values; of two lists, the first names that only one of them has."""
    if isinstance(one, str):
        return f"{one!r} and {other!r}"
    only, others = ([name for name in a if name not in b] for a, b in ((one, other), (other, one)))
    told = [
        f"{len(names)} only in {place} ({names[0]!r}{', …' if len(names) > 1 else ''})"
        for names, place in ((only, "the recording"), (others, "the topology given"))
        if names
    ]
    return ", ".join(told) or "another order"
