"""What the benchmark of decoding times: the very calls, with what they read and tell."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from benchmarks.peers_bare import Bare, compiler
from benchmarks.peers_decode import Paper, array_of, counts_of, numpy_decode
from bus.compiled.aligned import zeros
from skin.decode.decoder import Decoder
from skin.options import ESTIMATORS
from skin.state import Reading, if_wanted
from topology import Topology

__all__ = [
    "BARE", "FEW", "LIVE", "NINE", "Side", "calibrated_sides", "recording_side", "sides_of",
]  # fmt: skip

NINE = {"temperature", "force", "tangential", "theta", "displacement"}
"""The quantities of the peers."""
LIVE = {"temperature", "force"}
BARE = "bare arithmetic in C"
FEW = 64
"""Units of a recording."""
COMPARED = (("float64", "sine", "per unit"), ("float32", "sine", "per unit"),
            ("float32", "field-angle", "per unit"), ("float32", "sine", "alike"),
            ("float32", "field-angle", "alike"))  # fmt: skip
"""Type, estimator and calibration of the decoders of all nine quantities."""


class Side(NamedTuple):
    """One of those that are timed in turn.

    Attributes
    ----------
    call : callable
    rows : callable
        What a call tells, by what it returns: temperature, force and more, unit axis last.
    skin : Topology
    counts : ndarray, shape (c, n) or (t, c, n)
        The array that a call reads.
    decoder : Decoder or None
        That of the call, if it is one of ours.
    """

    call: Callable[[], Any]
    rows: Callable[[Any], np.ndarray]
    skin: Topology
    counts: np.ndarray
    decoder: Decoder | None = None

    def told(self) -> np.ndarray:
        """What a call tells."""
        return self.rows(self.call())

    @property
    def cycles(self) -> int:
        """Cycles of a call."""
        return self.counts.shape[0] if self.counts.ndim == 3 else 1

    @property
    def first(self) -> np.ndarray:
        """Counts of the first cycle, shape (c, n)."""
        return self.counts.reshape(self.cycles, *self.counts.shape[-2:])[0]


def sides_of(n: int) -> dict[str, Side]:
    """One cycle of n units, by all that decodes."""
    skins = {"per unit": array_of(n, alike=False), "alike": array_of(n, alike=True)}
    counts = {name: counts_of(skin) for name, skin in skins.items()}
    own, raw = skins["per unit"], counts["per unit"]
    paper = Paper(own)
    sides = {
        "numpy": Side(lambda: numpy_decode(own, raw), np.asarray, own, raw),
        "paper": Side(lambda: paper(raw), np.asarray, own, raw),
    }
    for dtype, estimator, kind in COMPARED:
        decoder = Decoder(skins[kind], NINE, estimator, dtype=dtype, sweeps=0, ambient=False)
        sides[f"{dtype} {estimator} {kind}"] = _bound(decoder, counts[kind])
    live = Decoder(skins["alike"], LIVE, "sine", consistency=False, sweeps=0, ambient=False)
    sides["live"] = _bound(live, counts["alike"])
    return sides | {"default": _bound(Decoder(own, LIVE, sweeps=0, ambient=False), raw)}


def calibrated_sides(n: int) -> dict[str, Side]:
    """Temperature and force of n units with a calibration each, in one thread."""
    skin = array_of(n, alike=False)
    counts = counts_of(skin)
    sides = {}
    if compiler() is not None:
        bare = Bare(skin)
        sides[BARE] = Side(bare.bind(counts), lambda _: bare.out, skin, counts)
    for estimator in ESTIMATORS:
        for name, options in (("", {"consistency": False}), (", consistency", {})):
            decoder = Decoder(skin, LIVE, estimator, sweeps=0, ambient=False, **options)
            sides[estimator + name] = _bound(decoder, counts)
    return sides


def recording_side(cycles: int) -> Side:
    """Many cycles of few units with a calibration each, by what a decoder does if not told
    otherwise, into new arrays."""
    skin = array_of(FEW, alike=False)
    counts = np.tile(counts_of(skin), (cycles, 1, 1))
    decoder = Decoder(skin, LIVE, sweeps=0, ambient=False)
    return Side(lambda: decoder(counts), _rows, skin, counts, decoder)


def _bound(decoder: Decoder, counts: np.ndarray) -> Side:
    """A cycle as a live bus decodes it, in arrays that stay the same."""
    here = zeros(counts.shape, np.int16)
    here[:] = counts
    inputs = decoder.inputs(here, zeros(counts.shape[1], np.uint16))

    def call() -> Reading:
        decoder.step(inputs)
        return decoder.reading

    return Side(call, _rows, decoder.topology, here, decoder)


def _rows(reading: Reading) -> np.ndarray:
    """A reading in the peers' rows, as many as are there."""
    rows = [reading.temperature, *np.moveaxis(reading.force, -2, 0)]
    if if_wanted(reading, "tangential") is not None:
        moved = np.moveaxis(reading.displacement_mm, -2, 0)
        rows += [reading.tangential, reading.theta, *moved]
    return np.stack(rows)
