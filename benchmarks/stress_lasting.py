"""Numerical stress by what lasts or is large, in float32 and in float64."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

import topology
from benchmarks.arrays import array_of, counts_of
from benchmarks.oracle import walk
from bus.cycle import ClosedBy, RawCycle
from skin.decode.decoder import Decoder
from skin.options import DTYPES, Options
from skin.physics.elastic import Elastic
from skin.physics.halbach import FELT_M, HalbachField
from skin.pipeline import Pipeline
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from skin.state import Reading
from topology import Topology

CYCLES = {True: 20_000, False: 1_000_000}
"""Of every filter, quick and in full."""
LAP = 500
"""Cycles that are fed over and over."""
LOOK = 1000
"""Cycles from one look at covariances to the next."""
SIZES = (1, 2, 15, 16, 17, 127, 128, 129, 1000, 4096, 65536)
POSITIVE = ("lag_variance", "anchor_variance", "gain_information")
"""Of what slip keeps of each unit: 0 before its first contact, above it ever after."""


def filters(quick: bool) -> dict:
    """The whole pass, filters of ambient field, zeros and slip included, for many cycles.

    float32 against float64, where both are valid; covariances must stay symmetric and positive.
    """
    skin = topology.load("fingertip").exact()
    lap = _played(skin)
    pipelines = {dtype: Pipeline(skin, Options(dtype=dtype)) for dtype in DTYPES}
    period_ns = round(1e9 / skin.cycle_rate_hz)
    status, none = np.zeros(skin.n, np.uint16), np.zeros(skin.n, int)
    touched = {dtype: np.zeros(skin.n, bool) for dtype in DTYPES}
    furthest = nonfinite = broken = differ = 0
    for number in range(CYCLES[quick]):
        units = {}
        for dtype, pipeline in pipelines.items():
            pipeline.counts[:], pipeline.status[:] = lap[number % LAP], 0
            state = pipeline.state(RawCycle(
                number, (number + 1) * period_ns, ClosedBy.COMPLETE, lap[number % LAP],
                status == 0, status, none, none, none,
            ))  # fmt: skip
            units[dtype] = state.units
            touched[dtype] |= _touched(pipeline)
            if number % LOOK == LOOK - 1:
                broken += _broken(pipeline, touched[dtype])
                nonfinite += int((~np.isfinite(state.units.force[:, state.units.valid])).sum())
        if number % LOOK > LOOK - 20:
            off_n, apart = _apart(units["float32"], units["float64"])
            furthest, differ = max(furthest, off_n), differ + apart
    return {
        "error_n_float32": furthest,
        "nonfinite": nonfinite,
        "broken_covariances": broken,
        "differ_valid": differ,
        "seen": f"{CYCLES[quick]} cycles, {touched['float32'].sum()} of {skin.n} units touched",
    }


def _apart(one: Reading, other: Reading) -> tuple[float, int]:
    """Largest difference of forces that are valid in both, and units valid in one alone."""
    both = one.valid & other.valid
    off_n = np.abs(one.force - other.force)[:, both]
    return float(np.fmax.reduce(off_n, axis=None, initial=0.0)), int(
        (one.valid ^ other.valid).sum()
    )


def _touched(pipeline: Pipeline) -> np.ndarray:
    """Units that are in a contact, shape (n,)."""
    assert pipeline.contacts is not None
    return pipeline.contacts.label >= 0


def _played(skin: Topology) -> np.ndarray:
    """A touch that presses, drags, slips back and lifts within a lap; shape (LAP, c, n)."""
    simulator = UnitSimulator(skin, seed=1, field=HalbachField(skin, reach_m=FELT_M))
    law, rest = Elastic(skin), LAP // 4
    truths = []
    for t in range(LAP):
        truth = Truth.at_rest(skin.n, 25.0)
        turn = max(0, t - rest) * 2.0 * np.pi / (LAP - rest)
        truth.depth_mm[: skin.n // 2] = 0.5 * (1.0 - np.cos(turn))
        truth.contact[:] = truth.depth_mm > 0.0
        truth.displacement_mm[0] = 0.4 * (turn / np.pi % 1.0) * truth.depth_mm
        truth.force[2] = law.normal(truth.depth_mm)
        truths.append(truth)
    return simulator.counts(Truth.stack(truths))


def _broken(pipeline: Pipeline, touched: np.ndarray) -> int:
    """Covariances that are not symmetric, not positive or not finite; those of slip where units
    have been touched."""
    stream, ambient = pipeline.contacts, pipeline.decoder.ambient
    assert stream is not None
    assert ambient is not None
    count = 0
    for covariance in ambient.covariance_ut2:
        symmetric = np.allclose(covariance, covariance.T, rtol=1e-9, atol=1e-9)
        count += not (symmetric and np.linalg.eigvalsh(covariance).min() > 0.0)
    for name in POSITIVE:
        values = stream.data.slips[name]
        count += int((~(np.isfinite(values) & ((values > 0.0) | ~touched & (values == 0.0)))).sum())
    return count


def sizes(quick: bool) -> dict:
    """The same units in arrays of 1 to 65 536: as they are in the largest, to the bit."""
    most = SIZES[-1 - 2 * quick]
    skin = array_of(most, alike=False)
    counts = counts_of(skin)
    row: dict = {"nonfinite": 0}
    differ = 0
    for dtype in DTYPES:
        whole = Decoder(skin, {"force"}, dtype=dtype, consistency=False, sweeps=0, ambient=False)(
            counts
        ).force.copy()
        some = np.unique(np.linspace(0, most - 1, min(most, 2000)).astype(int))
        exact = walk(skin, counts[:, some], some, "field-angle")[:3]
        row[f"error_n_{dtype}"] = float(np.abs(whole[:, some] - exact).max())
        row["nonfinite"] += int((~np.isfinite(whole)).sum())
        for n in SIZES:
            if n < most:
                part = _first(skin, n)
                told = Decoder(
                    part, {"force"}, dtype=dtype, consistency=False, sweeps=0, ambient=False
                )(np.ascontiguousarray(counts[:, :n]))
                differ += int((told.force != whole[:, :n]).sum())
    return row | {"seen": f"1 to {most} units", "differ_by_size": differ}


def _first(skin: Topology, n: int) -> Topology:
    """The first n units of an array."""
    part = array_of(n, alike=True)
    parameters = {name: values[..., :n] for name, values in skin.parameters.items()}
    return dataclasses.replace(part, parameters=parameters)


LASTING: dict[str, Callable[[bool], dict]] = {
    "ambient field, zeros and slip": filters,
    "arrays of every size": sizes,
}
