"""PVA: a beaker is levelled, heated and shaken in turn, by what the gripper feels.

The laboratory's burner has a tenth of the power, its beaker loses a tenth of the heat, and the
times of heating and cooling are ten times as long; lags of the skin and the frequency of shaking
are not scaled. A lag of 4 s is ten times as much of such a phase as it is there.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from skin.grasp.episode import Episode, Ranges
from skin.sim.engine.object import GraspObject
from skin.tasks.moves import MOVES
from skin.tasks.play import Does, Story, play
from skin.tasks.station import Setting, Station
from skin.tasks.vessel import VesselSettings
from topology import load

__all__ = ["FASTER", "pva_episode", "pva_setting", "run_pva"]

FASTER = 10.0
"""Of heating and cooling, over the laboratory's."""

RANGES = Ranges(
    stiffness=(0.97, 1.03), gain=(0.98, 1.02), gel=(0.98, 1.02), noise=(0.8, 1.2),
    tilt_rad=(-0.01, 0.01),
)  # fmt: skip
"""Spread of units that their calibration does not know of [assumed]."""


def _lower(station: Station, seconds: float, values: dict[str, float]) -> None:
    if seconds == 0.0:
        station.off_centre_m = station.level.arm_m
    station.hand.go(0.03, lift=0.0)


def _centre(station: Station, seconds: float, values: dict[str, float]) -> None:
    if seconds == 0.0:
        aside = float(station.level.across[1]) * station.off_centre_m
        station.hand.go(0.03, aside=station.hand.aside_m + aside)


def _heat(station: Station, seconds: float, values: dict[str, float]) -> None:
    station.power_w = station.burner_w
    if seconds == 0.0:
        station.middle_m = station.middle_m or station.hand.lift_m
        station.hand.go(0.03, lift=station.middle_m)


def _shake(station: Station, seconds: float, values: dict[str, float]) -> None:
    """Up and down, beginning and ending at rest in the middle."""
    station.power_w = 0.0
    swell = min(seconds, 1.0)
    turn = 2.0 * math.pi * values.get("frequency_hz", 1.0) * seconds
    station.hand.shake(station.middle_m + swell * values.get("amplitude_m", 0.01) * math.sin(turn))


def _put_down(station: Station, seconds: float, values: dict[str, float]) -> None:
    station.power_w = 0.0
    station.hand.go(0.03, lift=0.0)


DOES = MOVES | {
    "lower": Does(_lower),
    "centre": Does(_centre),
    "heat": Does(_heat),
    "shake": Does(_shake, ("frequency_hz", "amplitude_m")),
    "put_down": Does(_put_down),
}


def pva_setting(seed: int) -> Setting:
    """A beaker of unknown weight, friction and place, over an unknown flame."""
    random = np.random.default_rng((seed, 31))
    thing = GraspObject(
        name="beaker", shape="box", size_m=(0.024, 0.034, 0.04),
        friction=float(random.uniform(0.5, 0.9)), kinetic_share=0.9,
        position_m=(0.0, float(random.uniform(-0.008, 0.008)), 0.0),
    )  # fmt: skip
    vessel = VesselSettings(
        glass_kg=float(random.uniform(0.06, 0.1)), water_kg=float(random.uniform(0.1, 0.16)),
        water_c=float(random.uniform(18.0, 24.0)),
        loss_w_per_k=float(FASTER * random.uniform(0.8, 1.1)),
        wall_lag_s=float(random.uniform(0.8, 1.2)), wall_share=float(random.uniform(0.992, 1.0)),
    )  # fmt: skip
    return Setting(thing=thing, vessel=vessel)


def pva_episode(seed: int) -> Episode:
    """Units that are not quite as their calibration has them."""
    return RANGES.draw(load("gripper"), seed=seed)


def run_pva(
    seed: int, *, pace: bool = False, file: Path | None = None, water_c: float | None = None
) -> tuple[Setting, Story]:
    """Play the story; the same for the same seed. Another file may stand in for its own, and the
    water may have another temperature at the start."""
    setting = pva_setting(seed)
    if water_c is not None:
        setting = replace(setting, vessel=replace(setting.vessel, water_c=water_c))
    random = np.random.default_rng((seed, 32))
    with Station(setting, seed=seed, episode=pva_episode(seed)) as station:
        station.burner_w = float(FASTER * random.uniform(150.0, 200.0))
        task = Path(__file__).with_name("pva.toml") if file is None else file
        return setting, play(station, task, DOES, pace=pace)
