"""Decoding without what the cycles before tell: the fields of neighbours' films, and drifts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from skin.state import Reading

if TYPE_CHECKING:
    from skin.decode.ambient import Ambient
    from skin.decode.crosstalk import CrossTalk

__all__ = ["Loop"]


class Loop:
    """Predicts what is not a unit's own signal, lets it be subtracted, and learns from the rest.

    Parameters
    ----------
    crosstalk : CrossTalk or None
    ambient : Ambient or None
    sweeps : int
        Predictions and decodings of a cycle, where there is `crosstalk`.
    whole : Reading
        What is decoded, in arrays that stay the same.
    film_above : ndarray, shape (n,), or None
        Film temperatures above reference, likewise.
    taken : ndarray, shape (5, n)
        Written: the background that the decoder subtracts.

    Attributes
    ----------
    crosstalk, ambient
        As given.
    elapsed_s : float or None
        From the last cycle to the next one; None: a period.
    """

    def __init__(
        self, crosstalk: CrossTalk | None, ambient: Ambient | None, sweeps: int, whole: Reading,
        film_above: np.ndarray | None, taken: np.ndarray,
    ) -> None:  # fmt: skip
        self.crosstalk, self.ambient, self._sweeps = crosstalk, ambient, sweeps
        self._whole, self._film_above, self._taken = whole, film_above, taken
        self._base = np.zeros_like(taken)
        self._known = np.zeros_like(taken) if ambient is None else ambient.taken
        self._predict: dict[bool, Callable[[], object]] = {}
        self._follow: Callable[[float | None], None] | None = None
        self.elapsed_s: float | None = None

    def tell(self, background: np.ndarray) -> None:
        """Take a background of the caller's, of 4 or 5 rows, for the next call."""
        self._base[:] = self._known
        self._base[: len(background)] += background

    def warmup(self) -> None:
        """Compile what a cycle needs, or load it."""
        if self.crosstalk is not None:
            self.crosstalk.warmup()
            self._bind_prediction(self.crosstalk, False)
        if self.ambient is not None:
            self.ambient.warmup(self._whole)

    def __call__(self, decode: Callable[[bool], Reading], told: bool, advance: bool) -> Reading:
        """Decode a cycle by ``decode(advance)``, on top of what was `told` or not."""
        if self.crosstalk is None:
            self._taken[:] = self._base if told else self._known
            reading = decode(advance)
        else:
            predict = self._predict.get(told) or self._bind_prediction(self.crosstalk, told)
            predict()
            reading = decode(advance)
            for _ in range(1, self._sweeps):
                predict()
                decode(False)
        if self.ambient is not None and advance:
            self._follow = follow = self._follow or self.ambient.bound(self._whole)
            follow(self.elapsed_s)
            self.elapsed_s = None
        return reading

    def _bind_prediction(self, crosstalk: CrossTalk, told: bool) -> Callable[[], object]:
        """The prediction of cross-talk on top of a background that is told, or not."""
        whole, base = self._whole, self._base if told else self._known
        predict = self._predict[told] = crosstalk.bound(
            whole.displacement_mm, whole.valid, self._taken, base, self._film_above
        )
        return predict
