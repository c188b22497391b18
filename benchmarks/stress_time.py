"""The time of a cycle under numerical stress over that of a calm one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.contact import plate
from benchmarks.peers_decode import counts_of
from benchmarks.skip import cycles_of
from benchmarks.timing import ratio, times
from skin.decode.decoder import Decoder
from skin.options import DTYPES
from topology import Topology

UNITS = 1024
CYCLES = 16
AGES = {"float32": 95.0, "float64": 725.0}
"""Time constants after which a lag of some kelvin is denormal."""


def slowdowns(quick: bool) -> dict[str, tuple[float, float, float]]:
    """Ratio of every kind of stress, by type, and the ends of its 95 % interval; decoders of one
    plan, by turns in one process."""
    skin, target_s = plate(UNITS), 0.05 if quick else 0.5
    ratios = {}
    for dtype in DTYPES:
        runs = cases(skin, dtype)
        seconds = times(runs, target_s)
        calm = seconds.pop("calm")
        ratios |= {f"{name}, {dtype}": ratio(s, calm) for name, s in seconds.items()}
    return ratios


def cases(skin: Topology, dtype: str) -> dict[str, Callable[[], None]]:
    """A call for each kind of stress that decodes `CYCLES` cycles; "calm" is none."""
    rng = np.random.default_rng(1)
    calm = np.stack([counts_of(skin, seed=seed) for seed in range(CYCLES)])
    whole = rng.integers(-32768, 32768, calm.shape).astype(np.int16)
    nothing = calm.copy()
    nothing[:, 2:5] = rng.integers(-1, 2, nothing[:, 2:5].shape)
    crest = calm.copy()
    crest[:, 2:4] = np.clip(2.0 * crest[:, 2:4], -32768, 32767)
    rails = np.where(rng.random(calm.shape) < 0.5, np.int16(-32768), calm)
    still = np.broadcast_to(calm[:1], calm.shape)
    runs = {
        name: cycles_of(Decoder(skin, dtype=dtype, sweeps=0, ambient=False), counts)
        for name, counts in (("calm", calm), ("any counts", whole), ("no field", nothing),
                             ("beyond the crest", crest), ("rails", rails))
    }  # fmt: skip
    return runs | {"denormal lags": cycles_of(aged(skin, dtype, calm), still)}


def aged(skin: Topology, dtype: str, counts: np.ndarray) -> Decoder:
    """A decoder whose lags behind the gel have shrunk to denormal numbers."""
    decoder = Decoder(skin, dtype=dtype, sweeps=0, ambient=False)
    decoder(counts[1])
    decoder(counts[0])
    longest_s = float(skin.parameters["film_lag_s"].max())
    decoder(counts[0], elapsed_s=AGES[dtype] * longest_s)
    return decoder
