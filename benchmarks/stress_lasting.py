"""Numerical stress by what lasts or is large, in float32 and in float64."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from fractions import Fraction

import numpy as np

import topology
from benchmarks.peers_decode import array_of, counts_of
from benchmarks.stress_oracle import walk
from bus.cycle import ClosedBy, RawCycle
from skin.contact.stream import ContactStream
from skin.decode.crosstalk import CrossTalk
from skin.decode.decoder import Decoder
from skin.errors import SkinError
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
FAR_M = 100.0
SIZES = (1, 2, 15, 16, 17, 127, 128, 129, 1000, 4096, 65536)
PITCHES_MM = (12.0, 9.0, 8.0, 7.5, 7.0, 6.75, 6.5, 6.25, 6.0, 5.75, 5.5)
POSITIVE = ("lag_variance", "anchor_variance", "gain_information")
"""Of what slip keeps of each unit: 0 before its first contact, above it ever after."""


def dense(quick: bool) -> dict:
    """Two sweeps of cross-talk at the least pitch that is accepted.

    float32 against float64.
    """
    palm, densest = topology.load("palm").exact(), None
    for pitch_mm in PITCHES_MM:
        tried = dataclasses.replace(palm, position=palm.position * (pitch_mm / 12.0))
        try:
            crosstalk = CrossTalk(tried, dtype="float64")
        except SkinError:
            break
        densest = tried, pitch_mm, crosstalk.contraction
    assert densest is not None
    skin, pitch_mm, contraction = densest
    forces = {}
    for dtype in DTYPES:
        decoder = Decoder(skin, {"force"}, dtype=dtype, sweeps=2, consistency=False, ambient=False)
        forces[dtype] = np.stack(
            [decoder(counts_of(skin, most=0.5, seed=i)).force for i in range(4 if quick else 40)]
        ).astype(np.float64)
    return {
        "error_n_float32": float(np.abs(forces["float32"] - forces["float64"]).max()),
        "nonfinite": int((~np.isfinite(forces["float32"])).sum()),
        "seen": f"pitch {pitch_mm:g} mm, a sweep leaves {contraction:.2f} of the one before",
    }


def lags(quick: bool) -> dict:
    """Film temperatures after many cycles, by the force that `sine` decodes with them."""
    cycles = CYCLES[quick] // LAP * LAP
    skin = array_of(16, alike=False)
    lap = np.stack([counts_of(skin, most=0.7, seed=1)] * LAP)
    turn = np.sin(2.0 * np.pi * np.arange(LAP) / LAP)[:, np.newaxis]
    lap[:, 0] = np.rint(lap[0, 0] * (1.0 + 0.3 * turn))
    exact = walk(skin, lap[-1], np.arange(skin.n), "sine", film_c=_film_c(skin, lap, cycles))
    row: dict = {"nonfinite": 0, "seen": f"{cycles} cycles"}
    for dtype in DTYPES:
        decoder = Decoder(
            skin, {"force"}, "sine", dtype, consistency=False, sweeps=0, ambient=False
        )
        for _ in range(cycles // LAP):
            force = decoder(lap).force
        row[f"error_n_{dtype}"] = float(np.abs(force[-1] - exact).max())
        row["nonfinite"] += int((~np.isfinite(force)).sum())
    return row


def _film_c(skin: Topology, lap: np.ndarray, cycles: int) -> np.ndarray:
    """Film temperatures after laps, by their recursion in long doubles."""
    p = {name: values.astype(np.longdouble) for name, values in skin.parameters.items()}
    current = skin.scale[0].astype(np.longdouble) * lap[:, 0] + skin.offset[0]
    gel_c = 20 + 60 * np.log(current / p["gel_current_20c_ua"]) / np.log(p["gel_current_ratio"])
    keep = np.exp(-1 / (np.longdouble(skin.cycle_rate_hz) * p["film_lag_s"]))
    # a lap is an affine map of the film's temperature; the first cycle finds it as warm as the gel
    added = np.zeros(skin.n, np.longdouble)
    for t in range(LAP):
        added = gel_c[t] + keep * (added - gel_c[t])
    film_c = gel_c[0]
    for _ in range(cycles // LAP):
        film_c = added + keep**LAP * film_c
    return film_c


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


def far(quick: bool) -> dict:
    """Wrenches about an origin `FAR_M` away, moments over that arm, against fractions."""
    palm = topology.load("palm").exact()
    position = palm.position + np.array([[FAR_M], [0.0], [0.0]])
    counts = counts_of(palm)
    row: dict = {"nonfinite": 0, "seen": f"{palm.n} units, {FAR_M:g} m from the origin"}
    for dtype in DTYPES:
        reading = Decoder(
            palm, {"force", "sigma"}, dtype=dtype, consistency=False, sweeps=0, ambient=False
        )(counts)
        stream = ContactStream(
            position, palm.rotation, palm.area, palm.neighbour_start, palm.neighbour_index,
            want=("wrench",), dtype=dtype,
        )  # fmt: skip
        for cycle in range(3):
            stream.update(reading.force, reading.force_sigma, stamp_ns=4_000_000 * (cycle + 1))
        touched = stream.label >= 0
        exact = _wrench(reading.force[:, touched], position[:, touched],
                        palm.rotation[:, :, touched])  # fmt: skip
        off = np.abs(stream.total.wrench - exact) / ([1.0] * 3 + [FAR_M] * 3)
        row[f"error_n_{dtype}"] = float(off.max())
        row["nonfinite"] += int((~np.isfinite(stream.total.wrench)).sum())
    return row


def _wrench(force: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """The sum of forces and of their moments, without rounding until the end."""
    total = [Fraction(0)] * 6
    for i in range(force.shape[1]):
        f = [Fraction(float(v)) for v in force[:, i]]
        p = [Fraction(float(v)) for v in position[:, i]]
        turned = [
            sum((Fraction(float(rotation[a, b, i])) * f[b] for b in range(3)), Fraction(0))
            for a in range(3)
        ]
        moment = [p[a - 2] * turned[a - 1] - p[a - 1] * turned[a - 2] for a in range(3)]
        total = [a + b for a, b in zip(total, (*turned, *moment), strict=True)]
    return np.array([float(v) for v in total])


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
        exact = walk(skin, counts[:, some], some, "field-angle")
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
    "cross-talk, as dense as is accepted": dense,
    "lag of the film's temperature": lags,
    "ambient field, zeros and slip": filters,
    "wrench about an origin 100 m away": far,
    "arrays of every size": sizes,
}
