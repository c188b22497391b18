"""Play: a task on a station, with what was felt and what was true, a cycle after the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skin.tasks.runner import Action, Passed, Runner
from skin.tasks.station import Station
from skin.tasks.task import load_task

__all__ = ["Change", "Does", "Story", "play"]

LOGGED_EVERY = 5
"""Cycles from one row of the log to the next: 20 ms."""

COLUMNS = (
    "time_s", "inside_c", "sigma_c", "gel_c", "rate_c_per_s", "true_c", "true_rate_c_per_s",
    "load_n", "true_load_n", "weight_n", "true_weight_n", "flow_ml_per_s", "true_flow_ml_per_s",
    "poured_ml", "true_poured_ml", "frequency_hz", "lift_m", "tilt_deg",
)  # fmt: skip


class Change(NamedTuple):
    """A behaviour says something else than before."""

    time_s: float
    what: str


class Does(NamedTuple):
    """An action: a function of the station, the names of its numbers, and of those it needs."""

    run: Callable[[Station, float, dict[str, float]], None]
    numbers: tuple[str, ...] = ()
    needed: tuple[str, ...] = ()


@dataclass
class Story:
    """What happened.

    Attributes
    ----------
    outcome, why : str
        "done" or "failed", and of a failure, what began it.
    dropped : bool
    slid_m : float
    timeline : list of Passed
    phases, stages : list of Change
        As felt: heating and cooling, and flows.
    phases_began_s : list of float
        Of each phase: when the rate crossed zero, as told once it was sure.
    asked : list of Change
        What flame and tap were really set to: "flame" or "no flame", and flows in ml/s.
    shaken_hz : float
        Median of what was felt while it was shaken; NaN where it was not.
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


def play(
    station: Station, file: Path, does: Mapping[str, Does], *, pace: bool = False,
    most_s: float = 300.0,
) -> Story:  # fmt: skip
    """Play a task file on a station to its end."""
    task = load_task(
        file, fields=_examples(station),
        actions={name: do.numbers for name, do in does.items()},
        needed={name: do.needed for name, do in does.items()},
    )  # fmt: skip
    runner = Runner(task, station.feels(), _bound(station, does))
    story, rows = Story(), []
    shaken: list[float] = []
    began_s = time.monotonic()
    for count, state in enumerate(station.world):
        station.update(state)
        before = runner.step
        runner.update(station.time_s)
        if runner.step != before or runner.outcome:
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


def _examples(station: Station) -> dict[str, object]:
    """All fields, as they are now."""
    found: dict[str, object] = {}
    for field_name in station.known_fields():
        first, _, name = field_name.partition(".")
        found[field_name] = getattr(station.feels()[first], name)
    return found


def _bound(station: Station, does: Mapping[str, Does]) -> dict[str, Action]:
    def bind(do: Does) -> Action:
        return lambda seconds, values: do.run(station, seconds, values)

    return {name: bind(do) for name, do in does.items()}


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
    """Note what is felt, and what is asked, where it has changed."""
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
