"""A beaker of PVA is levelled, heated, shaken and heated again, as in the paper's Fig. 5.

PVA dissolves in hot water, but clots above 90 °C. So the gripper holds the beaker over a flame
until it has 75 °C inside, shakes it at 1 Hz off the flame until it has 60 °C, and does so twice.
What decides is decoded from the frames of the gripper's two pads: torsion says how far the beaker
hangs off its middle, the gels say how warm it is inside, the weight how fast it is shaken.

The laboratory's burner has a tenth of the power, its beaker loses a tenth of the heat, and its
times are ten times as long; lags of the skin and the frequency of shaking are not scaled. `--seed`
draws flame, beaker, wall and units; `--rounds 1 --water 65` is a short run.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Generator
from typing import Any

import numpy as np
from scipy.optimize import curve_fit

from shared.station import BENCH_M, CLEAR_M, DROPPED_M, Station, Stop, Vessel
from skin.sim import GraspObject

FASTER = 10.0
"""Time scale of heating and cooling, relative to the laboratory's."""
HOT_C, COOL_C, LIMIT_C = 74.5, 60.5, 90.0
"""Where heating and shaking end, and where PVA clots [paper: 75, 60 and 90 °C]."""
SHAKEN_HZ, SHAKEN_M = 1.0, 0.012
LEVEL_M = 0.0025
"""Largest distance of the weight from the line between the pads [assumed: a fifth of the pitch]."""
UNKNOWN_C, UNKNOWN_S = 3.0, 1.0
"""One-sigma of the temperature that is an alarm once it lasts."""
WINDOW_S, LEAST_S = 5.0, 3.0
"""Of the fit of a sine to the weight: the last seconds, from so many on."""
TURN_S = 4.0
"""From a true turn, in which it must be told."""


def arm_m(station: Station) -> float:
    """Distance of the weight from the line between the pads, metre: torsion over weight, in the
    last half second."""
    last = station.rows[-round(0.5 / station.period_s) :]
    return sum(row["twist_nm"] for row in last) / sum(row["weight_n"] for row in last)


def frequency(time_s: np.ndarray, weight_n: np.ndarray) -> float:
    """Of the sine in a weight, Hz: a mean, a trend and a sine, fitted to it; NaN without one."""
    time_s, weight_n = time_s - time_s.mean(), weight_n - weight_n.mean()

    def model(t, a, b, c, d, hz):
        return a + b * t + c * np.cos(2 * np.pi * hz * t) + d * np.sin(2 * np.pi * hz * t)

    grid = np.arange(0.6, 4.0, 0.1)
    power = np.abs(np.exp(-2j * np.pi * np.outer(grid, time_s)) @ weight_n)
    start = (0.0, 0.0, 0.1, 0.1, grid[np.argmax(power)])
    try:
        found, cov = curve_fit(model, time_s, weight_n, start)
    except RuntimeError:
        return math.nan
    size = math.hypot(found[2], found[3])
    return float(found[4]) if size > 8.0 * math.sqrt(cov[2, 2]) else math.nan


def plan(station: Station, burner_w: float, rounds: int) -> Generator[str]:
    """What the hand does, a cycle a yield."""
    felt = station.temperature
    try:
        yield from station.grip("grasp")
        yield from station.go("weigh", lift=0.006)
        yield from station.wait("weigh", 1.5)
        off_m = arm_m(station)
        yield from station.put_down("lower")
        yield from station.go("centre", aside=off_m, lift=0.0)
        yield from station.grip("grasp again")
        yield from station.go("lift", lift=0.04)
        yield from station.wait("lift", 2.0)
        if not abs(arm_m(station)) < LEVEL_M:
            raise Stop(f"not level: {1e3 * arm_m(station):.1f} mm off")
        for _ in range(rounds):
            station.power_w = burner_w
            while not felt.inside_c >= HOT_C:
                yield "heat"
            station.power_w = 0.0
            began_s = station.time_s
            while not felt.inside_c <= COOL_C:
                since_s = station.time_s - began_s
                turn = math.sin(2.0 * math.pi * SHAKEN_HZ * since_s)
                station.move("lift", 0.04 + min(since_s, 1.0) * SHAKEN_M * turn)
                yield "shake"
            yield from station.go("heat", lift=0.04)
    except Stop as alarm:
        station.why = str(alarm)
    station.power_w = 0.0
    yield from station.put_down("put down")


