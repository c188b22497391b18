"""Arrays that a decoder reads, and what they must be; arrays of results, and their `Reading`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from bus.compiled.aligned import zeros
from skin.decode import records as k
from skin.errors import CountsError
from skin.state import UNWANTED, Reading
from topology import CHANNELS, Topology

__all__ = ["Results", "check", "check_call", "plain", "rows_of"]

FIELDS = {"displacement": ("displacement_mm", "displacement_sigma_mm"), "field": ("field_ut", "")}
"""Names in a `Reading` that differ from what is wanted, and of their sigmas."""


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
    units : int
    real : dtype
    cycles : tuple of int
        (t,): of t cycles, one after the other.

    Attributes
    ----------
    values : ndarray, shape (RESULTS, n) or (t, RESULTS, n), float32 or float64
        Rows as in `skin.decode.records`.
    flags : ndarray, shape (n,) or (t, n), uint16
    valid : ndarray, shape (n,) or (t, n), bool
    """

    def __init__(self, units: int, real: np.dtype, cycles: tuple[int, ...] = ()) -> None:
        self.values = zeros((*cycles, k.RESULTS, units), real)
        self.flags = zeros((*cycles, units), np.uint16)
        self.valid = zeros((*cycles, units), bool)
        self.arrays = self.values, self.flags, self.valid

    def reading(self, rows: Mapping[str, int | slice]) -> Reading:
        """Views of these rows of `values`, as quantities; see `rows_of`."""
        found: dict[str, Any] = dict.fromkeys(
            ("temperature", "force", "tangential", "theta", "displacement_mm"), UNWANTED
        )
        found |= {name: self.values[..., row, :] for name, row in rows.items()}
        return Reading(**found, status=self.flags, valid=self.valid)

    def kept(self, rows: Mapping[str, int | slice]) -> Reading:
        """A reading of these rows of one cycle, on one copy of all."""
        own, values = object.__new__(Reading), self.values[: k.FORCE_PER_UT].copy()
        for name, row in rows.items():
            setattr(own, name, values[row])
        own.status, own.valid, own.names = self.flags.copy(), self.valid.copy(), None
        return own


def rows_of(shown: Collection[str], *, sigma: bool) -> dict[str, int | slice]:
    """Rows of the quantities that are `shown`, and of their sigmas, by their names in a reading."""
    rows: dict[str, int | slice] = {}
    for name, (first, count) in k.ROWS.items():
        if name not in shown:
            continue
        field, field_sigma = FIELDS.get(name, (name, f"{name}_sigma"))
        rows[field] = _rows(first, count)
        if sigma and first < k.SIGMA:
            rows[field_sigma] = _rows(first + k.SIGMA, count)
    return rows


def _rows(first: int, count: int) -> int | slice:
    return first if count == 1 else slice(first, first + count)
