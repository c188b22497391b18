"""Frames in, blocks out: the pipeline over many cycles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from bus.frame import views
from skin.blocks.block import Block
from skin.blocks.gather import Gather

if TYPE_CHECKING:
    from skin.pipeline import Pipeline
    from skin.state import State

__all__ = ["Blocks", "blocks_of"]


class Blocks:
    """A pipeline whose states come as blocks; every number equals that of its states, to the bit.

    Parameters
    ----------
    pipeline : Pipeline
        Before its first cycle.
    most : int, optional
        Maximum cycles of a block; by default a block has some megabytes.
    """

    def __init__(self, pipeline: Pipeline, most: int | None = None) -> None:
        self._pipeline = pipeline
        self._gather = Gather(pipeline, most)

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
            row, cycle = pipeline.assembler.take(row, rows)
            if cycle is not None:
                self._gather.add(pipeline.step(cycle))
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
