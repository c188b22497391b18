"""Arrays that a decoder reads, and what they must be; arrays of results, and their `Reading`."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
import numpy.typing as npt

from bus.compiled.aligned import zeros
from skin.decode.records import RESULT_ROWS
from skin.errors import CountsError
from skin.state import UNWANTED, Reading
from topology import CHANNELS, Topology

__all__ = ["Results", "check", "check_call", "plain"]

FIELDS = {
    "displacement": "displacement_mm", "displacement_sigma": "displacement_sigma_mm",
    "field": "field_ut",
}  # fmt: skip
"""Names of a `Reading` that differ from those of the kernel's rows."""


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


class Results:
    """What a kernel writes.

    Parameters
    ----------
    names : tuple of str
        Results in the order of the kernel's rows, of `records.RESULT_ROWS`.
    units : int
    real : dtype
    cycles : tuple of int
        (t,): of t cycles, one after the other.

    Attributes
    ----------
    values : ndarray, shape (r, n) or (t, r, n), float32 or float64
    flags : ndarray, shape (n,) or (t, n), uint16
    valid : ndarray, shape (n,) or (t, n), bool
    """

    def __init__(
        self, names: tuple[str, ...], units: int, real: np.dtype, cycles: tuple[int, ...] = ()
    ) -> None:
        self.names = names
        rows = sum(RESULT_ROWS[name] for name in names)
        self.values = zeros((*cycles, rows, units), real)
        self.flags = zeros((*cycles, units), np.uint16)
        self.valid = zeros((*cycles, units), bool)
        self.arrays = self.values, self.flags, self.valid

    def reading(self, shown: Collection[str]) -> Reading:
        """Views of quantities that are `shown`, and of their sigmas."""
        found: dict[str, np.ndarray] = dict.fromkeys(
            ("temperature", "force", "tangential", "theta", "displacement_mm"), UNWANTED
        )
        row = 0
        for name in self.names:
            size = RESULT_ROWS[name]
            if name.removesuffix("_sigma") in shown:
                place = row if size == 1 else slice(row, row + size)
                rows = self.values[..., place, :]
                found[FIELDS.get(name, name)] = rows
            row += size
        if "test_ratio" in shown and "test_ratio" not in self.names:
            found["test_ratio"] = np.full_like(self.flags, np.nan, self.values.dtype)
        return Reading(**found, status=self.flags, valid=self.valid)
