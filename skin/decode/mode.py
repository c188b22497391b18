"""What the kernel of a decoder is told beside its arrays."""

from __future__ import annotations

import numpy as np

__all__ = ["Mode"]


class Mode:
    """Tells the kernel how the next cycle is decoded, where that is not as with the last one.

    Parameters
    ----------
    control : ndarray, `skin.decode.records.CONTROL`
    live : slice
        Of the share that decodes single cycles.

    Attributes
    ----------
    now : tuple of bool, or None
        What was told last: whether without a background, and whether filters go on; None if
        nothing was, or something else has changed since.
    phase : ndarray, shape (1,), int64
        Number of the next cycle.
    advance : ndarray
        Whether filters go on: the kernel reads it.
    """

    def __init__(self, control: np.ndarray, live: slice) -> None:
        self._reuse, self.advance = control["reuse"], control["advance"]
        self.phase = control["phase"][live][:1]
        self.now: tuple[bool, bool] | None = None

    def tell(self, bare: bool, advance: bool) -> None:
        """The next cycle is `bare` without a background, and filters `advance` or not."""
        self.advance[...] = advance
        if self.now is None or bare is not self.now[0]:
            self._reuse[...] = False
        self.now = bare, advance
