"""What hurts most: errors of the decoder on Fig. 4a, with every non-ideality on and each alone.

The paper's experiment is played on a palm: 100 g from 50 s on, the same along x from 100 s and
along y from 150 s, while the room warms from 20 to 80 °C. The decoder has the units' nominal
parameters and no calibration. It is tared: what each force reads on average over the first
`TARE_S` seconds is taken from it. Each estimator meets the film that it reckons with: `sine` the
paper's law but in the rows `magnet` to `crosstalk`, the others the Halbach film as drawn. The wire
rounds in every row. The experiment only ever loads, so that loops of the elastomer, whose law is
that of first loading, hardly show.

Errors of force are the lengths of the difference vectors over all units: mean over each of the
three stages, mean and 95th percentile over all of them, and the mean of each component. The
temperature is that of the gel, over the whole time.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from msgspec.structs import replace

from benchmarks.accuracy_skin import apart
from skin.decode.decoder import Decoder
from skin.options import ESTIMATORS
from skin.sim.scenes.load import load_scene
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.script import NonIdeal
from skin.sim.truth import Truth
from topology import load

CASES: dict[str, NonIdeal] = {
    "wire alone": NonIdeal.only(),
    "noise": NonIdeal.only("noise"),
    "viscoelastic": NonIdeal.only("viscoelastic"),
    "hysteresis": NonIdeal.only("hysteresis"),
    "thermal": NonIdeal.only("thermal"),
    "ambient_field": NonIdeal.only("ambient_field"),
    "magnet": NonIdeal.only("magnet"),
    "fabrication": NonIdeal.only("magnet", "fabrication"),
    "crosstalk": NonIdeal.only("magnet", "crosstalk"),
    "counter": NonIdeal.only("counter"),
    "divider": NonIdeal.only("divider"),
    "hall_converter": NonIdeal.only("hall_converter"),
    "everything": NonIdeal.everything(),
}

TARE_S = 5.0
AT_ONCE = 50
"""Cycles that are read together."""
STAGES_S = (50.0, 100.0, 150.0)
"""When z, x and y are loaded."""
PAPER_FORCE_N, PAPER_TEMPERATURE_C = 0.03, 0.8
"""Largest mean error that the paper reports."""


def run(quick: bool) -> dict:
    """Measure; see `table` for what the figures are."""
    rate_hz = 2.0 if quick else 25.0
    cases = {
        name: {estimator: _errors(non_ideal, estimator, rate_hz) for estimator in ESTIMATORS}
        for name, non_ideal in CASES.items()
    }
    alone = [name for name in cases if name != "everything"]
    return {
        "scene": "fig4a",
        "rate_hz": rate_hz,
        "paper_force_n": PAPER_FORCE_N,
        "paper_temperature_c": PAPER_TEMPERATURE_C,
        "hurts_most": {
            estimator: max(alone, key=lambda name: cases[name][estimator]["force_mean_n"])
            for estimator in ESTIMATORS
        },
        "cases": cases,
    }


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = []
    for estimator, worst in figures["hurts_most"].items():
        lines.append(f"{estimator:<16}{'film':>8}{'z':>8}{'z x':>8}{'z x y':>8}{'all':>8}"
                     f"{'95 %':>8}{'Fx':>8}{'Fy':>8}{'Fz':>8}{'T':>7}{'flagged':>9}")  # fmt: skip
        for name, rows in figures["cases"].items():
            row = rows[estimator]
            forces = [*row["stage_mean_n"], row["force_mean_n"], row["force_p95_n"]]
            numbers = "".join(f"{value:>8.4f}" for value in forces + row["each_mean_n"])
            lines.append(
                f"{name:<16}{'Halbach' if row['film'] else 'sine':>8}{numbers}"
                f"{row['temperature_mean_c']:>7.3f}{row['invalid_share']:>9.1%}"
            )
        lines.append(f"most alone: {worst}")
    lines.append(
        f"newton and °C; the paper: at most {figures['paper_force_n']} N and "
        f"{figures['paper_temperature_c']} °C"
    )
    return "\n".join(lines)


def _errors(non_ideal: NonIdeal, estimator: str, rate_hz: float) -> dict:
    if estimator != "sine":
        non_ideal = replace(non_ideal, magnet=True)
    # heat reckons with the time of a cycle, so the skin cycles as often as it is looked at
    palm = load("palm")
    slow = replace(palm.buses[0], cycle_rate_hz=rate_hz)
    palm = dataclasses.replace(palm, buses=(slow,))
    script = load_scene("fig4a", palm)
    scene = ScriptedScene(palm, script, non_ideal=non_ideal)
    known = palm if non_ideal.crosstalk else apart(palm)
    decoder = Decoder(known, estimator=estimator, sweeps=0, ambient=False)
    times = np.arange(round(script.seconds * rate_hz)) / rate_hz
    read, true = np.empty((2, times.size, 3, palm.n))
    warm, valid = np.empty((times.size, palm.n)), np.empty((times.size, palm.n), bool)
    for start in range(0, times.size, AT_ONCE):
        rows = slice(start, min(start + AT_ONCE, times.size))
        truth = Truth.stack(scene.at(float(time_s)).copy() for time_s in times[rows])
        reading = decoder(scene.units.counts(truth))
        read[rows], true[rows] = reading.force, truth.force
        warm[rows], valid[rows] = reading.temperature - truth.temperature, reading.valid
    read -= read[times < TARE_S].mean(axis=0)
    wrong = np.abs(read - true)
    size = np.sqrt((wrong**2).sum(axis=1))
    stage = np.searchsorted(STAGES_S, times, side="right")
    loaded = stage > 0
    return {
        "film": any((non_ideal.magnet, non_ideal.fabrication, non_ideal.crosstalk)),
        "each_mean_n": wrong[loaded].mean(axis=(0, 2)).tolist(),
        "stage_mean_n": [float(size[stage == i].mean()) for i in (1, 2, 3)],
        "force_mean_n": float(size[loaded].mean()),
        "force_p95_n": float(np.percentile(size[loaded], 95.0)),
        "temperature_mean_c": float(np.abs(warm).mean()),
        "invalid_share": float(1.0 - valid.mean()),
    }
