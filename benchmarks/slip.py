"""Slip: how soon it is seen, and how often where there is none, beside the usual detectors.

Bodies press, slide and turn on flat and curved skins, by a physics of which the detector knows
nothing (`benchmarks.slip_play`, `benchmarks.slip_seen`). The base: 300 slips, 5000 holds and 300
grips that come and go by 10 to 30 %, at 250 Hz, friction 0.3 to 0.9, the fastest face at 0.5 to
10 mm/s, 45 % of them turning, six or more units in contact; 60 of each kind with three to five.
Every trial is a draw and a simulation of its own. Trials of seeds 1 to 16, 18 to 86 and 1000 to
1099 were looked at while detectors were made; those reported are of another, `REPORTED`.

Truth: a face slips while the body moves over it (by more than 1 nm in a cycle). `share` is the
share of the load on faces that have slipped since the motion began, or since they were touched.

- An *alarm* is the moment when a detector goes from "sticks" to "slips", incipient or gross.
- Slip is *there* from 2 % of the load on, its *onset* is at 10 %, it is *gross* at 95 %.
- `caught_before_gross`: share of the slips that become gross, whose first alarm after the motion
  began came when slip was there and before it was gross. `caught_with_warning`: the same of those
  with at least 40 ms from onset to gross.
- `latency_ms_first_*`: from when slip is there to the first alarm, over all slips; `latency_ms_*`:
  from onset. No alarm is infinitely late, an alarm before is early by a negative time. `way_um_*`:
  how far the fastest face has come since onset.
- `lead_ms_median`: from a true alarm to gross slip, over all slips that become gross; 0 where it
  came too late.
- `premature`: share of the slips with an alarm before slip was there, be it on the way down.
- `false_alarm_hold_rate`, `false_alarm_modulation`: share of the trials in which slip never was
  there with an alarm all the same, on the way down included. What is held stops at 10 to 90 % of
  the way on which slip begins. `false_alarms_per_minute`: of held contact, of both kinds; alarms
  that come and go count each.
- `friction_error_median`: of the estimate 0.2 s after the alarm, against the mean coefficient of
  faces in motion, which is 0 to 20 % below the one at rest; `friction_known`: share of the alarms
  after which there is an estimate.

Each share has the 95 % interval of Clopper and Pearson, each count a minute that of Garwood
(`benchmarks.slip_intervals`).

The rows: the detector on displacements from the field's angle, from the paper's sine law, and with
neighbours' stray fields left in; and three others, which are told when the motion begins, at their
best settings (`benchmarks.slip_baselines`). `slip_robust` has the families of
`benchmarks.slip_families` and, of trials of the base, the sights of `benchmarks.slip_seen`.
"""

from __future__ import annotations

from typing import Any

from benchmarks.slip_baselines import BASELINES
from benchmarks.slip_rows import Counts, Found, Job, jobs, judge
from benchmarks.slip_scoring import Outcome, score
from benchmarks.slip_watch import watch
from benchmarks.workers import in_parallel

__all__ = ["run", "table", "watch"]

REPORTED = 2001
"""Seed."""
WHOLE = Counts(
    base={"slip": 300, "hold": 5000, "modulation": 300}, others=150,
    robust={"slip": 60, "hold": 100, "modulation": 20}, few=60,
)  # fmt: skip
QUICK = Counts(
    base={"slip": 15, "hold": 40, "modulation": 10}, others=10,
    robust={"slip": 2, "hold": 2, "modulation": 1}, few=2,
)  # fmt: skip

TARGETS = {
    "caught_before_gross": 0.97, "latency_ms_first_median": 60.0, "latency_ms_first_p90": 150.0,
    "latency_ms_p90": 60.0, "premature": 0.02, "false_alarm_hold": 0.001,
    "false_alarm_modulation": 0.02, "friction_error_median": 0.1,
}  # fmt: skip
COLUMNS = {
    "caught_before_gross": "caught", "caught_with_warning": "warned",
    "latency_ms_first_median": "first med", "latency_ms_first_p90": "first p90",
    "latency_ms_median": "ms median", "latency_ms_p90": "ms p90", "lead_ms_median": "lead ms",
    "premature": "premature", "false_alarm_hold": "hold", "false_alarm_modulation": "grip",
    "friction_error_median": "friction", "slips": "slips", "holds": "holds",
}  # fmt: skip
"""Figures of a row, and what the table calls them."""
PLAIN = ("displacement", "sine law", "cross-talk left", *BASELINES, "three to five units")
"""Rows that are not of `slip_robust`."""


def run(quick: bool) -> dict[str, Any]:
    """Measure; see the module for what the figures are."""
    counts = QUICK if quick else WHOLE
    return figures_of(judged(counts))


def judged(counts: Counts) -> list[Found]:
    """What all trials have given."""
    judge(Job(REPORTED, "base", "hold", 0, others=True))  # compile what workers inherit
    return in_parallel(judge, jobs(REPORTED, counts), chunk=4)


def figures_of(found: list[Found]) -> dict[str, Any]:
    """All figures of the trials."""
    rows: dict[str, list[Outcome]] = {}
    for one in found:
        for name, result in one.outcomes.items():
            rows.setdefault(name, []).append(result)
    detectors = {name: score(results) for name, results in rows.items()}
    headline = detectors["displacement"]
    rates = headline["rates"]
    return {
        **{name: headline[name] for name in COLUMNS},
        "false_alarm_hold_rate": rates["false_alarm_hold"],
        "false_alarms_per_minute": rates["false_alarms_per_minute"],
        "friction_known": headline["friction_known"],
        "us_per_cycle": 1e6 * sum(f.seconds for f in found) / sum(f.cycles for f in found),
        "targets": TARGETS,
        "seed": REPORTED,
        "detectors": {name: detectors[name] for name in PLAIN if name in detectors},
        "slip_robust": {name: row for name, row in detectors.items() if name not in PLAIN},
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [f"{'':<24}" + "".join(f"{head:>10}" for head in COLUMNS.values())]

    def row(name: str, values: dict[str, Any]) -> None:
        cells = [_cell(column, values.get(column)) for column in COLUMNS]
        lines.append(f"{name:<24}" + "".join(f"{cell:>10}" for cell in cells))

    for name, values in figures["detectors"].items():
        row(name, values)
    for name, values in figures["slip_robust"].items():
        row(name, values)
    row("target", figures["targets"])
    hold, minute = figures["false_alarm_hold_rate"], figures["false_alarms_per_minute"]
    lines += [
        f"false alarms of the base: {hold['rate']:.3%} of {hold['trials']} holds "
        f"({hold['lower']:.3%} to {hold['upper']:.3%}); {minute['rate']:.3g} a minute "
        f"({minute['lower']:.3g} to {minute['upper']:.3g}) in {minute['minutes']:.0f} minutes",
        f"shares of trials; -: never, or not asked; {figures['us_per_cycle']:.0f} us a cycle, "
        "Python included",
    ]
    return "\n".join(lines)


def _cell(column: str, value: float | None) -> str:
    if value is None:
        return "-"
    if column.startswith(("latency", "lead", "slips", "holds")):
        return f"{value:.0f}"
    return f"{value:.1%}"
