"""Frames in, blocks out: the spine over many cycles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from bus.frame import FrameViews, views
from skin.blocks.block import Block
from skin.blocks.gather import Gather

if TYPE_CHECKING:
    from skin.blocks.stride import Stride
    from skin.pipeline import Pipeline
    from skin.state import State

__all__ = ["Blocks", "blocks_of"]

SHORTEST = 8
"""Cycles for which a stride is worth its call [assumed]."""


class Blocks:
    """A pipeline whose states come as blocks; every number is that of its states, to the bit.

    Parameters
    ----------
    pipeline : Pipeline
        Before its first cycle.
    most : int, optional
        Cycles of a block at most; by default a block has some megabytes.
    fast : bool
        Whether many cycles go in one compiled call where they can.
    """

    def __init__(self, pipeline: Pipeline, most: int | None = None, *, fast: bool = True) -> None:
        self._pipeline = pipeline
        self._gather = Gather(pipeline, most)
        self._stride: Stride | None = None
        if fast:
            from skin.blocks.stride import Stride

            self._stride = Stride(pipeline)

    def feed(self, frames: np.ndarray) -> Iterator[Block]:
        """Take frames of all buses, in their order; yield every block that is full.

        Go through to the end: nothing is taken before the iterator asks for it.

        Parameters
        ----------
        frames : ndarray, shape (m,), FRAME_DTYPE
        """
        pipeline = self._pipeline
        if pipeline.zeros is not None:
            pipeline.zeros.hear(frames)
        frames = np.ascontiguousarray(frames).view()
        frames.flags.writeable = False
        rows, row = views(frames), 0
        while row < frames.size:
            row = self._go_on(row, rows)
            if self._gather.is_full:
                block = self._gather.block()
                assert block is not None
                yield block

    def flush(self) -> Block | None:
        """The last block, with what is open at the end of the log; None if there is nothing."""
        state = self._pipeline.flush()
        if state is not None:
            self._gather.add(state)
        return self._gather.block()

    def _go_on(self, row: int, rows: FrameViews) -> int:
        """Take frames until the block is full, a cycle needs a look, or they end."""
        pipeline, gather = self._pipeline, self._gather
        cycles = 0 if self._stride is None else self._stride.ready()
        if self._stride is not None and cycles >= SHORTEST:
            row, left = self._stride.run(row, rows, gather, cycles)
            if left:
                gather.add(pipeline.step(pipeline.assembler.cycle()))
            return row
        row, cycle = pipeline.assembler.take(row, rows)
        if cycle is not None:
            gather.add(pipeline.step(cycle))
        return row


def blocks_of(
    states: Iterable[State], pipeline: Pipeline, most: int | None = None
) -> Iterator[Block]:
    """Blocks of states that a pipeline makes for somebody else, a replay for instance."""
    gather = Gather(pipeline, most)
    for state in states:
        gather.add(state)
        if gather.is_full:
            block = gather.block()
            assert block is not None
            yield block
    last = gather.block()
    if last is not None:
        yield last
