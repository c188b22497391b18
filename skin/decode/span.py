"""The lanes that a stage of the kernel works on."""

from __future__ import annotations

from typing import NamedTuple

from bus.compiled.jit import jitable
from skin.decode.records import LANES

__all__ = ["Place", "Span", "lanes_of", "place"]


class Span(NamedTuple):
    """Lanes of a block, of a cycle: what a stage works on.

    Attributes
    ----------
    cycle : int
    first : int
        Unit in lane 0.
    shown : int
        Place of its results in each row.
    size : int
        Lanes.
    """

    cycle: int
    first: int
    shown: int
    size: int


class Place(NamedTuple):
    """Where a unit stands: cycle, unit of all, lane of its block, place in each row of results."""

    cycle: int
    unit: int
    lane: int
    shown: int


@jitable(inline=True)
def lanes_of(span):
    """A span of which the compiler knows that it has `LANES` lanes at most: it chooses the width of
    vectors by what the most that there may be leaves over."""
    return Span(span.cycle, span.first, span.shown, min(span.size, LANES))


@jitable(inline=True)
def place(span, lane):
    """Where a lane's unit stands."""
    return Place(span.cycle, span.first + lane, lane, span.shown + lane)
