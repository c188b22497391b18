"""Laws that are not the decoder's: errors and coverage after its own calibration.

The simulator's laws of gel, capacitor and force are those that the decoder inverts; only the field
comes from magnet theory. Here they are others, each alone and all together: the gel's current by
Vogel, Fulcher and Tammann; a capacitance beside the unit's own; forces of a hyperelastic solid
(Yeoh) under the indentation of a thin layer (Dimitriadis), from a table. The units, 16 and 4 in a
quick run, are recorded on a bench and calibrated as `skin calibrate` does (`benchmarks.bench`);
films are as drawn.

``lag``: a unit that is pressed and sheared warms by a step, gel and film along stretched
exponentials of the mean delay that the decoder believes of a first-order lag.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.accuracy_skin import Made, apart, differing, square, with_parameters, with_rate
from benchmarks.bench import Bench
from benchmarks.foreign_laws import STRETCH, ForeignUnit, Hyperelastic, relaxed
from skin import Decoder
from skin.physics.elastic import Elastic
from skin.physics.fabrication import Fabrication
from topology import Topology

SIDE, QUICK_SIDE = 4, 2
CASES = {
    "the decoder's own": frozenset[str](),
    "gel": frozenset({"gel"}),
    "capacitor": frozenset({"capacitor"}),
    "force": frozenset({"force"}),
    "all three": frozenset({"gel", "capacitor", "force"}),
}
ESTIMATORS = ("field-angle", "sine")
REACH_MM, DEPTH_MM = {"field-angle": 2.5, "sine": 1.5}, 2.0
WARM_C = (20.0, 80.0)
PARTS = {"dx, dy": slice(0, 2), "H": slice(2, 3), "Fx, Fy": slice(3, 5), "Fz": slice(5, 6),
         "T": slice(6, 7)}  # fmt: skip
STEP_C, GEL_LAG_S, LAG_SECONDS, LAG_RATE_HZ = 35.0, 4.0, 60.0, 20.0


def run(quick: bool) -> dict[str, Any]:
    """Calibrate and decode each case; see `table` for what the figures are."""
    times = 100 if quick else 1000
    nominal = square(QUICK_SIDE if quick else SIDE, 0.012)
    true = differing(nominal, seed=21)
    cases, known = {}, {}
    for name, laws in CASES.items():
        known[name] = on_the_bench(nominal, true, laws)
        cases[name] = {
            estimator: _poses(true, known[name], laws, estimator, times) for estimator in ESTIMATORS
        }
    own = known["the decoder's own"]
    return {
        "readings": times * nominal.n,
        "cases": cases,
        "lag": {
            name: {e: _lag(true, own, stretch, e) for e in ESTIMATORS}
            for name, stretch in (("first order", 1.0), (f"stretched, {STRETCH:g}", STRETCH))
        },
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    columns = "".join(f"{part + ' ' + unit:>18}" for part, unit in
                      zip(PARTS, ("µm", "µm", "mN", "mN", "°C"), strict=True))  # fmt: skip
    rows = [f"{'laws, estimator':<32}{columns}"]
    for name, estimators in figures["cases"].items():
        for estimator, row in estimators.items():
            each = "".join(f"{row['rms'][part]:>10.3g} ({row['held'][part]:.2f})" for part in PARTS)
            rows.append(f"{name + ', ' + estimator:<32}{each}")
    rows.append("root mean square (share within one sigma), over H to 2 mm, R to "
                + ", ".join(f"{mm:g} mm ({e})" for e, mm in REACH_MM.items())
                + f", 20 to 80 °C; {figures['readings']} readings")  # fmt: skip
    for name, estimators in figures["lag"].items():
        for estimator, row in estimators.items():
            rows.append(f"{'lag, ' + name + ', ' + estimator:<40}{row['force_mn_rms']:>8.1f} mN"
                        f"{row['um_rms']:>8.1f} µm over {LAG_SECONDS:g} s")  # fmt: skip
    return "\n".join(rows)


def on_the_bench(nominal: Topology, true: Topology, laws: frozenset[str]) -> Topology:
    """What the product's calibration finds of units that have other laws."""
    springs = Hyperelastic(true) if "force" in laws else Elastic(true)
    bench = Bench(nominal, lambda: ForeignUnit(true, laws, seed=31), springs, seed=31)
    return bench.calibrated()


