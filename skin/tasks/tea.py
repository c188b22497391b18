"""Tea: a glass is filled in three flows until the tea is right, carried to a person, handed over.

Flows and temperatures are those of a kitchen; the paper's stages last two to three times as long.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skin.behaviours.pouring import PouringSettings
from skin.behaviours.warmth import WarmthSettings
from skin.sim.engine.object import GraspObject
from skin.tasks.moves import MOVES
from skin.tasks.play import Does, Story, play
from skin.tasks.pva import pva_episode
from skin.tasks.station import Person, Setting, Station
from skin.tasks.vessel import VesselSettings

__all__ = ["GOAL_C", "run_tea", "tea_setting"]

GOAL_C = 55.0
"""Of the tea [paper]."""

PERSON_S = 1.0
"""After the glass is offered, before somebody takes it [assumed]."""


def _weigh(station: Station, seconds: float, values: dict[str, float]) -> None:
    if seconds == 0.0:
        station.pouring.begin()


def _pour(station: Station, seconds: float, values: dict[str, float]) -> None:
    station.flow_ml_per_s = values["share"] * station.tap_ml_per_s


def _deliver(station: Station, seconds: float, values: dict[str, float]) -> None:
    if seconds == 0.0:
        station.pouring.end()
    station.hand.go(0.03, lift=values["lift_m"], aside=values["aside_m"])


def _offer(station: Station, seconds: float, values: dict[str, float]) -> None:
    if seconds == 0.0:
        station.handover.give()
    if seconds > PERSON_S and station.person is None:
        station.person = Person(rise_s=station.person_rise_s)


def _let_go(station: Station, seconds: float, values: dict[str, float]) -> None:
    station.released = True
    station.hand.open()


def _put_down(station: Station, seconds: float, values: dict[str, float]) -> None:
    station.flow_ml_per_s = 0.0
    station.hand.go(0.03, lift=0.0)


DOES = MOVES | {
    "weigh": Does(_weigh),
    "pour": Does(_pour, ("share",), ("share",)),
    "deliver": Does(_deliver, ("lift_m", "aside_m"), ("lift_m", "aside_m")),
    "offer": Does(_offer),
    "let_go": Does(_let_go),
    "put_down": Does(_put_down),
}


def tea_setting(seed: int) -> Setting:
    """A glass of unknown weight and friction, and water of its own temperatures."""
    random = np.random.default_rng((seed, 41))
    thing = GraspObject(
        name="glass", shape="cylinder", size_m=(0.036, 0.042),
        friction=float(random.uniform(0.5, 0.9)), kinetic_share=0.9,
    )  # fmt: skip
    vessel = VesselSettings(
        glass_kg=float(random.uniform(0.14, 0.2)), water_kg=float(random.uniform(0.08, 0.12)),
        water_c=float(random.uniform(16.0, 24.0)), loss_w_per_k=float(random.uniform(0.2, 0.6)),
        wall_lag_s=float(random.uniform(0.8, 1.2)), wall_share=float(random.uniform(0.992, 1.0)),
    )  # fmt: skip
    hot_c = float(random.uniform(84.0, 92.0))
    return Setting(
        thing=thing, vessel=vessel, hot_c=hot_c,
        warmth=WarmthSettings(band_c=(50.0, 58.0)), pouring=PouringSettings(hot_c=88.0),
    )  # fmt: skip


def run_tea(seed: int, *, pace: bool = False, file: Path | None = None) -> tuple[Setting, Story]:
    """Play the story; the same for the same seed."""
    setting = tea_setting(seed)
    random = np.random.default_rng((seed, 42))
    with Station(setting, seed=seed, episode=pva_episode(seed)) as station:
        station.tap_ml_per_s = float(random.uniform(14.0, 18.0))
        station.person_rise_s = float(random.uniform(0.2, 0.8))
        task = Path(__file__).with_name("tea.toml") if file is None else file
        return setting, play(station, task, DOES, pace=pace)
