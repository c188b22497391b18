"""The best settings of the baselines of `benchmarks.slip_baselines`, by a search.

Trials of seed `SEED`, which are none of those that `benchmarks.slip` reports. Of each baseline the
settings are sought by differential evolution within `RANGES`, so that the share of the slips that
are caught before they are gross is largest while no more than `FALSE_HOLDS` of the holds have an
alarm; of those that catch as many, the ones that alarm sooner.

    python -m benchmarks slip_search
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from benchmarks.slip_baselines import BASELINES, Baseline, Felt, feel
from benchmarks.slip_play import FIRST, GROSS, Trial
from benchmarks.slip_scenes import stage
from benchmarks.slip_seen import see

SEED = 1000
SLIPS, HOLDS = 120, 200
FALSE_HOLDS = 0.01
ROUNDS, CROWD = 16, 8
"""Of the search, and its population over the number of settings."""
SLOWEST_S = 1.0
"""A latency counts as this at most."""
RANGES = {
    "friction ratio": {"used": (0.3, 2.0), "lowpass_hz": (1.0, 100.0)},
    "band power": {
        "low_hz": (2.0, 90.0), "octaves": (0.3, 4.0), "span_s": (0.005, 0.5), "rise": (1.1, 100.0),
    },
    "light units' CUSUM": {
        "drift": (0.05, 30.0), "limit": (1.0, 1000.0), "lowpass_hz": (1.0, 100.0),
    },
}  # fmt: skip
"""Within which each setting is sought, in logarithm."""


@dataclass(frozen=True)
class Case:
    """What a baseline feels in a trial, and what is true of it.

    Attributes
    ----------
    felt : Felt
    time_s : ndarray, shape (t,)
    slips : bool
    first_s, gross_s : float
        When slip is there, and gross; infinite for never.
    """

    felt: Felt
    time_s: np.ndarray
    slips: bool
    first_s: float
    gross_s: float

    @classmethod
    def of(cls, trial: Trial) -> Case:
        """A trial as it is seen."""

        def when(share: float) -> float:
            true = trial.moving & (trial.share >= share)
            return float(trial.time_s[np.argmax(true)]) if true.any() else np.inf

        slips = trial.plan.kind == "slip"
        return cls(feel(trial, see(trial)), trial.time_s, slips, when(FIRST), when(GROSS))


def run(quick: bool) -> dict[str, Any]:
    """Play and search; the settings found, and what they reach on these trials."""
    part, rounds = (10, 4) if quick else (1, ROUNDS)
    cases = [
        Case.of(stage(SEED, kind, number))
        for kind, count in (("slip", SLIPS), ("hold", HOLDS))
        for number in range(count // part)
    ]
    return {name: search(name, cases, rounds) for name in BASELINES}


def search(name: str, cases: list[Case], rounds: int = ROUNDS) -> dict[str, Any]:
    """The best settings of a baseline, and its score in use and with those."""
    judge, now = BASELINES[name]
    ranges = RANGES[name]

    def settings(point: np.ndarray) -> dict[str, float]:
        return dict(zip(ranges, np.exp(point).tolist(), strict=True))

    found = differential_evolution(
        lambda point: cost(Baseline(judge, settings(point)), cases),
        np.log(np.array(list(ranges.values()))), maxiter=rounds, popsize=CROWD, seed=SEED,
        polish=False, x0=np.log([now[key] for key in ranges]), tol=0.0,
    )  # fmt: skip
    best = Baseline(judge, settings(found.x))
    return {
        "settings": best.settings,
        "best": scored(best, cases)._asdict(),
        "in_use": scored(BASELINES[name], cases)._asdict(),
    }


class Scored(NamedTuple):
    """Share of the gross slips caught, of the holds with an alarm, and the mean latency."""

    caught: float
    false_holds: float
    latency_s: float


def cost(baseline: Baseline, cases: list[Case]) -> float:
    """What is least at the best settings."""
    caught, false, latency_s = scored(baseline, cases)
    return -caught + 10.0 * max(0.0, false - FALSE_HOLDS) + 1e-3 * latency_s


def scored(baseline: Baseline, cases: list[Case]) -> Scored:
    """What a baseline reaches."""
    caught, false, late_s = [], [], []
    for case in cases:
        alarm = baseline(case.felt)
        alarm_s = float(case.time_s[np.argmax(alarm)]) if alarm.any() else np.inf
        if not case.slips:
            false.append(np.isfinite(alarm_s))
            continue
        late_s.append(min(abs(alarm_s - case.first_s), SLOWEST_S))
        if np.isfinite(case.gross_s):
            caught.append(case.first_s <= alarm_s < case.gross_s)
    return Scored(*(float(np.mean(each)) for each in (caught, false, late_s)))


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [f"{'':<20}{'caught':>8}{'holds':>8}{'ms':>6}   settings"]
    for name, row in figures.items():
        for which in ("in_use", "best"):
            values = row[which]
            told = row["settings"] if which == "best" else BASELINES[name].settings
            lines.append(
                f"{name:<20}{values['caught']:>8.1%}{values['false_holds']:>8.1%}"
                f"{1e3 * values['latency_s']:>6.0f}   "
                + ", ".join(f"{key} {value:.3g}" for key, value in told.items())
            )
    return "\n".join(lines)
