"""Arrays that belong to a state: one copy of a cycle's, and views of it for whoever asks.

A pipeline writes each cycle into the same arrays. A state must stay true all the same, whoever
keeps it: it has one copy, a block of bytes, and makes an array of it where one is asked for. A view
costs its making, so that what nobody reads costs no more than its bytes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["Layout", "Lazy"]

SMALL = 512
"""Bytes of an array that is copied out of its block, and keeps nothing else alive [assumed]."""
WORD = 8
"""Bytes at whose multiples every array begins."""


class Layout:
    """Where arrays lie, and where in a copy of them.

    Parameters
    ----------
    arrays : mapping of str to ndarray or None
        Contiguous, and always the same; None for what reads None.
    wholes : sequence of ndarray
        What some of them are views of, and is copied in one piece.

    Attributes
    ----------
    parts : list of memoryview
        What a copy is made of.
    places : dict
        Shape, type and byte of each array in a copy; None for what reads None.
    size : int
        Bytes of a copy.
    """

    def __init__(
        self, arrays: Mapping[str, np.ndarray | None], wholes: Sequence[np.ndarray] = ()
    ) -> None:
        self.parts: list[memoryview] = []
        self.places: dict[str, Any] = {}
        self.size = 0
        found: list[tuple[int, int, int]] = []
        for array in wholes:
            found.append(self._add(array))
        for name, array in arrays.items():
            if array is None:
                self.places[name] = None
                continue
            start = _address(array)
            place = next((p for p in found if p[0] <= start < p[1]), None)
            if place is None:
                found.append(place := self._add(array))
            self.places[name] = array.shape, array.dtype, place[2] + start - place[0]

    def _add(self, array: np.ndarray) -> tuple[int, int, int]:
        """One more part: its address, its end, and its first byte in a copy."""
        assert array.flags.c_contiguous
        start, offset = _address(array), self.size
        self.parts.append(array.reshape(-1).view(np.uint8).data.cast("B"))
        if spare := -array.nbytes % WORD:
            self.parts.append(memoryview(bytes(spare)))
        self.size += array.nbytes + spare
        return start, start + array.nbytes, offset

    def copy(self) -> bytearray:
        """All parts as they are now, one after another."""
        return bytearray().join(self.parts)

    def view(self, block: bytearray, name: str) -> Any:
        """An array of a copy, of its own if it is small."""
        place = self.places[name]
        if place is None:
            return None
        array: np.ndarray = np.ndarray(place[0], place[1], block, place[2])
        return array.copy() if array.nbytes <= SMALL else array


class Lazy:
    """Attributes that are made of a copy when they are first asked for.

    An object whose attributes are set needs no copy, and is the same otherwise.
    """

    __slots__ = ("_block", "_layout")

    _block: bytearray
    _layout: Layout

    def take(self, layout: Layout) -> None:
        """Have a copy of what the arrays of a layout are now."""
        self._block, self._layout = layout.copy(), layout

    def have(self, block: bytearray, layout: Layout) -> None:
        """Have a copy that is there."""
        self._block, self._layout = block, layout

    def __getattr__(self, name: str) -> Any:
        """What was not set; called for nothing else."""
        if not name.startswith("_"):
            try:
                value = self._layout.view(self._block, name)
            except (AttributeError, KeyError):
                pass
            else:
                setattr(self, name, value)
                return value
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __getstate__(self) -> tuple[None, dict[str, Any]]:
        return None, {name: getattr(self, name) for name in type(self).__slots__}


def _address(array: np.ndarray) -> int:
    return int(array.__array_interface__["data"][0])
