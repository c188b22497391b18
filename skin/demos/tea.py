"""Tea: a glass is filled in three flows to the right temperature, carried to a person, handed over.

Flows and temperatures are those of a kitchen; the paper's stages last two to three times as long.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from skin.behaviours.pouring import PouringSettings
from skin.behaviours.warmth import WarmthSettings
from skin.demos.play import SPEED_M_PER_S, Story, move, play, release, squeeze
from skin.demos.pva import pva_episode
from skin.demos.runner import Alarm, Script, Step
from skin.demos.station import Person, Setting, Station
from skin.demos.vessel import VesselSettings
from skin.grasp.object import GraspObject

__all__ = ["GOAL_C", "run_tea", "tea_script", "tea_setting"]

GOAL_C = 55.0
"""Of the tea [paper]."""

PERSON_S = 1.0
"""Delay from the offer until a person takes the glass [assumed]."""


def _weigh(station: Station, seconds: float) -> None:
    if seconds == 0.0:
        station.pouring.begin()


def _pour(station: Station, seconds: float, share: float) -> None:
    """Open the tap, by this fraction."""
    station.flow_ml_per_s = share * station.tap_ml_per_s


def _deliver(station: Station, seconds: float) -> None:
    if seconds == 0.0:
        station.pouring.end()
    station.hand.go(SPEED_M_PER_S, lift=0.05, aside=0.05)


def _offer(station: Station, seconds: float) -> None:
    if seconds == 0.0:
        station.handover.give()
    if seconds > PERSON_S and station.person is None:
        station.person = Person(rise_s=station.person_rise_s)


def _let_go(station: Station, seconds: float) -> None:
    station.released = True
    station.hand.open()


def _put_down(station: Station, seconds: float) -> None:
    station.flow_ml_per_s = 0.0
    station.hand.go(SPEED_M_PER_S, lift=0.0)


def tea_script() -> Script:
    """Fill a glass in three flows until the tea has 55 °C, carry it to a person, hand it over."""
    there = ("hand.moving", "==", False)
    a_while, a_little = ("step.seconds", ">=", 1.0), ("step.seconds", ">=", 0.5)
    inside = "warmth.inside_c"
    steps = (
        Step("grasp", squeeze, (("hand.held", "==", True), a_while), 5.0, "let go"),
        Step("lift", partial(move, lift=0.03),
             (there, ("step.seconds", ">=", 2.0), ("warmth.known", "==", True)), 10.0, "put down"),
        Step("weigh", _weigh, (("pouring.began", "==", True),), 5.0, "put down"),
        Step("high flow", partial(_pour, share=1.0), ((inside, ">=", 31.0),), 20.0, "stop"),
        Step("low flow", partial(_pour, share=0.42), ((inside, ">=", 51.0),), 60.0, "stop"),
        Step("micro flow", partial(_pour, share=0.12), (("station.coming_c", ">=", GOAL_C),), 60.0,
             "stop"),
        Step("settle", partial(_pour, share=0.0), (("step.seconds", ">=", 3.0),)),
        Step("deliver", _deliver, (there, ("step.seconds", ">=", 2.5)), 10.0, "put down"),
        Step("offer", _offer, (("handover.phase", "==", "taken"),), 10.0, "put down"),
        Step("hand over", _let_go, (a_while,)),
    )  # fmt: skip
    rescue = (
        Step("stop", partial(_pour, share=0.0), (a_little,)),
        Step("put down", _put_down, (there, a_while)),
        Step("let go", release, (a_little,)),
    )
    ending = ("deliver", "offer", "hand over", "put down", "let go")
    alarms = (
        # a full stream of 90 °C warms a first 100 g by 14 °C a second: the lags alone make
        # sigma 5.6 °C
        Alarm(("warmth.sigma_c", ">", 8.0), "stop", "the temperature is not known",
              not_in=("grasp", "lift", *ending), lasting_s=1.0),
        Alarm(("pouring.known", "==", False), "stop", "the weight is not known",
              not_in=("grasp", "lift", *ending), lasting_s=0.5),
        Alarm(("pouring.poured_ml", ">", 220.0), "stop", "the glass is full", not_in=ending),
    )  # fmt: skip
    return Script(steps, rescue, alarms)


def tea_setting(seed: int) -> Setting:
    """A glass of random weight and friction, and water of random temperatures."""
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


def run_tea(seed: int, *, pace: bool = False) -> tuple[Setting, Story]:
    """Play the story; the same for the same seed."""
    setting = tea_setting(seed)
    random = np.random.default_rng((seed, 42))
    with Station(setting, seed=seed, episode=pva_episode(seed)) as station:
        station.tap_ml_per_s = float(random.uniform(14.0, 18.0))
        station.person_rise_s = float(random.uniform(0.2, 0.8))
        return setting, play(station, tea_script(), pace=pace)
