"""Films that nobody simulated: an array whose stray fields are not those of the stencil.

Arrays of 6 x 6 units at 12 mm, each of films of one shape drawn from a family (radius, thickness,
wavelength, sectors, profile of the remanence), 5 % apart in strength, 0.2 mm and 2° off their
places; their fields are sums of dipoles, see `benchmarks/films_truth.py`. Each unit is calibrated
by itself, as `skin calibrate` does; 9 of an array are unlike (4 in a quick run). The decoder then
knows its units, and of its neighbours:

- `untared`: what theory says;
- `tared`: what an untouched skin reads in two seconds;
- `learned`: that, and what chips read while each unit in turn is pressed and sheared for
  `PRESS_S`, as `skin calibrate crosstalk` has it.

Scenes press and shear 60 % of the units, each for itself, through the whole range; every scene is
decoded for itself, in two sweeps. There is no ambient field and no drift.
"""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np

from benchmarks.accuracy_array import scenes
from benchmarks.accuracy_skin import apart, square, with_parameters
from benchmarks.films_truth import (
    BAG_SIDE,
    PITCH_M,
    PLACE_MM,
    QUICK_BAG_SIDE,
    TILT_DEG,
    Array,
    array_of,
)
from skin import Decoder
from skin.calibrate.crosstalk import StrayEstimate, TouchTest
from skin.calibrate.tare import tare
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from skin.sim.unit import UnitSimulator
from topology import Topology
from topology.model import UnitModel

SIDE, RATE_HZ = 6, 200.0
FIRST_SEED = 100
TARE_S, PRESS_S = 2.0, 0.9
UNITS_64 = 64
HELD = 2
"""Cycles for which a scene is held: a live skin begins with the displacements of the last cycle."""
WAYS = ("untared", "tared", "learned")


def run(quick: bool) -> dict[str, Any]:
    """Make, calibrate and decode every array; see `table` for what the figures are."""
    arrays, count = (2, 40) if quick else (6, 150)
    rows: dict[str, list[dict[str, float]]] = {way: [] for way in WAYS}
    films = []
    for seed in range(FIRST_SEED, FIRST_SEED + arrays):
        array = array_of(SIDE, seed, QUICK_BAG_SIDE if quick else BAG_SIDE)
        films.append({**dataclasses.asdict(array.shape), "stray_share": array.shape.stray_share})
        bound = _scored(array, array.known, None, count, alone=True)
        for way, (known, stencil) in _ways(array).items():
            row = _scored(array, known, stencil, count)
            row["noise_bound_ratio"] = row["force_mn"] / bound["force_mn"]
            row["systematic_alone_um"] = bound["systematic_um"]
            rows[way].append(row)
    return {
        "films": films,
        "readings": count * SIDE**2,
        **{way: _summary(each) for way, each in rows.items()},
        "seconds_to_learn": TARE_S + UNITS_64 * PRESS_S,
        "learning_s": _learning_s(),
    }


def _ways(array: Array) -> dict[str, tuple[Topology, Stencil | None]]:
    """What is known of the skin, and of its neighbours' fields, in each way."""
    n = array.known.n
    known = with_parameters(
        array.known, placement_sigma_mm=np.full(n, PLACE_MM),
        placement_sigma_rad=np.full(n, np.radians(TILT_DEG)),
        stray_sigma_relative=np.full(n, UnitModel().stray_sigma_relative),
    )  # fmt: skip
    cycles = round(TARE_S * RATE_HZ)
    still = np.zeros((cycles, 2, n)), np.zeros((cycles, n))
    untouched = array.counts(*still, seed=5)
    found = tare(known, untouched)
    estimate = StrayEstimate(known)
    tared = estimate.tared(found)
    zeros = found.leaving_out(tared.rest_ut).applied()
    test = TouchTest(zeros, estimate, tared, untouched)
    for unit in range(n):
        pressed = press(unit, n)
        test(array.counts(*pressed, seed=1000 + unit))
    learned = estimate.stencil()
    return {
        "untared": (dataclasses.replace(known, tared=np.zeros(n, bool)), None),
        "tared": (zeros, tared),
        "learned": (zeros, learned),
    }


