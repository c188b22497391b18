"""Handovers: how soon a hand that takes is recognised, and what is taken for one.

Takes of people who differ in stiffness (60 to 600 N/m), approach (bumps and brushes before), speed,
share of the weight that they bear (0.8 to 1.3), sideways pull, tremor and where they hold on; 40 %
of them try with 10 to 35 % of the weight first, and let go. The truth's moment, from which latency
counts, is when the hand bears half of the weight and goes on to. Recognised: not before that
moment, within 1.5 s of it, and the block stays in the hand when the gripper has opened. Carrying:
up and down, with a bump, a brush or a short tug every second; every release is false.
Seeds from `REPORTED` on were not looked at while the model was made; those below 50 were.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.handover_trial import Carry, Take, run_carry, run_take
from benchmarks.intervals import per_minute, rate
from benchmarks.workers import in_parallel

REPORTED = 8000
EPISODE_S = 30.0
TAKES, CARRIES = 300, 120
AWAY = 500
"""Seeds of carrying begin so far behind those of takes."""


def run(quick: bool) -> dict[str, Any]:
    """Measure; see the module for what the figures are."""
    if quick:
        return score(2, 1, 5.0)
    return score(TAKES, CARRIES, EPISODE_S)


def score(taken: int, carried: int, episode_s: float) -> dict[str, Any]:
    """The figures of some takes and of some episodes of carrying."""
    first = REPORTED + AWAY
    takes = in_parallel(run_take, range(REPORTED, REPORTED + taken))
    carry = partial(run_carry, seconds=episode_s)
    carries = in_parallel(carry, range(first, first + carried))
    return {"seeds": len(takes) + len(carries), **_takes(takes), **_carries(carries)}


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    found, false = figures["recognised_share"], figures["false_releases_per_hour"]
    return "\n".join([
        f"takes: {found['rate']:.1%} recognised ({found['lower']:.1%} to {found['upper']:.1%} of "
        f"{found['trials']}), {figures['too_early']} too early, {figures['fallen']} fallen",
        f"latency {figures['latency_s_median']:.3f} s median, {figures['latency_s_p95']:.3f} s "
        f"at 95 %, {figures['latency_s_most']:.3f} s at most",
        f"carrying {figures['carried_s']:.0f} s with {figures['bumps']} bumps, "
        f"{figures['brushes']} brushes and {figures['tugs']} tugs: {figures['false_releases']} "
        f"false releases, at most {false['upper']:.1f} an hour",
        f"{figures['us_per_cycle']:.0f} us a cycle",
    ])  # fmt: skip


def _takes(takes: list[Take]) -> dict[str, Any]:
    latency = np.array([t.latency_s if t.recognised else np.inf for t in takes])
    return {
        "recognised_share": rate(sum(t.recognised for t in takes), len(takes)),
        "latency_s_median": float(np.median(latency)),
        "latency_s_p95": float(np.quantile(latency, 0.95, method="higher")),
        "latency_s_most": float(latency[np.isfinite(latency)].max(initial=0.0)),
        "too_early": sum(t.too_early for t in takes),
        "fallen": sum(t.taken_s == t.taken_s and not t.moved_m < 0.05 for t in takes),
        "us_per_cycle": float(np.median([us for t in takes for us in t.update_us])),
    }


def _carries(carries: list[Carry]) -> dict[str, Any]:
    seconds, false = sum(c.seconds for c in carries), sum(len(c.released) for c in carries)
    minutes = per_minute(false, seconds)
    assert minutes is not None
    hours = {name: value * 60.0 for name, value in minutes.items() if name != "minutes"}
    return {
        "carried_s": seconds,
        "bumps": sum(c.bumps for c in carries),
        "brushes": sum(c.brushes for c in carries),
        "tugs": sum(c.tugs for c in carries),
        "false_releases": false,
        "false_releases_per_hour": hours | {"hours": seconds / 3600.0},
        "false_why": [why for c in carries for why in c.released],
    }
