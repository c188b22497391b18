"""The rows of `benchmarks.slip`: which trials are played, how they are seen, who judges them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from benchmarks.slip_baselines import BASELINES, feel
from benchmarks.slip_calibration import Gripped, Told, gripped, told
from benchmarks.slip_chain import chain_of
from benchmarks.slip_families import FAMILIES
from benchmarks.slip_matched import matched
from benchmarks.slip_play import SKINS, lasting
from benchmarks.slip_scenes import KINDS, stage
from benchmarks.slip_scoring import Outcome, outcome
from benchmarks.slip_seen import SIGHTS, see
from benchmarks.slip_watch import Watched, listen

__all__ = ["BOUND", "BOUNDED", "FEW_ROW", "Counts", "Found", "Job", "jobs", "judge", "warm"]

FEW_ROW, BOUND = "three to five units", "bound: "
BOUNDED = ("base", "light", "soft", "fast", "slow")
"""Families beside whose row stands the bound that physics sets."""


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
    few, chain : int
        With three to five units; of the base, through the chain.
    chain_side : int
        Units on the bench are a square of it.
    """

    base: dict[str, int]
    others: int
    robust: dict[str, int]
    few: int
    chain: int
    chain_side: int = 4


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
        By the baselines, other estimators, and for calibration.
    sights : bool
    chain_side : int
        Through the chain; 0: not.
    """

    seed: int
    family: str
    kind: str
    number: int
    few: bool = False
    others: bool = False
    sights: bool = False
    chain_side: int = 0


@dataclass
class Found:
    """What one trial has given.

    Attributes
    ----------
    outcomes : dict of str to Outcome
        By row.
    seconds, cycles
        That the detector took.
    told, gripped
        For calibration.
    """

    outcomes: dict[str, Outcome] = field(default_factory=dict)
    seconds: float = 0.0
    cycles: int = 0
    told: Told | None = None
    gripped: Gripped | None = None


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
            side = counts.chain_side if i < counts.chain else 0
            yield Job(
                seed, "base", kind, i, others=i < counts.others, sights=i < counts.robust[kind],
                chain_side=side,
            )  # fmt: skip
        for i in range(counts.few):
            yield Job(seed, "base", kind, i, few=True)


def warm(seed: int, counts: Counts) -> None:
    """Compile and make what workers inherit."""
    if counts.chain:
        for name in SKINS:
            chain_of(name, counts.chain_side)
    side = counts.chain_side if counts.chain else 0
    judge(Job(seed, "base", "hold", 0, others=True, chain_side=side))


def judge(job: Job) -> Found:
    """Play one trial and let every detector judge it."""
    trial = stage(job.seed, job.kind, job.number, family=job.family, few=job.few)
    found, seen = Found(cycles=len(trial.time_s)), see(trial)
    started = time.perf_counter()
    first = listen(trial, seen)
    found.seconds = time.perf_counter() - started

    def put(row: str, watched: Watched) -> Outcome:
        found.outcomes[row] = outcome(trial, watched.alarm, watched.friction)
        return found.outcomes[row]

    if job.few:
        put(FEW_ROW, first)
        return found
    row = "displacement" if job.family == "base" else job.family
    one = put(row, first)
    if job.family in BOUNDED and job.kind == "slip" and (job.family != "base" or job.sights):
        found.outcomes[BOUND + row] = outcome(trial, matched(trial, seen))
    if job.others:
        found.told, found.gripped = told(trial, first), gripped(trial, first, one)
        put("sine law", listen(trial, see(trial, "sine")))
        put("cross-talk left", listen(trial, see(trial, residue=1.0)))
        felt = feel(trial, seen)
        for name, baseline in BASELINES.items():
            found.outcomes[name] = outcome(trial, baseline(felt))
    if job.sights:
        for name, sight in SIGHTS.items():
            long = trial if job.kind == "slip" else lasting(trial, sight.lasts_s)
            found.outcomes[name] = outcome(long, listen(long, see(long, sight=sight)).alarm)
    if job.chain_side:
        found.outcomes["direct"] = one
        put("chain", listen(trial, chain_of(trial.plan.skin, job.chain_side).decode(trial)))
    return found
