"""Arrays that are decoded: what they must be."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from skin.errors import CountsError
from topology import CHANNELS, Topology

__all__ = ["check", "check_call", "plain"]


def plain(array: np.ndarray) -> np.ndarray:
    """`array` as the kernel is compiled for: contiguous and writeable; a copy if it is not."""
    array = np.asarray(array)
    flags = array.flags
    return array if flags.c_contiguous and flags.writeable else array.copy()


def check_call(
    topology: Topology, real: np.dtype, raw: object, status: object, background: Any,
    cycles: tuple[int, ...] = (),
) -> None:  # fmt: skip
    """Raise CountsError unless these are the arrays of a call, of `cycles` in a batch."""
    check(topology, "raw", raw, np.int16, (*cycles, len(CHANNELS), topology.n))
    if status is not None:
        check(topology, "status", status, np.uint16, (*cycles, topology.n))
    if background is not None:
        given = np.shape(background)
        rows = 5 if len(given) == len(cycles) + 2 and given[-2] == 5 else 4
        check(topology, "background", background, real, (*cycles, rows, topology.n))


def check(
    topology: Topology, where: str, got: object, kind: npt.DTypeLike, shape: tuple[int, ...]
) -> None:
    """Raise CountsError unless `got` is an array of that kind and shape; `where` names it."""
    is_array = isinstance(got, np.ndarray)
    if is_array and got.dtype == kind and got.shape == shape:
        return
    what = f"{got.dtype}, shape {got.shape}" if is_array else type(got).__name__
    expected = f"shape {shape}"
    if where == "raw":
        units = f"{len(CHANNELS)}, {topology.n}"
        expected = f"shape ({units}) or shape (t, {units})"
    raise CountsError(
        f"{topology.name}: {where}: must be an array of {np.dtype(kind).name}, "
        f"{expected}; got {what}"
    )
