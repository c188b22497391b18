"""Frames in, blocks out: the pipeline over many cycles."""

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
"""Cycles above which a stride is worth its call [assumed]."""


class Blocks:
    """A pipeline whose states come as blocks; every number equals that of its states, to the bit.

    Parameters
    ----------
    pipeline : Pipeline
        Before its first cycle.
    most : int, optional
        Maximum cycles of a block; by default a block has some megabytes.
    fast : bool
        Whether one compiled call runs many cycles where possible.
    """

    def __init__(self, pipeline: Pipeline, most: int | None = None, *, fast: bool = True) -> None:
        self._pipeline = pipeline
        self._gather = Gather(pipeline, most)
        self._stride: Stride | None = None
        if fast:
            from skin.blocks.stride import Stride

            self._stride = Stride(pipeline)

    def feed(self, frames: np.ndarray) -> Iterator[Block]:
        """Take frames of all buses, in order; yields every block that is full.

        Consume the whole iterator: frames are taken only as it advances.

        Parameters
        ----------
        frames : ndarray, shape (m,), FRAME_DTYPE
        """
        pipeline = self._pipeline
        pipeline.hear(frames)
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
        """The last block, with the open cycle at the end of the log; None if there is none."""
        state = self._pipeline.flush()
        if state is not None:
            self._gather.add(state)
        return self._gather.block()

    def _go_on(self, row: int, rows: FrameViews) -> int:
        """Take frames until the block is full, a cycle needs Python, or they end."""
        pipeline, gather = self._pipeline, self._gather
        cycles = 0 if self._stride is None else self._stride.ready()
        if self._stride is not None and cycles >= SHORTEST:
            return self._stride.run(row, rows, gather, cycles)
        row, cycle = pipeline.assembler.take(row, rows)
        if cycle is not None:
            gather.add(pipeline.step(cycle))
        return row


def blocks_of(
    states: Iterable[State], pipeline: Pipeline, most: int | None = None
) -> Iterator[Block]:
    """Blocks of the states of another iterator, a replay for instance."""
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
