"""Run time against error: estimator x type x sweeps x skipping, on a skin touched in places.

A square of 30 x 30 units at 12 mm, tiles of 36, of which 16 were on the bench (4 in a quick run),
is pressed in a few round patches whose depth falls to their rims, and each is sheared its own way;
the patches wander. The skin is tared. The error is that of the tangential displacement of the
pressed units without noise: what the choices leave. Times are the processor's, medians of rounds in
which the choices take turns. The front are the choices than which none is faster and as good."""

from __future__ import annotations

import dataclasses
import time
from itertools import product
from typing import Any

import numpy as np

from benchmarks.accuracy_array import EVERYWHERE_M, ROOM_C
from benchmarks.made import BAG_SIDE, QUICK_BAG_SIDE, Made, made
from skin import Decoder
from skin.physics.stencil import Stencil

SIDE, TILES = 6, 5
PATCHES, RADIUS_UNITS = 4, 3.0
CHOICES = tuple(product(("field-angle", "sine"), ("float32", "float64"), (0, 1, 2), (False, True)))
ALIKE = 1.01
"""Errors within this factor are no better than each other."""


def run(quick: bool) -> dict[str, Any]:
    """Measure; see `table` for what the figures are."""
    bag_side = QUICK_BAG_SIDE if quick else BAG_SIDE
    skin = made(SIDE, fabricated=False, bag_side=bag_side).tiled(TILES, 0.012)
    cycles, rounds = (4, 5) if quick else (12, 25)
    displacement, depth = touches(cycles, skin.true.n)
    room = np.full(depth.shape, ROOM_C)
    units = skin.simulator(skin.field(reach_m=EVERYWHERE_M))
    counts = units.quantise(units.quantities(depth, displacement, room))
    stencil = dataclasses.replace(Stencil.of(skin.known), rest_ut=_at_rest(skin))
    want = {"temperature", "force", "displacement"}
    decoders = [
        Decoder(skin.known, want, estimator, dtype, skip=skip, sweeps=sweeps,
                stencil=stencil, ambient=False)
        for estimator, dtype, sweeps, skip in CHOICES
    ]  # fmt: skip
    errors = [_error_um(decoder, counts, displacement, depth) for decoder in decoders]
    seconds = np.empty((rounds, len(CHOICES)))
    for row in seconds:
        for i, decoder in enumerate(decoders):
            start = time.thread_time()
            for raw in counts:
                decoder(raw)
            row[i] = (time.thread_time() - start) / cycles
    micros = 1e6 * np.median(seconds, axis=0)
    points = [
        {"estimator": estimator, "dtype": dtype, "sweeps": sweeps, "skip": skip,
         "us_per_cycle": float(us), "um_rms": error, "front": _leads(us, error, micros, errors)}
        for (estimator, dtype, sweeps, skip), us, error in zip(CHOICES, micros, errors, strict=True)
    ]  # fmt: skip
    return {
        "units": skin.true.n,
        "pressed_share": float((depth > 0.0).mean()),
        "points": points,
    }


def table(figures: dict[str, Any]) -> str:
    """The choices, fastest first."""
    lines = [f"{'estimator':<14}{'type':<10}{'sweeps':>7}{'skip':>6}{'µs/cycle':>10}{'ns/unit':>9}"
             f"{'µm rms':>9}"]  # fmt: skip
    for point in sorted(figures["points"], key=lambda point: point["us_per_cycle"]):
        each = 1e3 * point["us_per_cycle"] / figures["units"]
        lines.append(
            f"{point['estimator']:<14}{point['dtype']:<10}{point['sweeps']:>7}"
            f"{'yes' if point['skip'] else 'no':>6}{point['us_per_cycle']:>10.1f}{each:>9.1f}"
            f"{point['um_rms']:>9.1f}{'  front' if point['front'] else ''}"
        )
    lines.append(f"{figures['units']} units, {figures['pressed_share']:.0%} pressed")
    return "\n".join(lines)


def touches(cycles: int, n: int, seed: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Round patches that wander over a square of n units.

    Returns
    -------
    displacement_mm : ndarray, shape (cycles, 2, n)
    depth_mm : ndarray, shape (cycles, n)
    """
    side = round(np.sqrt(n))
    rng = np.random.default_rng(seed)
    place = np.stack(np.meshgrid(np.arange(side), np.arange(side))).reshape(2, 1, n)
    start = rng.uniform(RADIUS_UNITS, side - RADIUS_UNITS, (2, PATCHES, 1))
    way = rng.uniform(-0.1, 0.1, (2, PATCHES, 1))
    around = rng.uniform(-np.pi, np.pi, PATCHES)
    shear = 2.0 * rng.random(PATCHES) * np.stack([np.cos(around), np.sin(around)])
    depth, displacement = np.empty((cycles, n)), np.empty((cycles, 2, n))
    for t in range(cycles):
        away = np.hypot(*(place - start - t * way)) / RADIUS_UNITS
        each = 2.0 * np.maximum(1.0 - away**2, 0.0)
        hardest = each.argmax(axis=0)
        depth[t] = each.max(axis=0)
        displacement[t] = shear[:, hardest] * (depth[t] > 0.0)
    return displacement, depth


def _at_rest(skin: Made) -> np.ndarray:
    """What all films add at rest to each unit's own, µT, shape (3, n): what a tare finds."""
    n = skin.true.n
    still = np.zeros((2, n)), np.zeros(n), np.full(n, ROOM_C)
    return skin.field(reach_m=EVERYWHERE_M)(*still) - skin.field()(*still)


def _error_um(
    decoder: Decoder, counts: np.ndarray, displacement: np.ndarray, depth: np.ndarray
) -> float:
    """Of the tangential displacement of pressed units, root mean square, as a stream is decoded."""
    decoder.reset()
    off = []
    # the first cycle is given twice: a stream has one before it
    decoder(counts[0])
    for raw, true, pressed in zip(counts, displacement, depth > 0.1, strict=True):
        read = decoder(raw).displacement_mm[:2]
        off.append(np.hypot(*(read - true))[pressed])
    return 1e3 * float(np.sqrt(np.mean(np.concatenate(off) ** 2)))


def _leads(us: float, error: float, micros: np.ndarray, errors: list[float]) -> bool:
    return not any(
        other_us < us and other < ALIKE * error
        for other_us, other in zip(micros, errors, strict=True)
    )
