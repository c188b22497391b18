"""The arrays that are decoded: what they must be, and the kernel bound to those of one cycle."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bus.compiled.aligned import zeros
from skin.decode import sharing
from skin.errors import CountsError
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from bus.compiled.bound import Bound
    from skin.decode.kernel import DecodeData

__all__ = ["Passes", "arrays_of", "check", "check_call", "plain"]

COPIED = 1 << 14
"""Units up to which the counts of a call are copied: to exchange addresses takes as long."""


class Passes:
    """The kernel on the arrays of one cycle, with a background and without.

    Parameters
    ----------
    kernel, model
        As of `skin.decode.kernel`.
    data : callable
        The data of each share of the units, given counts, status, and whether without background.
    counts, status : ndarray
        As of `skin.decode.kernel.DecodeData`.

    Attributes
    ----------
    calls : dict
        Of those that were needed, by whether they are without a background.
    """

    def __init__(
        self,
        kernel: Callable[..., None],
        model: tuple,
        data: Callable[[np.ndarray, np.ndarray, bool], list[DecodeData]],
        counts: np.ndarray,
        status: np.ndarray,
    ) -> None:
        self._kernel, self._model, self._data = kernel, model, data
        self._inputs = counts, status
        self._none: np.ndarray | None = None
        self.calls: dict[bool, Bound | sharing.Shared] = {}

    def at(self, bare: bool) -> Bound | sharing.Shared:
        """The kernel, `bare` without a background; compiled, or loaded, if it was not."""
        from bus.compiled.bound import Bound

        calls = [
            Bound(self._kernel, self._model, data) for data in self._data(*self._inputs, bare)
        ]  # fmt: skip
        call = self.calls[bare] = calls[0] if len(calls) == 1 else sharing.Shared(calls)
        return call

    def renew(self, model: tuple) -> None:
        """Decode by another model from now on."""
        self._model = model
        self.calls.clear()

    def take(self, raw: np.ndarray, status: np.ndarray | None) -> None:
        """Decode other counts, shape (c, n), and flags, shape (n,), None for none, from now on."""
        counts, flags = self._inputs
        if raw.shape[1] <= COPIED:
            counts[0], flags[0] = raw, 0 if status is None else status
            return
        if self._none is None:
            self._none = zeros(raw.shape[1], np.uint16)
        status = self._none if status is None else status
        self._inputs = plain(raw)[np.newaxis], plain(status)[np.newaxis]
        for call in self.calls.values():
            for name, array in zip(("counts", "status"), self._inputs, strict=True):
                call.put((1, name), array)


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
