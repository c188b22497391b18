"""The results of the kernel, one below the other, and the `Reading` that they make."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from bus.compiled.aligned import zeros
from skin.decode import records
from skin.state import UNWANTED, Reading

__all__ = ["Results"]

FIELDS = {
    "displacement": "displacement_mm", "displacement_sigma": "displacement_sigma_mm",
    "field": "field_ut",
}  # fmt: skip
"""Names of a `Reading` that differ from those of the kernel's rows."""


class Results:
    """What a kernel writes: arrays of t cycles.

    Parameters
    ----------
    names : tuple of str
        Results in the order of the kernel's rows, of `records.RESULT_ROWS`.
    cycles, units : int
    real : dtype

    Attributes
    ----------
    values : ndarray, shape (t, r, n), float32 or float64
    flags : ndarray, shape (t, n), uint16
    valid : ndarray, shape (t, n), bool
    """

    def __init__(self, names: tuple[str, ...], cycles: int, units: int, real: np.dtype) -> None:
        self.names = names
        rows = sum(records.RESULT_ROWS[name] for name in names)
        self.values = zeros((cycles, rows, units), real)
        self.flags = zeros((cycles, units), np.uint16)
        self.valid = zeros((cycles, units), bool)
        self.arrays = self.values, self.flags, self.valid

    def reading(self, at: int | slice, shown: Collection[str]) -> Reading:
        """Views of a cycle, or of all of them; of quantities that are `shown`, and their sigmas."""
        found: dict[str, np.ndarray] = dict.fromkeys(
            ("temperature", "force", "tangential", "theta", "displacement_mm"), UNWANTED
        )
        row = 0
        for name in self.names:
            size = records.RESULT_ROWS[name]
            if name.removesuffix("_sigma") in shown:
                rows = self.values[at, row] if size == 1 else self.values[at, row : row + size]
                found[FIELDS.get(name, name)] = rows
            row += size
        if "test_ratio" in shown and "test_ratio" not in self.names:
            found["test_ratio"] = np.full_like(self.flags[at], np.nan, self.values.dtype)
        return Reading(**found, status=self.flags[at], valid=self.valid[at])
