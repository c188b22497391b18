"""A topology as named arrays, for a recording or another process, with all fields as in memory.

Changes after loading are included: other buses, exact units, zeros. Nothing is pickled, and
unpacking checks all fields, since files can be damaged.
"""

from __future__ import annotations

import base64
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from topology.arrays import Frames, Topology
from topology.model import TABLES, UnitModel
from topology.robot.model import RobotModel
from topology.schema import Bus
from topology.wire import CHANNELS, WireLayout

__all__ = [
    "TEXTS", "from_arrays", "is_calibration", "packed", "robot_of", "robot_text", "to_arrays",
    "unpacked",
]  # fmt: skip

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
    """Fields other than arrays."""

    name: str
    path: str | None
    cycle_rate_hz: float
    sync_id: int | None
    buses: tuple[Bus, ...]
    layouts: tuple[WireLayout, ...]
    unit_names: tuple[str, ...]
    patch_names: tuple[str, ...]
    patch_frames: tuple[str, ...]
    patch_links: tuple[str, ...] = ()
    robot: RobotModel | None = None
    serials: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


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
    found: dict[str, Any] = {TEXTS: np.array(msgspec.json.encode(texts, enc_hook=_plain).decode())}
    for name in KINDS:
        frames = name.removeprefix(FRAMES)
        found[name] = getattr(*((topology.frames, frames) if frames != name else (topology, name)))
    return found | {f"{PARAMETER}{name}": value for name, value in topology.parameters.items()}


def from_arrays(arrays: Mapping[str, np.ndarray]) -> Topology:
    """The topology of such arrays, which become read-only.

    Raises
    ------
    ValueError
        They are not those of a topology, or of another version.
    """

    def refuse(name: str, expected: str, got: object) -> ValueError:
        return ValueError(f"{name}: must be {expected}; got {got}")

    if TEXTS not in arrays:
        raise refuse(TEXTS, "there", "none")
    try:
        texts = msgspec.json.decode(str(arrays[TEXTS]).encode(), type=_Texts, dec_hook=_own)
    except (msgspec.DecodeError, ValueError) as error:
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
    if (fault := _robot_fault(texts)) is not None:
        raise refuse(TEXTS, "a robot whose links carry the patches", fault)
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
    of_units: dict[str, Any] = {name: arrays[name] for name in KINDS if not name.startswith(FRAMES)}
    fields: dict[str, Any] = {name: getattr(texts, name) for name in texts.__struct_fields__}
    fields["path"] = None if texts.path is None else Path(texts.path)
    return Topology(
        **fields,
        frames=Frames(*(arrays[f"{FRAMES}{name}"] for name in OF_FRAMES)),
        parameters={name: arrays[f"{PARAMETER}{name}"] for name in PARAMETERS},
        **of_units,
    )


def robot_text(robot: RobotModel) -> str:
    """A robot as JSON, for another process; NaN is null."""
    return msgspec.json.encode(robot, enc_hook=_plain).decode()


def robot_of(text: str) -> RobotModel:
    """The robot of such a text."""
    return msgspec.json.decode(text.encode(), type=RobotModel, dec_hook=_own)


def _robot_fault(texts: _Texts) -> str | None:
    """The fault of an included robot; None if there is none, or no robot."""
    robot, links = texts.robot, texts.patch_links
    if robot is None:
        return "links without one" if any(links) else None
    count, joints = len(robot.link_names), len(robot.joint_names)
    of_links = (robot.parent, robot.joints, robot.kinds, robot.driver)
    shapes = {
        "multiplier": (count,), "offset": (count,), "axis": (3, count), "anchor": (3, count),
        "xyz": (3, count), "rotation": (3, 3, count), "lower": (joints,), "upper": (joints,),
        "home": (joints,),
    }  # fmt: skip
    for name, shape in shapes.items():
        if getattr(robot, name).shape != shape:
            return f"{name} of shape {getattr(robot, name).shape}"
    if any(len(values) != count for values in of_links) or not 0 <= robot.base < count:
        return f"{count} links"
    if not all(-1 <= above < link for link, above in enumerate(robot.parent)):
        return "a link before its parent"
    if not all(-1 <= driver < joints for driver in robot.driver):
        return f"{joints} joints"
    known = len(links) == len(texts.patch_names) and {*links} <= {"", *robot.names}
    return None if known else "a patch on another link"


def _plain(value: object) -> object:
    """A value in the form for JSON: lists for the arrays of a robot, where null is NaN."""
    return value.tolist() if isinstance(value, np.ndarray) else str(value)


def _own(kind: type, value: Any) -> Any:
    if kind is Path:
        return Path(value)
    try:
        array = np.array(value, float)
    except (TypeError, ValueError):
        raise ValueError("must be an array of numbers") from None
    array.setflags(write=False)
    return array


def _shapes(n: int, arrays: Mapping[str, np.ndarray]) -> dict[str, tuple[int, ...]]:
    """Shape of each array; the numbers of frames and of neighbours are free."""
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
