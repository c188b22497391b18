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
from topology.model import PARAMETERS, TABLES
from topology.robot.model import RobotModel
from topology.schema import Bus
from topology.wire import CHANNELS, WireLayout

__all__ = ["TEXTS", "from_arrays", "is_calibration", "packed", "to_arrays", "unpacked"]

TEXTS = "texts"
FRAMES, PARAMETER = "frames_", "parameter_"
KINDS: dict[str, tuple[str, tuple[int | str, ...]]] = {
    "patch": ("i4", ("n",)),
    "enabled": ("?", ("n",)),
    "position": ("f8", (3, "n")),
    "rotation": ("f8", (3, 3, "n")),
    "area": ("f8", ("n",)),
    "patch_position": ("f8", (3, "patches")),
    "patch_rotation": ("f8", (3, 3, "patches")),
    "calibrated": ("?", ("n",)),
    "tared": ("?", ("n",)),
    "scale": ("f8", (len(CHANNELS), "n")),
    "offset": ("f8", (len(CHANNELS), "n")),
    "wired": ("?", (len(CHANNELS), "n")),
    "neighbour_start": ("i4", ("ends",)),
    "neighbour_index": ("i4", ("neighbours",)),
    "frames_bus": ("i4", ("frames",)),
    "frames_can_id": ("u4", ("frames",)),
    "frames_layout": ("i4", ("frames",)),
    "frames_part": ("i4", ("frames",)),
    "frames_units": ("i4", ("frames", "slots")),
    **{
        f"{PARAMETER}{name}": ("f8", (TABLES[name], "n") if name in TABLES else ("n",))
        for name in PARAMETERS
    },
}
"""Type and shape of each array; n units make ``ends = n + 1``, other lengths are free but
that of the patches."""


class _Texts(msgspec.Struct, forbid_unknown_fields=True):
    """Fields other than arrays."""

    name: str
    path: Path | None
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
    return found | {name: known[name] for name in KINDS}


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
    n = len(texts.unit_names)
    lengths: dict[int | str, int] = {"n": n, "ends": n + 1, "patches": len(texts.patch_names)}
    for name, (kind, shape) in KINDS.items():
        found = arrays.get(name)
        if found is None:
            raise refuse(name, "there, as this version of f3t-skin has it", "none")
        if found.ndim == len(shape):
            for length, given in zip(shape, found.shape, strict=True):
                lengths.setdefault(length, given if isinstance(length, str) else length)
        sizes = tuple(lengths.get(length, length) for length in shape)
        if found.dtype != np.dtype(kind) or found.shape != sizes:
            raise refuse(name, f"{np.dtype(kind)} of shape {sizes}",
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
    fields: dict[str, Any] = {
        **{name: getattr(texts, name) for name in texts.__struct_fields__},
        **{name: arrays[name] for name in KINDS if not name.startswith((FRAMES, PARAMETER))},
    }
    return Topology(
        **fields,
        frames=Frames(**_beginning(FRAMES, arrays)),
        parameters=_beginning(PARAMETER, arrays),
    )


def _beginning(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The known arrays whose names begin so, by the rest of their names."""
    return {name.removeprefix(prefix): arrays[name] for name in KINDS if name.startswith(prefix)}


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
