"""Plays a story on a station, and records measurements and truth cycle by cycle."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from skin.demos.runner import Passed, Runner, Script
from skin.demos.station import Station

__all__ = ["Change", "Story", "move", "play", "release", "squeeze"]

SPEED_M_PER_S = 0.03
"""Speed of the moving hand."""

LOGGED_EVERY = 5
"""Cycles per row of the log: 20 ms."""

COLUMNS = (
    "time_s", "inside_c", "sigma_c", "gel_c", "rate_c_per_s", "true_c", "true_rate_c_per_s",
    "load_n", "true_load_n", "weight_n", "true_weight_n", "flow_ml_per_s", "true_flow_ml_per_s",
    "poured_ml", "true_poured_ml", "frequency_hz", "lift_m", "tilt_deg",
)  # fmt: skip


class Change(NamedTuple):
    """A change of a behaviour's output."""

    time_s: float
    what: str


@dataclass
class Story:
    """Record of a story.

    Attributes
    ----------
    outcome, why : str
        "done" or "failed", and the cause of a failure.
    dropped : bool
    slid_m : float
    timeline : list of Passed
    phases, stages : list of Change
        As measured: heating and cooling, and flows.
    phases_began_s : list of float
        Of each phase: when the rate crossed zero, as reported once it was certain.
    asked : list of Change
        Settings of flame and tap: "flame" or "no flame", and flows in ml/s.
    shaken_hz : float
        Median of the measured frequency during shaking; NaN without shaking.
    decisions : dict of str to list of str
        Of each behaviour.
    poured_ml, sigma_ml, true_poured_ml : float
        At the end of pouring.
    true_end_c : float
        Of the water at the end.
    tilts_deg : dict of str to float
        At the end of each step.
    rows : ndarray, shape (t, c)
        Columns as in `COLUMNS`.
    """

    outcome: str = ""
    why: str = ""
    dropped: bool = False
    slid_m: float = 0.0
    timeline: list[Passed] = field(default_factory=list)
    phases: list[Change] = field(default_factory=list)
    phases_began_s: list[float] = field(default_factory=list)
    stages: list[Change] = field(default_factory=list)
    asked: list[Change] = field(default_factory=list)
    shaken_hz: float = float("nan")
    decisions: dict[str, list[str]] = field(default_factory=dict)
    poured_ml: float = float("nan")
    sigma_ml: float = float("nan")
    true_poured_ml: float = float("nan")
    true_end_c: float = float("nan")
    tilts_deg: dict[str, float] = field(default_factory=dict)
    rows: np.ndarray = field(default_factory=lambda: np.empty((0, len(COLUMNS))))

    def column(self, name: str) -> np.ndarray:
        """One column of the log, shape (t,)."""
        return self.rows[:, COLUMNS.index(name)]


def squeeze(station: Station, seconds: float) -> None:
    """Close the hand."""
    station.hand.close()


def release(station: Station, seconds: float) -> None:
    """Open the hand."""
    station.hand.open()
    station.regripped()


def move(station: Station, seconds: float, **goals: float) -> None:
    """Move the hand to a height (`lift`) and aside (`aside`), metre; others stay."""
    station.hand.go(SPEED_M_PER_S, **goals)


def play(station: Station, script: Script, *, pace: bool = False, most_s: float = 300.0) -> Story:
    """Play a script on a station to its end."""
    runner = Runner(script, station)
    story, rows = Story(), []
    shaken: list[float] = []
    began_s = time.monotonic()
    for count, state in enumerate(station.world):
        station.update(state)
        before, passed = runner.step.name, len(runner.timeline)
        runner.update(station.time_s)
        if len(runner.timeline) > passed:
            story.tilts_deg[before] = station.tilt_deg
        station.act()
        _changes(story, station)
        if before == "shake" and station.shaking.shaken:
            shaken.append(station.shaking.frequency_hz)
        if count % LOGGED_EVERY == 0:
            rows.append(_row(station))
        if runner.outcome or station.time_s >= most_s:
            break
        if pace:
            time.sleep(max(0.0, began_s + station.time_s - time.monotonic()))
    _finish(story, station, runner)
    story.rows = np.array(rows)
    if shaken:
        story.shaken_hz = float(np.median(shaken))
    return story


def _finish(story: Story, station: Station, runner: Runner) -> None:
    story.outcome, story.why = runner.outcome or "failed", runner.why
    story.timeline = runner.timeline
    story.dropped, story.slid_m = station.dropped, station.slid_m
    story.poured_ml, story.sigma_ml = station.pouring.poured_ml, station.pouring.sigma_ml
    story.true_poured_ml = station.true_poured_ml
    story.true_end_c = station.vessel.water_c
    for name, behaviour in station.feels().items():
        decisions = getattr(behaviour, "decisions", None)
        if decisions is not None:
            story.decisions[name] = [str(decision) for decision in decisions]


def _changes(story: Story, station: Station) -> None:
    """Record changes of measurements and settings."""
    tap = station.flow_ml_per_s
    warmth = station.warmth
    if not story.phases or story.phases[-1].what != warmth.phase:
        began_s = warmth.phase_began_s
        story.phases.append(Change(station.time_s, warmth.phase))
        story.phases_began_s.append(began_s + station.started_s)
    for changes, now in (
        (story.stages, station.pouring.stage),
        (story.asked, f"{tap:g} ml/s" if tap else "flame" if station.power_w else "nothing"),
    ):
        if not changes or changes[-1].what != now:
            changes.append(Change(station.time_s, now))


def _row(station: Station) -> list[float]:
    warmth, pouring, vessel = station.warmth, station.pouring, station.vessel
    truth = station.world.truth
    return [
        station.time_s, warmth.inside_c, warmth.sigma_c, warmth.gel_c, warmth.rate_c_per_s,
        vessel.water_c, vessel.rate_c_per_s, station.hand.load_n,
        0.5 * float(truth.normal_n.sum()), pouring.weight_n, float(truth.wrench[2, 0]),
        pouring.flow_ml_per_s, 1e3 * vessel.flow_kg_per_s, pouring.poured_ml,
        station.true_poured_ml, station.shaking.frequency_hz, station.hand.lift_m,
        station.tilt_deg,
    ]  # fmt: skip