def press(unit: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """A finger on one unit: down, round in circles, up.

    Returns
    -------
    displacement_mm : ndarray, shape (t, 2, n)
    depth_mm : ndarray, shape (t, n)
    """
    count = round(PRESS_S * RATE_HZ)
    share = (np.arange(count) + 0.5) / count
    displacement, depth = np.zeros((count, 2, n)), np.zeros((count, n))
    down = np.sin(np.pi * share) ** 0.3
    depth[:, unit] = 2.0 * down
    radius, around = 2.4 * down, 4.0 * np.pi * share
    displacement[:, :, unit] = (radius * np.stack([np.cos(around), np.sin(around)])).T
    return displacement, depth


def _scored(
    array: Array, known: Topology, stencil: Stencil | None, count: int, *, alone: bool = False
) -> dict[str, float]:
    """Errors and coverage in random scenes."""
    displacement, depth = scenes(count, known.n)
    force = array.force(displacement, depth)
    sweeps = 0 if alone else 2
    want = {"force", "displacement", "sigma"}
    decoder = Decoder(
        apart(known) if alone else known, want, "field-angle", sweeps=sweeps, stencil=stencil,
        ambient=False,
    )  # fmt: skip
    out = {}
    for name, seed in (("systematic_um", None), ("noisy", 3)):
        counts = array.counts(displacement, depth, seed=seed, alone=alone)
        off, error, sigma = (np.empty_like(displacement) for _ in range(3))
        for i in range(count):
            decoder.reset()
            for _ in range(HELD):
                reading = decoder(counts[i])
            off[i] = reading.displacement_mm[:2] - displacement[i]
            error[i], sigma[i] = reading.force[:2] - force[i], reading.force_sigma[:2]
        if seed is None:
            out[name] = 1e3 * float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
            continue
        pressed = np.repeat((depth > 0.0)[:, np.newaxis], 2, axis=1)
        held = np.abs(error) <= sigma
        out["coverage"], out["coverage_pressed"] = float(held.mean()), float(held[pressed].mean())
        out["force_mn"] = 1e3 * float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
    return out


def _summary(rows: list[dict[str, float]]) -> dict[str, Any]:
    """Least and largest coverage over films, and means over films with their 95 % intervals."""
    held = [row["coverage"] for row in rows]
    out: dict[str, Any] = {"coverage_min": min(held), "coverage_max": max(held), "each": rows}
    for name in ("coverage", "systematic_um", "systematic_alone_um", "force_mn",
                 "noise_bound_ratio"):  # fmt: skip
        values = np.array([row[name] for row in rows])
        spread = 1.96 * values.std(ddof=1) / np.sqrt(values.size)
        out[name if name != "coverage" else "coverage_mean"] = float(values.mean())
        out[f"{name}_interval"] = float(spread)
    return out


def _learning_s() -> float:
    """What the computer needs for one press on a skin of 64 units, seconds."""
    side = round(np.sqrt(UNITS_64))
    skin = square(side, PITCH_M)
    estimate = StrayEstimate(skin)
    test = TouchTest(skin, estimate, estimate.theory)
    displacement, depth = press(UNITS_64 // 2, UNITS_64)
    units = UnitSimulator(skin, field=HalbachField(skin))
    values = units.quantities(depth, displacement, np.full(depth.shape, 25.0))
    counts = units.quantise(units.disturb(values))
    test(counts)  # the kernels are compiled by now
    began = time.perf_counter()
    test(counts)
    return time.perf_counter() - began


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [f"{'':<9}{'coverage of 68 %':>20}{'systematic':>18}{'force':>10}{'over noise':>16}"]
    for way in WAYS:
        row = figures[way]
        lines.append(
            f"{way:<9}{row['coverage_min']:>12.3f}-{row['coverage_max']:.3f}"
            f"{row['systematic_um']:>9.1f} ± {row['systematic_um_interval']:<3.1f}µm"
            f"{row['force_mn']:>7.1f} mN{row['noise_bound_ratio']:>9.3f} ± "
            f"{row['noise_bound_ratio_interval']:.3f}"
        )
    alone = figures["learned"]["systematic_alone_um"]
    lines.append(f"means over {len(figures['films'])} arrays ± 95 %; each unit alone: {alone:.1f} "
                 f"µm; a scene: {figures['readings']} readings")  # fmt: skip
    lines.append(f"64 units: {figures['seconds_to_learn']:.0f} s of pressing at {RATE_HZ:g} Hz, "
                 f"and {figures['learning_s']:.2f} s of computing a press")  # fmt: skip
    return "\n".join(lines)
