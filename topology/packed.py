"""A topology as text, for another process: every field as it is now, whatever file it came from.

What was changed in memory goes along: other buses, exact units, zeros. The text is JSON; arrays are
in it as an .npz without pickle.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from topology.arrays import Frames, Topology
from topology.schema import Bus
from topology.wire import WireLayout

__all__ = ["packed", "unpacked"]

FRAMES, PARAMETERS = "frames.", "parameters."
"""Before the names of arrays that are no field of the topology itself."""


class _Text(msgspec.Struct, forbid_unknown_fields=True):
    """What is no array, and the arrays as one .npz."""

    name: str
    path: str | None
    buses: tuple[Bus, ...]
    layouts: tuple[WireLayout, ...]
    unit_names: tuple[str, ...]
    patch_names: tuple[str, ...]
    patch_frames: tuple[str, ...]
    arrays: bytes


def packed(topology: Topology) -> str:
    """The text of a topology. Options of a bus that JSON has no form for become strings."""
    arrays = {k: v for k, v in vars(topology).items() if isinstance(v, np.ndarray)}
    arrays |= {FRAMES + name: array for name, array in vars(topology.frames).items()}
    arrays |= {PARAMETERS + name: array for name, array in topology.parameters.items()}
    archive = io.BytesIO()
    np.savez_compressed(archive, allow_pickle=False, **arrays)
    text = _Text(
        topology.name, None if topology.path is None else str(topology.path), topology.buses,
        topology.layouts, topology.unit_names, topology.patch_names, topology.patch_frames,
        archive.getvalue(),
    )  # fmt: skip
    return msgspec.json.encode(text, enc_hook=str).decode()


def unpacked(text: str) -> Topology:
    """The topology of a text that `packed` made; its arrays are read-only.

    Raises
    ------
    ValueError
        It is none.

    Examples
    --------
    >>> import topology
    >>> unpacked(packed(topology.load("palm"))).n
    64
    """
    found = msgspec.json.decode(text, type=_Text)
    with np.load(io.BytesIO(found.arrays), allow_pickle=False) as archive:
        arrays: dict[str, Any] = dict(archive)
    for array in arrays.values():
        array.setflags(write=False)
    groups = {
        group: {name.removeprefix(group): arrays.pop(name) for name in [*arrays]
                if name.startswith(group)}
        for group in (FRAMES, PARAMETERS)
    }  # fmt: skip
    return Topology(
        name=found.name, path=None if found.path is None else Path(found.path), buses=found.buses,
        layouts=found.layouts, frames=Frames(**groups[FRAMES]), unit_names=found.unit_names,
        patch_names=found.patch_names, patch_frames=found.patch_frames,
        parameters=groups[PARAMETERS], **arrays,
    )  # fmt: skip
