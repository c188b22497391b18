"""Gestures of people on what a gripper holds, and on a bare skin: which, whereto, how sure.

`directions`: pulls of 8 directions and 3 strengths (`STRENGTHS_N`), each person on an object of its
own; right is a pull within 22.5 degrees of the true direction. `held`, `touch`: what is told (down)
of what is done (across), where nothing is told `none`. `told_s`: from the begin of a gesture to the
first time that its kind is told. Seeds from `REPORTED` on were not looked at while densities were
chosen; those below 50 were.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from benchmarks.intervals import per_minute, rate
from benchmarks.touch_trial import TOUCH_KINDS, run_touches
from benchmarks.workers import in_parallel
from fig4b_gestures import Asked, Trial
from fig4b_gestures import run as run_trial
from shared.people import brush, bump, pull

REPORTED = 8000
KINDS = ("tap", "brush", "press", "pull", "twist")
STRENGTHS_N = (0.5, 1.0, 2.0)
"""Of pulls, as in the paper's Fig. 4c."""
SECTOR_RAD = math.pi / 8.0


def run(quick: bool) -> dict[str, Any]:
    """Measure; see the module for what the figures are."""
    return score(1, 1, 1) if quick else score(20, 12, 2)


def score(people: int, mixed: int, each: int) -> dict[str, Any]:
    """The figures of so many people by strength of pull, and so many who do each kind of gesture so
    often."""
    jobs = [("pulls", REPORTED + seed, i) for seed in range(people)
            for i in range(len(STRENGTHS_N))]  # fmt: skip
    jobs += [("held", REPORTED + 100 + seed, each) for seed in range(mixed)]
    jobs += [("touch", REPORTED + 200 + seed, each) for seed in range(mixed)]
    trials = in_parallel(_play, jobs)
    by = {kind: [t for t, job in zip(trials, jobs, strict=True) if job[0] == kind]
          for kind in ("pulls", "held", "touch")}  # fmt: skip
    rested_s = sum(_rested_s(trial) for trial in by["pulls"] + by["held"])
    return {
        "seeds": len({job[:2] for job in jobs}),
        **_directions(by["pulls"]),
        "held": _confusion(by["held"], KINDS),
        "touch": _confusion(by["touch"], TOUCH_KINDS),
        "told_s_median": float(np.nanmedian(
            [seen.first_s for trial in trials for seen in trial.seen])),
        "false_per_minute": per_minute(
            sum(len(trial.others) for trial in by["pulls"] + by["held"]), rested_s),
        "us_per_cycle": float(np.median([us for trial in by["pulls"] for us in trial.update_us])),
    }  # fmt: skip


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [
        f"pulls: {_shown(figures['right_share'])} right, direction "
        f"{figures['direction_rms_deg']:.2f} degrees rms"
    ]
    for where in ("held", "touch"):
        confusion = figures[where]["confusion"]
        names = [*confusion, "none"]
        lines.append(f"{where + ', done':<14}" + "".join(f"{name:>8}" for name in names))
        lines += [
            f"  {name:<12}" + "".join(f"{row.get(told, 0):>8}" for told in names)
            for name, row in confusion.items()
        ]
        lines.append(f"  right {_shown(figures[where]['right_share'])}")
    lines.append(
        f"told {figures['told_s_median']:.3f} s after the begin, "
        f"{figures['us_per_cycle']:.0f} us a cycle"
    )
    return "\n".join(lines)


def asked_pulls(random: np.random.Generator, strength_n: float) -> list[Asked]:
    """Pulls in eight directions, in random order, each up to 22.5 degrees off."""
    found = []
    for k in random.permutation(8):
        angle = math.radians(45.0 * float(k))
        size = strength_n * float(random.uniform(0.9, 1.1))
        force = size * np.array([0.0, math.cos(angle), math.sin(angle)])
        found.append(Asked("pull", angle, pull(force, **_course(random))))
    return found


def asked_kinds(random: np.random.Generator, each: int = 2) -> list[Asked]:
    """Taps, brushes, presses, pulls and twists, some of each, in random order."""
    found = [_draw(kind, random) for kind in KINDS for _ in range(each)]
    return [found[i] for i in random.permutation(len(found))]


def _course(random: np.random.Generator) -> dict[str, float]:
    return {
        "rise_s": float(random.uniform(0.08, 0.4)),
        "hold_s": float(random.uniform(0.1, 0.8)),
        "fall_s": float(random.uniform(0.08, 0.3)),
    }


def _draw(kind: str, random: np.random.Generator) -> Asked:
    """A gesture of a kind, with random strength and direction in the range of hands."""
    angle = float(random.uniform(-math.pi, math.pi))
    across = np.array([0.0, math.cos(angle), math.sin(angle)])
    along = np.array([float(random.choice([-1.0, 1.0])), 0.0, 0.0])
    tilted = across + np.array([0.15 * random.normal(), 0.0, 0.0])
    if kind == "tap":
        is_across = random.random() < 0.5
        force = float(random.uniform(0.8, 4.0)) * (across if is_across else along)
        return Asked(kind, angle if is_across else math.nan,
                     bump(force, float(random.uniform(0.02, 0.07))))  # fmt: skip
    if kind == "brush":
        force = float(random.uniform(0.15, 0.4)) * tilted
        return Asked(kind, angle, brush(force, float(random.uniform(0.05, 0.3))))
    if kind == "press":
        force = float(random.uniform(0.7, 3.0)) * (along + 0.1 * random.normal() * across)
        return Asked(kind, math.nan, pull(force, **_course(random)))
    if kind == "twist":
        axis = random.normal(size=3)
        moment = float(random.uniform(0.02, 0.06)) * axis / np.linalg.norm(axis)
        return Asked(kind, math.nan, pull(moment_nm=moment, **_course(random)))
    force = float(random.uniform(0.5, 2.5)) * tilted
    return Asked(kind, angle, pull(force, **_course(random)))


def _play(job: tuple[str, int, int]) -> Trial:
    kind, seed, count = job
    if kind == "pulls":
        strength_n = STRENGTHS_N[count]
        return run_trial(3 * seed + count, partial(asked_pulls, strength_n=strength_n))
    if kind == "held":
        return run_trial(seed, partial(asked_kinds, each=count))
    return run_touches(seed, count)


def _directions(trials: list[Trial]) -> dict[str, Any]:
    every = [seen for trial in trials for seen in trial.seen]
    off = np.degrees([seen.off_rad for seen in every])
    right = sum(seen.is_right and abs(seen.off_rad) < SECTOR_RAD for seen in every)
    return {
        "right_share": rate(right, len(every)),
        "direction_rms_deg": float(np.sqrt(np.nanmean(off**2))),
    }


def _confusion(trials: list[Trial], kinds: tuple[str, ...]) -> dict[str, Any]:
    every = [seen for trial in trials for seen in trial.seen]
    rows: dict[str, dict[str, int]] = {kind: {} for kind in kinds}
    for seen in every:
        told = "none" if seen.reported is None else seen.reported.kind.replace("push", "pull")
        row = rows[seen.asked.kind]
        row[told] = row.get(told, 0) + 1
    return {
        "confusion": rows,
        "right_share": rate(sum(seen.is_right for seen in every), len(every)),
    }


def _rested_s(trial: Trial) -> float:
    return trial.rows[-1][0] - sum(seen.asked.act.seconds for seen in trial.seen)


def _shown(found: dict[str, float] | None) -> str:
    if found is None:
        return "none"
    return (
        f"{found['rate']:.1%} ({found['lower']:.1%} to {found['upper']:.1%} of {found['trials']})"
    )
