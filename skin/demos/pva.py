"""PVA: a beaker is levelled, heated and shaken in turn, under control of the skin.

The laboratory's burner has a tenth of the power, its beaker loses a tenth of the heat, and its
times of heating and cooling are ten times as long; lags of the skin and the frequency of shaking
are not scaled. A lag of 4 s is ten times as large a part of a phase as there.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from skin.demos.play import SPEED_M_PER_S, Story, move, play, release, squeeze
from skin.demos.runner import Alarm, Condition, Script, Step
from skin.demos.station import Setting, Station
from skin.demos.vessel import VesselSettings
from skin.grasp.episode import Episode, Ranges
from skin.grasp.object import GraspObject
from topology import load

__all__ = ["FASTER", "pva_episode", "pva_script", "pva_setting", "run_pva"]

FASTER = 10.0
"""Time scale of heating and cooling, relative to the laboratory's."""

RANGES = Ranges(
    stiffness=(0.97, 1.03), gain=(0.98, 1.02), gel=(0.98, 1.02), noise=(0.8, 1.2),
    tilt_rad=(-0.01, 0.01),
)  # fmt: skip
"""Spread of units beyond their calibration [assumed]."""


def _lower(station: Station, seconds: float) -> None:
    if seconds == 0.0:
        station.off_centre_m = station.level.arm_m
    station.hand.go(SPEED_M_PER_S, lift=0.0)


def _centre(station: Station, seconds: float) -> None:
    """Over the weight."""
    if seconds == 0.0:
        aside = float(station.level.across[1]) * station.off_centre_m
        station.hand.go(SPEED_M_PER_S, aside=station.hand.aside_m + aside)


def _heat(station: Station, seconds: float) -> None:
    station.power_w = station.burner_w
    if seconds == 0.0:
        station.middle_m = station.middle_m or station.hand.lift_m
        station.hand.go(SPEED_M_PER_S, lift=station.middle_m)


def _shake(station: Station, seconds: float) -> None:
    """Up and down at 1 Hz by 12 mm off the flame, starting at rest in the middle."""
    station.power_w = 0.0
    swell = min(seconds, 1.0)
    turn = 2.0 * math.pi * 1.0 * seconds
    station.hand.shake(station.middle_m + swell * 0.012 * math.sin(turn))


def _put_down(station: Station, seconds: float) -> None:
    station.power_w = 0.0
    station.hand.go(SPEED_M_PER_S, lift=0.0)


def pva_script(
    hot: Condition = ("warmth.inside_c", ">=", 74.5),
    cool: tuple[Condition, ...] = (("warmth.inside_c", "<=", 60.5),),
    rounds: int = 2,
) -> Script:
    """Level the beaker, then heat it until it is hot and shake it until it is cool, in turn.

    Times are a tenth of the laboratory's.
    """
    there = ("hand.moving", "==", False)
    held = (("hand.held", "==", True), ("step.seconds", ">=", 1.0))
    a_little = ("step.seconds", ">=", 0.5)
    down = Step("put down", _put_down, (there, ("step.seconds", ">=", 1.0)))
    let_go = Step("let go", release, (a_little,))
    level = (
        Step("grasp", squeeze, held, 5.0, "let go"),
        Step("weigh", partial(move, lift=0.006),  # a little off the bench, to measure the level
             (there, ("level.known", "==", True), ("step.seconds", ">=", 1.5)), 5.0, "put down"),
        Step("lower", _lower, (there, a_little)),
        Step("open", release, (a_little,)),
        Step("centre", _centre, (there,)),
        Step("grasp again", squeeze, held, 5.0, "let go"),
        Step("lift", partial(move, lift=0.04),
             (there, ("level.level", "==", True), ("step.seconds", ">=", 2.0)), 6.0, "put down"),
    )  # fmt: skip
    warm = (
        Step("heat", _heat, (hot,), 60.0, "put down"),
        Step("shake", _shake, cool, 90.0, "put down"),
    )
    alarms = (
        Alarm(("warmth.over_limit", "==", True), "put down", "the solution would clot",
              not_in=("let go",)),
        Alarm(("warmth.sigma_c", ">", 3.0), "put down", "the temperature is not known",
              not_in=(*(step.name for step in level), "let go"), lasting_s=1.0),
    )  # fmt: skip
    return Script((*level, *rounds * warm, down, let_go), (down, let_go), alarms)


def pva_setting(seed: int) -> Setting:
    """A beaker of random weight, friction and place, over a random flame."""
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
    """Units that differ from their calibration."""
    return RANGES.draw(load("gripper"), seed=seed)


def run_pva(
    seed: int, *, pace: bool = False, script: Script | None = None, water_c: float | None = None
) -> tuple[Setting, Story]:
    """Play the story; the same for the same seed. Script and initial temperature of the water may
    be replaced."""
    setting = pva_setting(seed)
    if water_c is not None:
        setting = replace(setting, vessel=replace(setting.vessel, water_c=water_c))
    random = np.random.default_rng((seed, 32))
    with Station(setting, seed=seed, episode=pva_episode(seed)) as station:
        station.burner_w = float(FASTER * random.uniform(150.0, 200.0))
        return setting, play(station, script or pva_script(), pace=pace)
