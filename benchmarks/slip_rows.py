"""The rows of `benchmarks.slip`: which trials are played, how they are seen, who judges them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from benchmarks.slip_baselines import BASELINES, feel
from benchmarks.slip_families import FAMILIES
from benchmarks.slip_play import lasting
from benchmarks.slip_scenes import KINDS, stage
from benchmarks.slip_scoring import Outcome, outcome
from benchmarks.slip_seen import SIGHTS, see
from benchmarks.slip_watch import Watched, listen

__all__ = ["FEW_ROW", "Counts", "Found", "Job", "jobs", "judge"]

FEW_ROW = "three to five units"


@dataclass(frozen=True, kw_only=True)
class Counts:
    """How many trials of each kind.

    Attributes
    ----------
    base : dict of str to int
        Of the base, judged by the detector.
    others : int
        Of these, so many by the baselines and other estimators.
    robust : dict of str to int
        Of each further family; of the base, so many in each sight.
    few : int
        With three to five units.
    """

    base: dict[str, int]
    others: int
    robust: dict[str, int]
    few: int


@dataclass(frozen=True)
class Job:
    """One trial and the rows in which it is judged.

    Attributes
    ----------
    seed : int
    family, kind : str
    number : int
    few : bool
    others : bool
        By the baselines and other estimators.
    sights : bool
    """

    seed: int
    family: str
    kind: str
    number: int
    few: bool = False
    others: bool = False
    sights: bool = False


@dataclass
class Found:
    """What one trial has given.

    Attributes
    ----------
    outcomes : dict of str to Outcome
        By row.
    seconds, cycles
        That the detector took.
    """

    outcomes: dict[str, Outcome] = field(default_factory=dict)
    seconds: float = 0.0
    cycles: int = 0


def jobs(seed: int, counts: Counts) -> Iterator[Job]:
    """All trials, the long ones first."""
    for family in sorted(FAMILIES, key=lambda name: -FAMILIES[name].longest_s):
        if family == "base":
            continue
        for kind in KINDS:
            for i in range(counts.robust[kind]):
                yield Job(seed, family, kind, i)
    for kind in KINDS:
        for i in range(counts.base[kind]):
            yield Job(
                seed, "base", kind, i, others=i < counts.others, sights=i < counts.robust[kind]
            )
        for i in range(counts.few):
            yield Job(seed, "base", kind, i, few=True)


def judge(job: Job) -> Found:
    """Play one trial and let every detector judge it."""
    trial = stage(job.seed, job.kind, job.number, family=job.family, few=job.few)
    found, seen = Found(cycles=len(trial.time_s)), see(trial)
    started = time.perf_counter()
    first = listen(trial, seen)
    found.seconds = time.perf_counter() - started

    def put(row: str, watched: Watched) -> None:
        found.outcomes[row] = outcome(trial, watched.alarm, watched.friction)

    if job.few:
        put(FEW_ROW, first)
        return found
    put("displacement" if job.family == "base" else job.family, first)
    if job.others:
        put("sine law", listen(trial, see(trial, "sine")))
        put("cross-talk left", listen(trial, see(trial, residue=1.0)))
        felt = feel(trial, seen)
        for name, baseline in BASELINES.items():
            found.outcomes[name] = outcome(trial, baseline(felt))
    if job.sights:
        for name, sight in SIGHTS.items():
            long = trial if job.kind == "slip" else lasting(trial, sight.lasts_s)
            found.outcomes[name] = outcome(long, listen(long, see(long, sight=sight)).alarm)
    return found
