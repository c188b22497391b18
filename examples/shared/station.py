"""Station: a gripper that holds a vessel of water, over a flame or under a tap.

The vessel is physics outside of the skin: its mass grows, its surface warms. The skin has no data
but the frames on the bus, and `GripControl` no law of its own for vessels.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np

from skin.behaviours.grip import GripControl, Phase
from skin.behaviours.pads import Pads
from skin.sim import GraspObject, grasp
from skin.sim.grasping.episode import Ranges
from topology import load

from .gripper import OPEN_M, SimulatedGripper
from .people import Hand
from .temperature import Temperature

__all__ = ["Span", "Station", "Stop", "Vessel"]

G = 9.81
WATER_J_PER_KG_K, GLASS_J_PER_KG_K = 4184.0, 830.0
"""Heat capacities [tables]."""
ROOM_C = 24.0
FLAME_LAG_S, TAP_LAG_S = 0.3, 0.1
"""Lags of a flame's power and of a flow behind their settings [assumed]."""
BENCH_M, CLEAR_M, DROPPED_M = -0.05, 5e-4, 0.01
"""Height of the bench, gap above it at the start, and longest allowed slide down the pads."""
SPEED_M_PER_S, STEADY_S = 0.03, 0.3
"""Of the hand; time after a motion in which what is held still swings [assumed]."""
UNITS = Ranges(stiffness=(0.97, 1.03), gain=(0.98, 1.02), gel=(0.98, 1.02), noise=(0.8, 1.2),
               tilt_rad=(-0.01, 0.01))  # fmt: skip
"""Spread of units beyond their calibration [assumed]."""


class Vessel:
    """Well mixed water in glass: warmed by a flame and hot water, cooled by the room. The outer
    face lags it, and reaches a share of its difference to the room."""

    def __init__(
        self, glass_kg: float, water_kg: float, water_c: float, loss_w_per_k: float,
        wall_lag_s: float, wall_share: float,
    ) -> None:  # fmt: skip
        self.glass_kg, self.water_kg, self.water_c = glass_kg, water_kg, water_c
        self._loss, self._lag_s, self._share = loss_w_per_k, wall_lag_s, wall_share
        self.wall_c = self._wall_goal()
        self.poured_kg = self.power_w = self.flow_kg_per_s = self.rate_c_per_s = 0.0

    @property
    def mass_kg(self) -> float:
        """Of glass and water."""
        return self.glass_kg + self.water_kg

    def step(self, dt_s: float, power_w: float, flow_kg_per_s: float, hot_c: float) -> None:
        """Advance by a short time, with these settings of flame and tap."""
        self.power_w -= (power_w - self.power_w) * math.expm1(-dt_s / FLAME_LAG_S)
        self.flow_kg_per_s -= (flow_kg_per_s - self.flow_kg_per_s) * math.expm1(-dt_s / TAP_LAG_S)
        flow = self.flow_kg_per_s
        heat_w = self.power_w - self._loss * (self.water_c - ROOM_C)
        heat_w += WATER_J_PER_KG_K * flow * (hot_c - self.water_c)
        water_kg = self.water_kg + flow * dt_s
        capacity = WATER_J_PER_KG_K * water_kg + GLASS_J_PER_KG_K * self.glass_kg
        self.rate_c_per_s = heat_w / capacity
        self.water_c += self.rate_c_per_s * dt_s
        self.water_kg, self.poured_kg = water_kg, self.poured_kg + flow * dt_s
        self.wall_c -= (self._wall_goal() - self.wall_c) * math.expm1(-dt_s / self._lag_s)

    def _wall_goal(self) -> float:
        return ROOM_C + self._share * (self.water_c - ROOM_C)


class Stop(Exception):
    """An alarm: thrown into the plan, which puts the vessel down."""


class Span(NamedTuple):
    """A step of a plan."""

    name: str
    began_s: float
    ended_s: float


