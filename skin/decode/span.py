"""The lanes that a stage of the kernel works on."""

from __future__ import annotations

from typing import NamedTuple

from bus.compiled.jit import jitable
from skin.decode.records import LANES, NOT_NEGATIVE

__all__ = ["Span", "lanes_of"]


class Span(NamedTuple):
    """Lanes of a block, of a cycle: what a stage works on.

    Attributes
    ----------
    cycle : int
    first : int
        Unit in lane 0.
    start, size : int
        Lanes: the first of them, and how many.
    """

    cycle: int
    first: int
    start: int
    size: int


@jitable(inline=True)
def lanes_of(span):
    """`first`, `start` and `size` of a span, as numbers of which the compiler knows that they are
    not negative: so a stage becomes vector instructions wherever it is compiled."""
    most = 2 * LANES - 1
    return span.first & NOT_NEGATIVE, span.start & most, span.size & most
