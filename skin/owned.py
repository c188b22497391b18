"""Arrays that belong to a state: one copy of those of a cycle, and views of the copy.

A pipeline writes each cycle into the same arrays, but a state must not change later. So a state
copies them once, as a block of bytes, and makes an array of it when one is read. An attribute that
is never read costs only the copy of its bytes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["Layout", "Lazy"]

SMALL = 512
"""Bytes up to which an array is copied out of its block, to keep the block free [assumed]."""
WORD = 8
"""Alignment of every array in a block, bytes."""


class Layout:
    """Addresses of arrays, and their places in a copy.

    Parameters
    ----------
    arrays : mapping of str to ndarray or None
        Contiguous, and always the same; None for attributes that are None.
    wholes : sequence of ndarray
        Bases of which some arrays are views; each is copied in one piece.

    Attributes
    ----------
    parts : list of memoryview
        Memory that is copied.
    places : dict
        Shape, type and first byte of each array in a copy; None for attributes that are None.
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
        """Add a part: its address, its end, and its first byte in a copy."""
        assert array.flags.c_contiguous
        start, offset = _address(array), self.size
        self.parts.append(array.reshape(-1).view(np.uint8).data.cast("B"))
        if spare := -array.nbytes % WORD:
            self.parts.append(memoryview(bytes(spare)))
        self.size += array.nbytes + spare
        return start, start + array.nbytes, offset

    def copy(self) -> bytearray:
        """All parts now, one after another."""
        return bytearray().join(self.parts)

    def view(self, block: bytearray, name: str) -> Any:
        """An array of a copy; a small one owns its memory."""
        place = self.places[name]
        if place is None:
            return None
        array: np.ndarray = np.ndarray(place[0], place[1], block, place[2])
        return array.copy() if array.nbytes <= SMALL else array

    def rows(self, blocks: memoryview, count: int) -> dict[str, np.ndarray]:
        """Arrays of copies that follow one another, with a leading axis; they own their memory."""
        found = {}
        for name, place in self.places.items():
            if place is not None:
                shape, dtype, offset = place
                strides = self.size, *np.empty(shape, dtype).strides
                array = np.ndarray((count, *shape), dtype, blocks, offset, strides)
                found[name] = array.copy()
        return found


class Lazy:
    """Attributes that are made from a copy when they are first read.

    An object whose attributes are all set needs no copy.
    """

    __slots__ = ("_block", "_layout")

    _block: bytearray
    _layout: Layout

    def take(self, layout: Layout) -> None:
        """Copy the arrays of a layout as they are now."""
        self._block, self._layout = layout.copy(), layout

    def have(self, block: bytearray, layout: Layout) -> None:
        """Use a copy that exists."""
        self._block, self._layout = block, layout

    def __getattr__(self, name: str) -> Any:
        """An attribute that is not set yet."""
        if not name.startswith("_"):
            try:
                value = self._layout.view(self._block, name)
            except (AttributeError, KeyError):
                pass
            else:
                if value is None:
                    self._refuse_unwanted(name)
                setattr(self, name, value)
                return value
            if isinstance(getattr(type(self), name, None), property):  # a property of unwanted data
                self._refuse_unwanted(name)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def _refuse_unwanted(self, name: str) -> None:
        """Called for an attribute that is None; may raise."""

    def __getstate__(self) -> tuple[None, dict[str, Any]]:
        slots = type(self).__slots__
        return None, {name: getattr(self, name) for name in slots if hasattr(self, name)}


def _address(array: np.ndarray) -> int:
    return int(array.__array_interface__["data"][0])