class Station:
    """The world, the grip, and what is felt of the vessel.

    `power_w`, `flow_kg_per_s` and `hot_c` set flame and tap, `hand` is a person's; `loads` are
    those of the pads in this cycle. `play` fills `spans` and `rows`, one a cycle; a plan that is
    stopped says `why`.
    """

    def __init__(self, thing: GraspObject, vessel: Vessel, *, seed: int) -> None:
        topology = load("gripper")
        self.vessel, self._name = vessel, thing.name
        self.world = grasp(
            topology, objects=[thing], model=Path(__file__).with_name("station.xml"), seed=seed,
            episode=UNITS.draw(topology, seed=seed), want=("force", "temperature", "sigma"),
        )  # fmt: skip
        self.period_s = 1.0 / topology.cycle_rate_hz
        gripper = SimulatedGripper(self.world, OPEN_M - thing.size_m[0] - 0.004)
        self.control = GripControl(topology, gripper)
        self.pads, self.temperature = Pads(topology), Temperature(topology)
        self.power_w = self.flow_kg_per_s = self.hot_c = self.time_s = 0.0
        self.hand = Hand(self.world)
        self.why, self.spans = "", list[Span]()
        self.rows: list[dict[str, Any]] = []
        self.at = {"lift": 0.0, "aside": 0.0}
        self._moved_s, self._lowest_m, self.released = 0.0, math.nan, False

    def move(self, name: str, goal_m: float) -> None:
        """Set the target of `lift` or `aside`, from the next cycle on."""
        if goal_m != self.at[name]:
            self.at[name], self._moved_s = goal_m, self.time_s
            self.world.joints[name] = goal_m

    # -- parts of plans, a cycle a yield -----------------------------------------------------------

    def wait(self, what: str, seconds: float) -> Generator[str]:
        """Do nothing else."""
        until_s = self.time_s + seconds
        while self.time_s < until_s:
            yield what

    def go(self, what: str, **goals: float) -> Generator[str]:
        """Move to heights (`lift`) and aside (`aside`), metre."""
        for name, goal_m in goals.items():
            while (left_m := goal_m - self.at[name]) != 0.0:
                step_m = math.copysign(min(abs(left_m), SPEED_M_PER_S * self.period_s), left_m)
                self.move(name, self.at[name] + step_m)
                yield what

    def put_down(self, what: str) -> Generator[str]:
        """Lower until the bench bears what hangs, and open."""
        hung_n = self.weight_n
        while self.weight_n > 0.5 * hung_n and self.at["lift"] > -0.02:
            self.move("lift", self.at["lift"] - SPEED_M_PER_S * self.period_s)
            yield what
        yield from self.open(what)

    def grip(self, what: str) -> Generator[str]:
        """Close until both pads hold."""
        self.control.close()
        self._lowest_m = math.nan
        while self.control.load_n < 0.9 * self.control.parameters.first_grip_n:
            yield what
        yield from self.wait(what, 0.5)

    def open(self, what: str) -> Generator[str]:
        """Let go."""
        self.released = True
        self.control.release()
        while self.control.phase is not Phase.OPEN:
            yield what
        yield from self.wait(what, 0.5)
        self.released = False

    # -- playing -----------------------------------------------------------------------------------

    def play(self, plan: Generator[str], watch: Any, most_s: float = 300.0) -> None:
        """Run a plan to its end, one `next` a cycle.

        `watch(what)` gives the rest of a row; its `alarm`, a text, is thrown into the plan once.
        """
        what, began_s = "", 0.0
        for state in self.world:
            self.state, self.time_s = state, self.world.time_s
            self.loads = self.pads.read(state)
            self.temperature.update(state, self.time_s)
            row = watch(what)
            try:
                alarmed = row["alarm"] and not self.why
                now = plan.throw(Stop(row["alarm"])) if alarmed else next(plan)
            except StopIteration:
                break
            if now != what:
                self.spans += [Span(what, began_s, self.time_s)] if what else []
                what, began_s = now, self.time_s
            stands = self.time_s - self._moved_s > STEADY_S
            self.control.is_steady = stands and self.flow_kg_per_s == 0.0
            self.control.update(state)
            self.vessel.step(self.period_s, self.power_w, self.flow_kg_per_s, self.hot_c)
            self.world.warm(self._name, self.vessel.wall_c)
            self.world.weigh(self._name, self.vessel.mass_kg)
            self.hand.update()
            self.rows.append(self._row() | row)
            if self.time_s > most_s:
                self.why = f"{what}: not within {most_s:g} s"
                break
        self.spans.append(Span(what, began_s, self.time_s))
        self.world.close()

    def _row(self) -> dict[str, Any]:
        """Felt beside true, newton by pad and of both, °C."""
        truth, felt, vessel = self.world.truth, self.temperature, self.vessel
        height_m = float(truth.position[2, 0]) - self.world.joints["lift"]
        if self.control.phase is Phase.HOLDING and not self.released:
            self._lowest_m = height_m if math.isnan(self._lowest_m) else self._lowest_m
        slid_m = 0.0 if self.released else self._lowest_m - height_m
        return {
            "time_s": self.time_s, "inside_c": felt.inside_c, "sigma_c": felt.sigma_c,
            "gel_c": felt.gel_c, "true_c": vessel.water_c, "true_rate": vessel.rate_c_per_s,
            "phase": felt.phase, "began_s": felt.began_s, "grip_n": self.control.load_n,
            "true_grip_n": 0.5 * float(truth.normal_n.sum()), "weight_n": self.weight_n,
            "true_weight_n": float(truth.wrench[2, 0]), "slid_m": slid_m, "lift_m": self.at["lift"],
            "twist_nm": float(self.loads.torsion_nm[0] - self.loads.torsion_nm[1]),
        }  # fmt: skip

    @property
    def weight_n(self) -> float:
        """Vertical load of both pads, of this cycle."""
        return -float(self.loads.force_n[2].sum())

    def columns(self) -> dict[str, np.ndarray]:
        """The rows as columns of shape (t,)."""
        return {name: np.array([row[name] for row in self.rows]) for name in self.rows[0]}

    def draw(self, at: dict[str, np.ndarray], hues: dict[str, str]) -> tuple[Any, Any, Any]:
        """Temperature and loads over time, felt over truth, over the steps of the plan; the figure,
        and two axes below for more."""
        figure, axes = plt.subplots(4, 1, sharex=True, figsize=(11.0, 8.4), layout="constrained",
                                    height_ratios=(2.0, 1.6, 1.0, 1.0))  # fmt: skip
        warm, force, *more = axes
        warm.plot(at["time_s"], at["true_c"], color="0.7", linewidth=3, label="within, truth")
        warm.plot(at["time_s"], at["inside_c"], "C3", linewidth=1, label="within, felt")
        warm.plot(at["time_s"], at["gel_c"], "k:", linewidth=0.8, label="gel")
        warm.set(ylabel="temperature, °C",
                 ylim=(at["true_c"].min() - 6.0, at["true_c"].max() + 12.0))  # fmt: skip
        for name, label, hue in (("grip_n", "Fn by pad", "C0"), ("weight_n", "Ft of both", "C2")):
            force.plot(at["time_s"], at[name], hue, linewidth=0.6, label=f"{label}, felt")
            force.plot(at["time_s"], at[f"true_{name}"], "k", linewidth=0.8, alpha=0.7)
        force.set_ylabel("force, N (truth black)")
        for span in self.spans:
            for one in axes:
                one.axvspan(*span[1:], color=hues.get(span.name, "w"), alpha=0.1, linewidth=0)
            warm.text(0.5 * (span.began_s + span.ended_s), 0.98, span.name, fontsize=7, ha="center",
                      va="top", rotation=90, transform=warm.get_xaxis_transform())  # fmt: skip
        axes[-1].set(xlabel="time, s", xlim=(0.0, None))
        return figure, *more
