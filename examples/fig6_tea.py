"""A glass is filled with hot water, carried to a person, and handed over, as in the paper's Fig. 6.

A tap fills the held glass in a high, a low and a micro flow until the tea has 55 °C. What decides
is decoded from the frames of the gripper's two pads: the weight and its rise, the temperature
behind the glass, and whether a person has taken the glass. `GripControl` grips harder as the glass
fills. Flows and temperatures are those of a kitchen; the paper's stages last two to three times as
long. `--seed` draws glass, water, tap, person and units; `--goal 30` is a short run.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Generator
from typing import Any

import numpy as np

from shared.people import take
from shared.station import BENCH_M, CLEAR_M, DROPPED_M, TAP_LAG_S, G, Station, Stop, Vessel
from shared.temperature import INNOVATION_S, Kalman
from skin.behaviours.handover import Handover, Phase
from skin.sim import GraspObject

GOAL_C, LOW_FROM_C, MICRO_FROM_C = 55.0, 31.0, 51.0
"""Of the tea [paper], and where the tap is turned down."""
FLOWS = {"high": 1.0, "low": 0.42, "micro": 0.12}
"""Shares of the open tap [paper: 15, 8 and about 1 ml/s]."""
BOUNDS_ML_PER_S = {"micro": 0.4, "low": 3.5, "high": 10.0}
"""Least flow of a stage [assumed: means of the paper's]."""
JUMP_KG_PER_S, DRIFT_KG_PER_S15 = 8e-3, 1e-4
"""One-sigma of a jump of the flow, and of its other changes after a second [assumed]."""
TARE_S, PERSON_S = 1.0, 1.0
"""Time of the tare; delay until a person takes an offered glass."""
HOT_C, CAPACITY, SPREAD = 88.0, 0.6, 0.4
"""What is known of the tea before: its temperature, the heat capacity of the cold glass over that
of as much water, and the relative one-sigma of what a millilitre warms [assumed]."""
LEARN_S, FALL = 3.0, 0.2
"""Time constant of the warming by a millilitre, and its relative one-sigma since [assumed]."""
FULL_ML, UNKNOWN_C, UNKNOWN_S = 220.0, 8.0, 1.0


class Pouring:
    """Weight and flow, by a Kalman filter of the weight; weak flows by how fast the tea warms.

    `poured_ml`, `sigma_ml`, `flow_ml_per_s` are NaN and `stage` is "none" before the tare.
    """

    def __init__(self, station: Station) -> None:
        self.station, self.temperature = station, station.temperature
        flows = np.array([[0.0, 1.0], [0.0, 0.0]])
        self._filter = Kalman(flows, 1, DRIFT_KG_PER_S15**2, station.period_s)
        self.poured_ml = self.sigma_ml = self.flow_ml_per_s = self.tare_kg = math.nan
        self.stage = "none"

    def begin(self, weights_n: list[float]) -> None:
        """Take the mean of some cycles as the tare."""
        self.tare_kg = float(np.mean(weights_n)) / G
        self._variance = float(np.var(np.diff(weights_n))) / 2.0 / G**2
        self._tared = self._variance / len(weights_n)
        self._filter.x = np.array([self.tare_kg, 0.0])
        self._filter.cov = np.diag([self._tared, 1e-6])
        self._changes = self.temperature.changes
        first = max(HOT_C - self.temperature.inside_c, 1.0) / (1e3 * CAPACITY * self.tare_kg)
        self._squares = 1.0 / (SPREAD * first) ** 2
        self._products = first * self._squares

    def update(self) -> None:
        """Process a cycle after the tare."""
        own, warm = self._filter, self.temperature
        own.update(0, self.station.weight_n / G, self._variance)
        if own.changed or warm.changes != self._changes:
            own.jump(1, JUMP_KG_PER_S)
        self._changes = warm.changes
        weight, flow = own.x.tolist()
        self.poured_ml = 1e3 * (weight - self.tare_kg) / density(warm.inside_c)
        self.sigma_ml = 1e3 * math.hypot(
            own.sigma(0), math.sqrt(self._tared), 0.01 * (weight - self.tare_kg),
            JUMP_KG_PER_S * INNOVATION_S / math.sqrt(3.0),
        )  # fmt: skip
        self._report(*self._with_warmth(1e3 * flow, 1e3 * own.sigma(1)))

    def _with_warmth(self, flow: float, sigma: float) -> tuple[float, float]:
        """Learn from strong flows how much a millilitre warms; the flow by weight and warming."""
        rate, rate_sigma = self.temperature.rate_c_per_s, self.temperature.rate_sigma
        by_ml = self._products / self._squares
        if flow > 5.0 * sigma and rate > 5.0 * rate_sigma:
            dt_s = self.station.period_s
            gained = dt_s * flow / (rate_sigma**2 + (by_ml * sigma) ** 2)
            self._squares = (1.0 - dt_s / LEARN_S) * self._squares + gained * flow
            self._products = (1.0 - dt_s / LEARN_S) * self._products + gained * rate
        spread = math.hypot(FALL, 1.0 / math.sqrt(self._squares) / by_ml)
        other_sigma = math.hypot(rate_sigma / by_ml, spread * rate / by_ml)
        own, other = 1.0 / sigma**2, 1.0 / other_sigma**2
        return (own * flow + other * rate / by_ml) / (own + other), (own + other) ** -0.5

    def _report(self, flow: float, sigma: float) -> None:
        """The stage, with a hysteresis of half a sigma."""
        self.flow_ml_per_s = flow
        names, bounds = ["none", *BOUNDS_ML_PER_S], BOUNDS_ML_PER_S.values()
        low = sum(flow - 0.5 * sigma >= bound for bound in bounds)
        high = sum(flow + 0.5 * sigma >= bound for bound in bounds)
        self.stage = names[min(max(names.index(self.stage), low), high)]


def density(celsius: float) -> float:
    """Of water, kilogram per litre [Kell, 1975]."""
    return float(np.interp(celsius, range(0, 120, 20),
                           (0.99984, 0.99821, 0.99222, 0.98320, 0.97180, 0.95836)))  # fmt: skip


def plan(
    station: Station, pouring: Pouring, tap: float, handover: Handover, rise_s: float,
    goal_c: float,
) -> Generator[str]:  # fmt: skip
    """What the hand does, a cycle a yield."""
    felt = station.temperature
    try:
        yield from station.grip("grasp")
        yield from station.go("lift", lift=0.03)
        yield from station.wait("lift", 2.5)
        weights_n = []
        while len(weights_n) * station.period_s < TARE_S:
            weights_n.append(station.weight_n)
            yield "weigh"
        pouring.begin(weights_n)
        for stage, until_c in zip(FLOWS, (LOW_FROM_C, MICRO_FROM_C, GOAL_C), strict=True):
            station.flow_kg_per_s = 1e-3 * tap * FLOWS[stage]
            lag_s = TAP_LAG_S if stage == "micro" else 0.0
            while not felt.inside_c + lag_s * felt.rate_c_per_s >= min(until_c, goal_c):
                yield stage
        station.flow_kg_per_s = 0.0
        yield from station.wait("settle", 3.0)
    except Stop as alarm:
        station.why = str(alarm)
        station.flow_kg_per_s = 0.0
        yield from station.put_down("put down")
        return
    yield from station.go("deliver", lift=0.05, aside=0.05)
    yield from station.wait("deliver", 1.0)
    handover.give()
    yield from station.wait("offer", PERSON_S)
    station.hand.begin(take((0.0, 0.0, G * station.vessel.mass_kg), rise_s))
    while handover.phase is not Phase.TAKEN:
        yield "offer"
    station.control.release()
    yield from station.wait("hand over", 1.0)


def run(seed: int, goal_c: float = GOAL_C) -> Station:
    """Play the story."""
    random = np.random.default_rng((seed, 41))
    glass_kg, water_kg, cold_c = random.uniform((0.14, 0.08, 16.0), (0.2, 0.12, 24.0))
    loss, lag_s, share = random.uniform((0.2, 0.8, 0.992), (0.6, 1.2, 1.0))
    vessel = Vessel(glass_kg, water_kg, cold_c, loss, lag_s, share)
    thing = GraspObject(
        name="glass", shape="cylinder", size_m=(0.036, 0.042), mass_kg=float(vessel.mass_kg),
        friction=float(random.uniform(0.5, 0.9)), kinetic_share=0.9,
        temperature_c=float(vessel.wall_c), position_m=(0.0, 0.0, BENCH_M + 0.042 + CLEAR_M),
    )  # fmt: skip
    station = Station(thing, vessel, seed=seed)
    station.hot_c = float(random.uniform(84.0, 92.0))
    pouring, handover = Pouring(station), Handover(station.world.skin.topology)
    unknown_s = 0.0

    def watch(what: str) -> dict[str, Any]:
        nonlocal unknown_s
        alarm = ""
        if handover.phase is not Phase.IDLE:
            handover.update(station.state)
        if what in FLOWS or what == "settle":
            pouring.update()
            is_unknown = not station.temperature.sigma_c < UNKNOWN_C
            unknown_s = unknown_s + station.period_s if is_unknown else 0.0
            if unknown_s > UNKNOWN_S:
                alarm = "the temperature is not known"
            if pouring.poured_ml > FULL_ML:
                alarm = f"the glass is full: {pouring.poured_ml:.0f} ml"
        return {
            "alarm": alarm,
            "flow_ml_per_s": pouring.flow_ml_per_s,
            "true_flow_ml_per_s": 1e3 * vessel.flow_kg_per_s,
            "poured_ml": pouring.poured_ml, "sigma_ml": pouring.sigma_ml, "stage": pouring.stage,
            "true_poured_ml": 1e3 * vessel.poured_kg / density(vessel.water_c),
            "hand_n": station.hand.force_n[2], "handed": handover.phase is Phase.TAKEN,
        }  # fmt: skip

    tap, rise_s = float(random.uniform(14.0, 18.0)), float(random.uniform(0.2, 0.8))
    station.play(plan(station, pouring, tap, handover, rise_s, goal_c), watch, most_s=90.0)
    return station


def figures(station: Station) -> dict[str, Any]:
    """What a run reached; delays from a change of the tap to its stage, in second."""
    at, last = station.columns(), station.rows[-1]
    delays_s = {}
    for span in station.spans:
        if span.name in FLOWS:
            told = (at["stage"] == span.name) & (at["time_s"] >= span.began_s)
            found = at["time_s"][told & (at["time_s"] <= span.ended_s)]
            delays_s[span.name] = float(found[0] - span.began_s) if found.size else math.inf
    taken = np.flatnonzero(at["handed"] == 1.0)
    held = slice(0, taken[0] if taken.size else None)
    secure = np.flatnonzero(at["hand_n"] > 0.5 * G * station.vessel.mass_kg)
    error_ml = last["poured_ml"] - last["true_poured_ml"]
    return {
        "done": not station.why and bool(taken.size), "why": station.why or "done",
        "dropped": bool(np.nanmax(at["slid_m"][held]) > DROPPED_M),
        "stage_delays_s": delays_s,
        "stages_within_1s": sum(delay_s <= 1.0 for delay_s in delays_s.values()),
        "end_c": station.vessel.water_c, "poured_ml": last["poured_ml"],
        "amount_error_ml": error_ml, "amount_error_sigmas": error_ml / last["sigma_ml"],
        "handover_s": float(at["time_s"][taken[0]] - at["time_s"][secure[0]])
        if taken.size and secure.size else math.nan,
        "grip_at_end_n": float(at["true_grip_n"][held][-1]),
    }  # fmt: skip


def draw(station: Station, file: str) -> None:
    """Temperature, loads, flow and amount over time."""
    at = station.columns()
    figure, flow, amount = station.draw(at, {"high": "C3", "low": "C2", "micro": "C0"})
    figure.axes[1].plot(at["time_s"], at["hand_n"], "C1", linewidth=0.8, label="person, truth")
    for axes, name, hue in ((flow, "flow_ml_per_s", "C0"), (amount, "poured_ml", "C2")):
        axes.plot(at["time_s"], at[f"true_{name}"], color="0.7", linewidth=3, label="truth")
        axes.plot(at["time_s"], at[name], hue, linewidth=1, label="felt")
        axes.set_ylabel(name.replace("_per_", "/").replace("_", ", "))
    flow.set_ylim(-1.0, 22.0)
    for axes in figure.axes:
        axes.legend(loc="upper left", fontsize=8, bbox_to_anchor=(1.0, 1.0))
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--goal", type=float, default=GOAL_C, help="°C of the tea")
    given = options.parse_args()
    station = run(given.seed, given.goal)
    for span in station.spans:
        print(f"{span.began_s:7.2f} to {span.ended_s:7.2f} s  {span.name}")
    for name, value in figures(station).items():
        print(f"{name:<20} {value:.3f}" if isinstance(value, float) else f"{name:<20} {value}")
    draw(station, "fig6_tea.png")
