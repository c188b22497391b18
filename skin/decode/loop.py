"""Decoding without what the cycles before tell: the fields of neighbours' films, and drifts."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skin.state import Reading

if TYPE_CHECKING:
    from skin.decode.ambient import Ambient, Follow
    from skin.decode.crosstalk import CrossTalk, Prediction
    from skin.decode.plan import Plan
    from skin.decode.results import Results
    from skin.physics.stencil import Stencil
    from topology import Topology

__all__ = ["Looks", "Loop", "Stages", "estimators", "loop_of"]


def estimators(
    topology: Topology, plan: Plan, stencil: Stencil | None
) -> tuple[CrossTalk | None, Ambient | None]:
    """What predicts the fields of neighbours and the ambient field; None what a plan leaves out."""
    crosstalk = ambient = None
    if plan.sweeps:
        from skin.decode.crosstalk import ACCURATE_UT, LIVE_UT, CrossTalk

        tolerance_ut = LIVE_UT if plan.sweeps == 1 else ACCURATE_UT
        crosstalk = CrossTalk(topology, stencil, dtype=plan.dtype, tolerance_ut=tolerance_ut)
    if plan.ambient:
        from skin.decode.ambient import Ambient

        ambient = Ambient(
            topology, plan.dtype, crosstalk=plan.sweeps > 0, every=plan.looks_every
        )  # fmt: skip
    return crosstalk, ambient


class Looks:
    """When the ambient field is estimated, and how long after the last time.

    Parameters
    ----------
    phase : ndarray
        `phase` of `skin.decode.records.CONTROL`: the number of the next cycle.
    plan : Plan
        The field is estimated in cycles whose number is a multiple of its `looks_every`.
    rate_hz : float

    Attributes
    ----------
    every : int
    since_s : float
        Since the last estimate.
    """

    def __init__(self, phase: np.ndarray, plan: Plan, rate_hz: float) -> None:
        self._phase, self.every, self._period_s = phase, plan.looks_every, 1.0 / rate_hz
        self.reset()

    def reset(self) -> None:
        """The next cycle is the first."""
        self.since_s = 0.0
        self._next_s: float | None = None

    def elapse(self, seconds: float) -> None:
        """Say how long after the last cycle the next one is, if that is not a period."""
        self._next_s = seconds

    def next(self) -> float | None:
        """Count the next cycle: seconds since the last estimate, None where there is none now."""
        self.since_s += self._period_s if self._next_s is None else self._next_s
        self._next_s = None
        if self.every > 1 and int(self._phase[0]) % self.every:
            return None
        since_s, self.since_s = self.since_s, 0.0
        return since_s


class Stages(NamedTuple):
    """What a `Loop` calls before and after its decoding, for who goes through many cycles in one
    compiled call."""

    prediction: Prediction | None
    """Before each decoding; where there is none, `background` is copied."""
    background: tuple[np.ndarray, np.ndarray]
    """Where it is copied to, and from."""
    follow: Follow | None
    """After the last decoding, where `looks` say so."""


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
    looks : Looks
        When `ambient` is told.

    Attributes
    ----------
    crosstalk, ambient, sweeps, looks
        As given.
    """

    def __init__(
        self, crosstalk: CrossTalk | None, ambient: Ambient | None, sweeps: int, whole: Reading,
        film_above: np.ndarray | None, taken: np.ndarray, looks: Looks,
    ) -> None:  # fmt: skip
        self.crosstalk, self.ambient, self.looks = crosstalk, ambient, looks
        self.sweeps = sweeps
        self.whole, self._film_above, self._taken = whole, film_above, taken
        self._base = np.zeros_like(taken)
        self._known = np.zeros_like(taken) if ambient is None else ambient.taken
        self._predict: dict[bool, Prediction] = {}
        self._follow: Follow | None = None

    def reset(self) -> None:
        """Forget what was learnt; the next cycle is the first."""
        self.looks.reset()
        if self.ambient is not None:
            self.ambient.reset()

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
            self.ambient.warmup(self.whole)

    def __call__(self, decode: Callable[[bool], Reading], told: bool, advance: bool) -> Reading:
        """Decode a cycle by ``decode(advance)``, on top of what was `told` or not."""
        elapsed_s = self.looks.next() if self.ambient is not None and advance else None
        if self.crosstalk is None:
            self._taken[:] = self._base if told else self._known
            reading = decode(advance)
        else:
            predict = self._predict.get(told) or self._bind_prediction(self.crosstalk, told)
            predict()
            reading = decode(advance)
            for _ in range(1, self.sweeps):
                predict()
                decode(False)
        if self.ambient is not None and elapsed_s is not None:
            self._follow = follow = self._follow or self.ambient.bound(self.whole)
            follow(elapsed_s)
        return reading

    @property
    def stages(self) -> Stages | None:
        """What a cycle is made of that is told no background; None before it was needed."""
        prediction = self._predict.get(False)
        is_missing = self.crosstalk is not None and prediction is None
        if is_missing or (self.ambient is not None and self._follow is None):
            return None
        return Stages(prediction, (self._taken, self._known), self._follow)

    def _bind_prediction(self, crosstalk: CrossTalk, told: bool) -> Prediction:
        """The prediction of cross-talk on top of a background that is told, or not."""
        whole, base = self.whole, self._base if told else self._known
        predict = self._predict[told] = crosstalk.bound(
            whole.displacement_mm, whole.valid, self._taken, base, self._film_above
        )
        return predict


def loop_of(
    crosstalk: CrossTalk | None, ambient: Ambient | None, plan: Plan, topology: Topology,
    names: Collection[str], out: Results, taken: np.ndarray, phase: np.ndarray,
) -> Loop | None:  # fmt: skip
    """What takes off the fields of neighbours and drifts; None where neither is estimated.

    Parameters
    ----------
    crosstalk, ambient, taken
        As of `Loop`.
    plan : Plan
    topology : Topology
    names : collection of str
        Of the results in `out`.
    phase : ndarray
        As of `Looks`.
    """
    if crosstalk is None and ambient is None:
        return None
    film_above = out.values[0, -1] if "film_above" in names else None
    return Loop(
        crosstalk, ambient, plan.sweeps, out.reading(0, {*names} - {"film_above"}), film_above,
        taken, Looks(phase, plan, topology.cycle_rate_hz),
    )  # fmt: skip