def _poses(
    true: Topology, known: Topology, laws: frozenset[str], estimator: str, times: int
) -> dict[str, dict[str, float]]:
    """Errors and coverage of single readings, poses and temperatures at random."""
    rng, shape = np.random.default_rng(41), (times, true.n)
    depth, warm = rng.uniform(0.0, DEPTH_MM, shape), rng.uniform(*WARM_C, shape)
    reach = REACH_MM[estimator] * np.sqrt(rng.random(shape))
    around = rng.uniform(-np.pi, np.pi, shape)
    along = np.stack([np.cos(around), np.sin(around)], axis=1)
    place = reach[:, np.newaxis] * along
    units = ForeignUnit(true, laws, seed=42)
    counts = units.quantise(units.disturb(units.quantities(depth, place, warm)))
    # each reading by itself: the film is as warm as its gel
    still = with_parameters(known, film_lag_s=np.zeros(true.n))
    reading = Decoder(apart(still), None, estimator, sweeps=0, ambient=False)(counts)
    solid = Hyperelastic(true) if "force" in laws else Elastic(true)
    shear = solid.tangential(reach, depth)[:, np.newaxis] * along
    exact = (place, depth[:, np.newaxis], shear, solid.normal(depth)[:, np.newaxis])
    value = (reading.displacement_mm, reading.force, reading.temperature[:, np.newaxis])
    sigma = (reading.displacement_sigma_mm, reading.force_sigma,
             reading.temperature_sigma[:, np.newaxis])  # fmt: skip
    error = np.concatenate(value, axis=1) - np.concatenate([*exact, warm[:, np.newaxis]], axis=1)
    within = np.abs(error) <= np.concatenate(sigma, axis=1)
    scale = {part: 1.0 if part == "T" else 1e3 for part in PARTS}
    return {
        "rms": {part: scale[part] * float(np.sqrt(np.mean(error[:, rows] ** 2)))
                for part, rows in PARTS.items()},
        "held": {part: float(within[:, rows].mean()) for part, rows in PARTS.items()},
        # of 95 %, from unit to unit: what is wrong with a unit is wrong in all of its readings
        "held_interval": {part: 1.96 * float(within[:, rows].mean(axis=(0, 1)).std(ddof=1))
                          / float(np.sqrt(true.n)) for part, rows in PARTS.items()},
    }  # fmt: skip


def _lag(true: Topology, known: Topology, stretch: float, estimator: str) -> dict[str, float]:
    """What a step of the temperature adds to force and displacement, H = R = 1 mm, no noise."""
    skin = with_rate(Made(true, known, Fabrication.perfect(true.n)), LAG_RATE_HZ)
    time_s = np.arange(round(LAG_SECONDS * LAG_RATE_HZ)) / LAG_RATE_HZ
    gel = 25.0 + STEP_C * relaxed(time_s, GEL_LAG_S, stretch)
    film_lag_s = float(np.median(true.parameters["film_lag_s"]))
    # the film's own answer to each rise of the gel
    rises, answer = np.diff(gel, prepend=25.0), relaxed(time_s, film_lag_s, stretch)
    film = 25.0 + np.convolve(rises, answer)[: time_s.size]
    gel, film = (np.repeat(each[:, np.newaxis], true.n, axis=1) for each in (gel, film))
    depth, place = np.ones(gel.shape), np.zeros((time_s.size, 2, true.n))
    place[:, 0] = 1.0
    units = skin.simulator()
    counts = units.quantise(units.quantities(depth, place, gel, film, np.full(gel.shape, 25.0)))
    reading = Decoder(
        apart(skin.known), {"force", "displacement"}, estimator, sweeps=0, ambient=False
    )(counts)
    force, moved = (values[:, 0] - values[0, 0] for values in
                    (reading.force, reading.displacement_mm))  # fmt: skip
    return {
        "force_mn_rms": 1e3 * float(np.sqrt(np.mean(force**2))),
        "um_rms": 1e3 * float(np.sqrt(np.mean(moved**2))),
    }
