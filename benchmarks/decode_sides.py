"""What the benchmark of decoding times: the very calls, with what they read, tell and move.

A copy stands beside each decoder. It moves as many bytes as the decoder reads and writes, in as
many threads: counts and flags of the bus, results, and of calibration and memory all that the
kernel's own Python touches on these counts. A recording finds calibration and memory in the cache
from its second cycle on, so they count once.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from benchmarks.peers_bare import Bare, compiler
from benchmarks.peers_decode import Paper, array_of, counts_of, numpy_decode
from bus.compiled.aligned import zeros
from skin.decode import kernel, sharing
from skin.decode.decoder import Decoder
from skin.decode.parts import Parts
from skin.decode.records import LANES
from skin.options import ESTIMATORS
from skin.state import Reading, if_wanted
from topology import Topology

__all__ = [
    "BARE", "FEW", "LIVE", "NINE", "Side", "calibrated_sides", "recording_side",
    "sides_of", "touched", "with_copies",
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

    @property
    def threads(self) -> int:
        """Among which a call shares its work."""
        if self.decoder is None:
            return 1
        shares = self.decoder._shares
        return len(shares.scratch[shares.of(self.cycles)])

    @property
    def moved(self) -> int:
        """Bytes that a call of a decoder must read and write."""
        assert self.decoder is not None
        n, out = self.skin.n, self.decoder._out
        cycle = self.counts.nbytes // self.cycles + n * out.flags.itemsize
        return self.cycles * (cycle + sum(array.nbytes for array in out.arrays)) + self._kept()

    def _kept(self) -> int:
        """Bytes of calibration and memory that a cycle reads and writes."""
        assert self.decoder is not None
        n, model = self.skin.n, self.decoder._model
        blocks = n / min(n, LANES)
        bytes_of = {
            name: sum(sizes.values()) for name, sizes in touched(self.decoder, self.first).items()
        }
        for name in ("coefficients", "limits"):
            bytes_of[name] *= blocks if getattr(model, name).size > 1 else 1
        return round(sum(bytes_of.values()) + (blocks - 1) * bytes_of["state"])


class Watched:
    """Records that write down each number that is read or written, with its size."""

    def __init__(self, records: Any, touched: dict[tuple, int], path: tuple = ()) -> None:
        self._records, self._touched, self._path = records, touched, path

    def __getattr__(self, name: str) -> Any:
        return getattr(self._records, name)

    def __getitem__(self, key: Any) -> Any:
        found, path = self._records[key], (*self._path, key)
        if isinstance(found, np.ndarray | np.void):
            return Watched(found, self._touched, path)
        self._touched["read", *path] = found.itemsize
        return found

    def __setitem__(self, key: Any, value: Any) -> None:
        self._records[key] = value
        self._touched["written", *self._path, key] = self._records.itemsize


def touched(decoder: Decoder, counts: np.ndarray) -> dict[str, dict[tuple, int]]:
    """Numbers of calibration and memory, with their sizes, that the kernel's own Python reads and
    writes in the first block of a cycle; the decoder is reset."""
    status = np.zeros((1, counts.shape[1]), np.uint16)
    (data, *_) = decoder._data(slice(1), counts[np.newaxis], status, None, decoder._out)
    control = data.control.copy()
    control["first"], control["last"] = 0, 1
    found: dict[str, dict] = {"coefficients": {}, "limits": {}, "state": {}}
    model = decoder._model
    kernel.decode_python(Parts.of(decoder.plan, LANES))(
        model._replace(
            coefficients=Watched(model.coefficients, found["coefficients"]),
            limits=Watched(model.limits, found["limits"]),
        ),
        data._replace(state=Watched(data.state, found["state"]), control=control),
    )
    decoder.reset()
    return found


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
        decoder = Decoder(
            skins[kind], NINE, estimator, dtype=dtype, workers=1, sweeps=0, ambient=False
        )
        sides[f"{dtype} {estimator} {kind}"] = _bound(decoder, counts[kind])
    for name, workers in (("live", 1), ("shared", None)):
        decoder = Decoder(
            skins["alike"],
            LIVE,
            "sine",
            consistency=False,
            workers=workers,
            sweeps=0,
            ambient=False,
        )
        sides[name] = _bound(decoder, counts["alike"])
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
        for name, options in (("", {"consistency": False}), (", consistency", {}),
                              (", every 8th temperature", {"consistency": False,
                                                           "temperature_every": 8})):  # fmt: skip
            decoder = Decoder(skin, LIVE, estimator, workers=1, sweeps=0, ambient=False, **options)
            sides[estimator + name] = _bound(decoder, counts)
    return sides


def recording_side(cycles: int) -> Side:
    """Many cycles of few units with a calibration each, by what a decoder does if not told
    otherwise, into new arrays; the copy makes a new array, too."""
    skin = array_of(FEW, alike=False)
    counts = np.tile(counts_of(skin), (cycles, 1, 1))
    decoder = Decoder(skin, LIVE, sweeps=0, ambient=False)
    return Side(lambda: decoder(counts), _rows, skin, counts, decoder)


def with_copies(sides: Mapping[str, Side]) -> dict[str, Callable[[], Any]]:
    """All calls, and a copy for each of those that decoders make."""
    calls = {name: side.call for name, side in sides.items()}
    moved = {name: side.moved for name, side in sides.items() if side.decoder is not None}
    source, target = np.ones((2, max(moved.values()) // 2), np.uint8)
    for name, size in moved.items():
        calls[f"copy for {name}"] = _copy(sides[name], source[: size // 2], target[: size // 2])
    return calls


def _copy(side: Side, source: np.ndarray, kept: np.ndarray) -> Callable[[], None]:
    """A copy in as many threads as a side has; into a new array each time if it decodes a
    recording, as that does, else into one that stays."""
    new = side.counts.ndim == 3
    cuts = np.arange(side.threads + 1) * source.size // side.threads
    parts = [slice(*ends) for ends in itertools.pairwise(cuts.tolist())]

    def copy() -> None:
        target = np.empty_like(source) if new else kept
        if len(parts) == 1:
            np.copyto(target, source)
        else:
            sharing.together(
                [functools.partial(np.copyto, target[part], source[part]) for part in parts]
            )

    return copy


def _bound(decoder: Decoder, counts: np.ndarray) -> Side:
    """A cycle as a live bus decodes it, in arrays that stay the same."""
    here = zeros(counts.shape, np.int16)
    here[:] = counts
    call = decoder.bind(here, zeros(counts.shape[1], np.uint16))
    return Side(call, _rows, decoder.topology, here, decoder)


def _rows(reading: Reading) -> np.ndarray:
    """A reading in the peers' rows, as many as are there."""
    rows = [reading.temperature, *np.moveaxis(reading.force, -2, 0)]
    if if_wanted(reading, "tangential") is not None:
        moved = np.moveaxis(reading.displacement_mm, -2, 0)
        rows += [reading.tangential, reading.theta, *moved]
    return np.stack(rows)
