"""Slips caught against false alarms, as a detector's level goes up and down.

`curve` scores a detector at several settings on the same trials. Trials are played from their seed,
which is none of those that `benchmarks.slip` reports, and are the same in every tree whose
simulator is: to score the detector of another commit, lay this folder beside its `skin`, `bus` and
`topology`. A setting that a detector has not is not varied.

    python -m benchmarks slip_curve --json
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import partial
from typing import Any

from benchmarks.slip_play import Trial
from benchmarks.slip_scenes import stage
from benchmarks.slip_scoring import Outcome, outcome, score
from benchmarks.slip_seen import see
from benchmarks.slip_watch import watch
from benchmarks.workers import in_parallel
from skin.contact.slip import SlipSettings

__all__ = ["LEVELS", "curve", "judged", "levels", "run", "table"]

SEED = 1000
TRIALS = {"slip": 100, "hold": 200, "modulation": 50}
FAMILIES = ("base", "light")
LEVELS = {
    "false_alarms_per_hour": (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0),
    "slip_sigmas": (3.0, 4.0, 5.0, 6.0, 7.0, 9.0, 12.0),
}
"""Of the first of these settings that the detector has."""


def levels() -> list[SlipSettings]:
    """Settings of the detector at hand, from one level to the other."""
    known = {field.name for field in fields(SlipSettings)}
    name = next(name for name in LEVELS if name in known)
    return [SlipSettings(**{name: value}) for value in LEVELS[name]]


def judged(trial: Trial, settings: Sequence[SlipSettings], *, draw: int = 0) -> list[Outcome]:
    """One trial at each of the settings, which see the same."""
    seen = see(trial, draw=draw)
    return [outcome(trial, *watch(trial, seen, each)) for each in settings]


def curve(
    trials: Sequence[tuple[str, str, int]], settings: Sequence[SlipSettings], *,
    seed: int = SEED,
) -> list[dict[str, Any]]:  # fmt: skip
    """Figures of a detector at each of the settings.

    Parameters
    ----------
    trials : sequence of (family, kind, number)
    settings : sequence of SlipSettings
    seed : int

    Returns
    -------
    list of dict
        As of `benchmarks.slip_scoring.score`, one of each setting.
    """
    judge = partial(_judge, seed=seed, settings=tuple(settings))
    rows = in_parallel(judge, trials, chunk=4)
    return [score(outcomes) for outcomes in zip(*rows, strict=True)]


def _judge(
    trial: tuple[str, str, int], *, seed: int, settings: Sequence[SlipSettings]
) -> list[Outcome]:
    family, kind, number = trial
    return judged(stage(seed, kind, number, family=family), settings)


def run(quick: bool) -> dict[str, Any]:
    """Curves of the detector at hand, of each of `FAMILIES`."""
    part, settings = (40 if quick else 1), levels()
    name = next(name for name in LEVELS if hasattr(settings[0], name))
    out: dict[str, Any] = {"level": name, "levels": [getattr(each, name) for each in settings]}
    for family in FAMILIES:
        trials = [(family, kind, i) for kind, count in TRIALS.items() for i in range(count // part)]
        out[family] = curve(trials, settings)
    return out


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [f"{figures['level']:>24}{'family':>10}{'caught':>10}{'first p90':>10}{'holds':>10}"
             f"{'a minute':>10}"]  # fmt: skip
    for family in FAMILIES:
        for level, row in zip(figures["levels"], figures[family], strict=True):
            minute = row["rates"]["false_alarms_per_minute"]["rate"]
            late = row["latency_ms_first_p90"]
            lines.append(
                f"{level:>24g}{family:>10}{row['caught_before_gross']:>10.1%}"
                f"{'-' if late is None else f'{late:.0f}':>10}{row['false_alarm_hold']:>10.1%}"
                f"{minute:>10.3g}"
            )
    return "\n".join(lines)
