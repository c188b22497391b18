"""The arrays that are decoded: what they must be, and the cycle that is bound to them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bus.compiled.aligned import zeros
from skin.errors import CountsError
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from bus.compiled.bound import Bound
    from skin.cycle import Cycle

__all__ = ["BoundKernels", "arrays_of", "check", "check_call", "plain"]


class BoundKernels:
    """The cycle of a decoder on counts and flags, with a background of the caller's and without.

    Parameters
    ----------
    make : callable
        What a `Cycle` is made by, given counts, flags, and whether there is such a background.
    kernel : callable
        The stage that decodes, given the same.
    counts, status : ndarray
        As of `skin.decode.kernel.DecodeData`.
    """

    def __init__(
        self,
        make: Callable[..., Any],
        kernel: Callable[..., Bound],
        counts: np.ndarray,
        status: np.ndarray,
    ) -> None:
        self._make, self._kernel = make, kernel
        self._inputs = counts, status
        self._cycles: dict[bool, Cycle] = {}

    def at(self, given: bool) -> Cycle:
        """The cycle with a background that is `given`, or without."""
        from skin.cycle import Cycle

        found = self._cycles.get(given)
        if found is None:
            found = self._cycles[given] = Cycle(lambda: self._make(*self._inputs, given))
        return found

    def renew(self) -> None:
        """Decode by another model from now on."""
        for given, cycle in self._cycles.items():
            if cycle.is_bound:
                cycle.put(self._kernel(*self._inputs, given))

    def take(self, raw: np.ndarray, status: np.ndarray | None) -> None:
        """Decode other counts, shape (c, n), and flags, shape (n,), None for none, from now on."""
        counts, flags = self._inputs
        counts[0], flags[0] = raw, 0 if status is None else status


def arrays_of(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Counts and flags of a cycle of n units, to be written."""
    return zeros((1, len(CHANNELS), n), np.int16), zeros((1, n), np.uint16)


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