def run(seed: int, rounds: int = 2, water_c: float | None = None) -> Station:
    """Play the story."""
    random = np.random.default_rng((seed, 31))
    friction, place_m = random.uniform(0.5, 0.9), random.uniform(-0.008, 0.008)
    glass_kg, water_kg, cold_c = random.uniform((0.06, 0.1, 18.0), (0.1, 0.16, 24.0))
    loss, lag_s, share = random.uniform((0.8, 0.8, 0.992), (1.1, 1.2, 1.0))
    vessel = Vessel(glass_kg, water_kg, cold_c if water_c is None else water_c, FASTER * loss,
                    lag_s, share)  # fmt: skip
    thing = GraspObject(
        name="beaker", size_m=(0.024, 0.034, 0.04), mass_kg=float(vessel.mass_kg),
        friction=float(friction), kinetic_share=0.9, temperature_c=float(vessel.wall_c),
        position_m=(0.0, float(place_m), BENCH_M + 0.04 + CLEAR_M),
    )  # fmt: skip
    station = Station(thing, vessel, seed=seed)
    weights, hz, unknown_s = [], math.nan, 0.0

    def watch(what: str) -> dict[str, Any]:
        nonlocal hz, unknown_s
        felt = station.temperature
        warm = what in ("heat", "shake")
        unknown_s = unknown_s + station.period_s if felt.sigma_c > UNKNOWN_C else 0.0
        alarm = ""
        if warm and felt.is_near(LIMIT_C):
            alarm = f"the solution would clot: {felt.inside_c:.1f} °C"
        elif warm and unknown_s > UNKNOWN_S:
            alarm = "the temperature is not known"
        if what != "shake":
            weights.clear()
            hz = math.nan
        weights.append((station.time_s, station.weight_n))
        count = min(len(weights), round(WINDOW_S / station.period_s))
        if count * station.period_s > LEAST_S and len(weights) % 64 == 0:
            last = np.array(weights[-count:])[: count - count % 8]
            hz = frequency(*last.reshape(-1, 8, 2).mean(axis=1).T)
        return {"frequency_hz": hz, "alarm": alarm}

    burner_w = float(FASTER * random.uniform(150.0, 200.0))
    station.play(plan(station, burner_w, rounds), watch)
    return station


def figures(station: Station) -> dict[str, Any]:
    """What a run reached; delays and onsets of turns in second, after the true ones."""
    at, delays_s, onsets_s = station.columns(), [], []
    for span in station.spans:
        sign = {"heat": 1.0, "shake": -1.0}.get(span.name)
        if sign is None or span.ended_s - span.began_s < 1.0:
            continue
        during = at["time_s"] >= span.began_s
        turn_s = at["time_s"][during & (sign * at["true_rate"] > 0.0)][0]
        name = "heating" if sign > 0.0 else "cooling"
        told = np.flatnonzero(
            (at["phase"] == name) & (np.abs(at["time_s"] - turn_s - 0.5 * TURN_S) < 0.5 * TURN_S)
        )
        delays_s.append(at["time_s"][told[0]] - turn_s if told.size else math.inf)
        onsets_s.append(at["began_s"][told[0]] - turn_s if told.size else math.inf)
    hz = at["frequency_hz"][np.isfinite(at["frequency_hz"])]
    warm = at["time_s"] > max([s.ended_s for s in station.spans if s.name == "lift"], default=0.0)
    return {
        "done": not station.why, "why": station.why or "done",
        "dropped": bool(np.nanmax(at["slid_m"]) > DROPPED_M),
        "turn_delays_s": delays_s, "onset_errors_s": onsets_s,
        "turns_within_1s": sum(abs(one) <= 1.0 for one in delays_s),
        "onsets_within_1s": sum(abs(one) <= 1.0 for one in onsets_s),
        "warmest_c": float(at["true_c"].max()),
        "temperature_rms_c": float(np.sqrt(np.mean((at["inside_c"] - at["true_c"])[warm] ** 2))),
        "frequency_hz": float(np.median(hz)) if hz.size else math.nan,
        "grip_n": (float(np.nanmin(at["true_grip_n"][warm])), float(at["true_grip_n"].max())),
    }  # fmt: skip


def draw(station: Station, file: str) -> None:
    """Temperature, loads, height and frequency over time."""
    at = station.columns()
    figure, lift, often = station.draw(at, {"heat": "C3", "shake": "C0"})
    lift.plot(at["time_s"], 1e3 * at["lift_m"], "k", linewidth=0.8, label="hand")
    lift.set_ylabel("height, mm")
    often.plot(at["time_s"], at["frequency_hz"], "C0", label="shaken, felt")
    often.axhline(SHAKEN_HZ, color="0.7", linewidth=3, zorder=0, label="truth")
    often.set(ylabel="frequency, Hz", ylim=(0.9, 1.1))
    for axes in figure.axes:
        axes.legend(loc="upper left", fontsize=8, bbox_to_anchor=(1.0, 1.0))
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--rounds", type=int, default=2)
    options.add_argument("--water", type=float, help="°C at first")
    given = options.parse_args()
    station = run(given.seed, given.rounds, given.water)
    for span in station.spans:
        print(f"{span.began_s:7.2f} to {span.ended_s:7.2f} s  {span.name}")
    for name, value in figures(station).items():
        print(f"{name:<18} {np.round(value, 3) if isinstance(value, (list, float)) else value}")
    draw(station, "fig5_pva.png")
