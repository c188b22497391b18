"""Temperature of what is held: phases, band, limit, in the PVA story on seeds not looked at before.

`turn_delay_s` is from when the water's true rate changes its sign to when the behaviour says so,
`turn_within_1s` its share within a second; `onset_error_s` compares when it says that it began.
`band_alarm_error_c` is how far the truth is from the band's end where leaving it is told,
`limit_alarm_c` how warm the water is where the limit of 90 °C is told while the flame stays on.
`frequency_error_hz` is of what is felt while the hand shakes at 1 Hz. Flames, beakers, walls, gains
of units and noise are drawn by seed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.behaviours_cost import microseconds
from benchmarks.slip_intervals import rate
from benchmarks.workers import in_parallel
from skin.behaviours.warmth import Warmth
from skin.demos.play import Story
from skin.demos.pva import pva_script, run_pva
from topology import load

REPORTED = 18_000
"""First seed that is scored: those below 1000 were developed on."""

RUNS, STUCK_RUNS = 20, 10
START_C, STUCK_START_C = 52.0, 70.0
"""Of the water, which shortens the story."""

BAND_LOW_C, LIMIT_C = 60.0, 90.0
TURN_S = 4.0
"""From a true turn, in which it must be told."""


def run(quick: bool) -> dict[str, Any]:
    """Measure; see the module for what the figures are."""
    counts = (1, 0) if quick else (RUNS, STUCK_RUNS)
    jobs = [(REPORTED + k, False) for k in range(counts[0])]
    jobs += [(REPORTED + 500 + k, True) for k in range(counts[1])]
    found = in_parallel(_judge, jobs)
    told = [one for one in found if not one["stuck"]]
    stuck = [one for one in found if one["stuck"]]
    delays = np.array([delay for one in told for delay in one["delays_s"]])
    onsets = np.array([error for one in told for error in one["onsets_s"]])
    bands = np.array([one["band_error_c"] for one in told])
    hertz = np.array([one["frequency_error_hz"] for one in told])
    limits = np.array([one["limit_c"] for one in stuck])
    dropped = sum(one["dropped"] for one in found)
    return {
        "seeds": len(found),
        "first_seed": REPORTED,
        "done": rate(sum(one["done"] for one in told), len(told)),
        "dropped": dropped,
        "dropped_rate": rate(dropped, len(found)),
        "turns": len(delays),
        "turn_delay_s_median": _or_none(np.nanmedian, delays),
        "turn_delay_s_p95": _or_none(lambda v: np.nanpercentile(v, 95), delays),
        "turn_within_1s": rate(int((np.abs(delays) <= 1.0).sum()), len(delays)),
        "onset_within_1s": rate(int((np.abs(onsets) <= 1.0).sum()), len(onsets)),
        "false_turns": sum(one["false_turns"] for one in told),
        "seconds": sum(one["seconds"] for one in told),
        "band_alarm_error_c_worst": _or_none(lambda v: np.nanmax(np.abs(v)), bands),
        "band_alarm_within_1c": rate(int((np.abs(bands) <= 1.0).sum()), len(bands)),
        "limit_alarm_c_worst": _or_none(np.nanmax, limits),
        "limit_alarm_in_time": rate(int((limits < LIMIT_C).sum()), len(limits)),
        "frequency_error_hz_worst": _or_none(lambda v: np.nanmax(np.abs(v)), hertz),
        "frequency_within_20mhz": rate(int((np.abs(hertz) <= 0.02).sum()), len(hertz)),
        "temperature_rmse_c": _rms([one["rmse_c"] for one in told]),
        "within_2_sigma": _or_none(np.nanmean, [one["within_2_sigma"] for one in told]),
        **microseconds(Warmth(load("gripper"))),
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    told = figures
    return "\n".join([
        f"temperature: {told['seeds']} runs, {told['dropped']} dropped; "
        f"done {_share(told['done'])}",
        f"  turns of heating and cooling: {told['turns']}, told after "
        f"{_number(told['turn_delay_s_median'])} s median, "
        f"{_number(told['turn_delay_s_p95'])} s p95; within 1 s "
        f"{_share(told['turn_within_1s'])}, onset {_share(told['onset_within_1s'])}; "
        f"false {told['false_turns']} in {told['seconds']:.0f} s",
        f"  band left, told within 1 °C of it: {_share(told['band_alarm_within_1c'])}, worst "
        f"{_number(told['band_alarm_error_c_worst'])} °C; limit told in time "
        f"{_share(told['limit_alarm_in_time'])}, worst at "
        f"{_number(told['limit_alarm_c_worst'])} °C",
        f"  1 Hz within 0.02 Hz: {_share(told['frequency_within_20mhz'])}, worst "
        f"{_number(told['frequency_error_hz_worst'])} Hz off",
        f"  temperature within: {_number(told['temperature_rmse_c'])} °C rms off, "
        f"{_number(told['within_2_sigma'])} within 2 sigma; {told['us_median']:.1f} µs a cycle",
    ])  # fmt: skip


def _judge(job: tuple[int, bool]) -> dict[str, Any]:
    """One run, against its truth."""
    seed, stuck = job
    if stuck:
        script = pva_script(hot=("warmth.inside_c", ">=", 200.0))
    else:
        left = (("warmth.inside_c", "<=", 63.0), ("warmth.in_band", "==", False))
        script = pva_script(cool=left, rounds=1)
    _, story = run_pva(seed, script=script, water_c=STUCK_START_C if stuck else START_C)
    delays, onsets, false_turns = _turns(story)
    heat_ends = [passed.ended_s for passed in story.timeline if passed.name == "heat"]
    shake_ends = [passed.ended_s for passed in story.timeline if passed.name == "shake"]
    time_s, truth = story.column("time_s"), story.column("true_c")
    off, sigma = story.column("inside_c") - truth, story.column("sigma_c")
    lifted = [passed.ended_s for passed in story.timeline if passed.name == "lift"]
    late = time_s > (lifted[0] if lifted else np.inf)
    at_end = float(np.interp(shake_ends[0], time_s, truth)) if shake_ends else np.nan
    return {
        "stuck": stuck,
        "done": story.outcome == "done",
        "dropped": story.dropped,
        "delays_s": delays,
        "onsets_s": onsets,
        "false_turns": false_turns,
        "seconds": float(time_s[-1]),
        "band_error_c": at_end - BAND_LOW_C,
        "limit_c": float(np.interp(heat_ends[0], time_s, truth)) if heat_ends else np.nan,
        "frequency_error_hz": story.shaken_hz - 1.0,
        "rmse_c": float(np.sqrt(np.mean(off[late] ** 2))) if late.any() else np.nan,
        "within_2_sigma": float(np.mean(np.abs(off[late]) < 2.0 * sigma[late])),
    }


def _turns(story: Story) -> tuple[list[float], list[float], int]:
    """Delays and errors of onset of the true turns while it is heated and shaken, and changes of
    phase that answer none."""
    steps = [passed for passed in story.timeline if passed.name in ("heat", "shake")]
    if not steps:
        return [], [], 0
    first_s, last_s = steps[0].began_s, steps[-1].ended_s
    time_s, true_rate = story.column("time_s"), story.column("true_rate_c_per_s")
    turns = []
    for step in steps:
        sign = 1.0 if step.name == "heat" else -1.0
        after = (time_s >= step.began_s) & (sign * true_rate > 0.0)
        turns.append((float(time_s[after][0]), "heating" if sign > 0.0 else "cooling"))
    told = [(change.time_s, change.what, began_s) for change, began_s in
            zip(story.phases, story.phases_began_s, strict=True)
            if first_s <= change.time_s <= last_s]  # fmt: skip
    delays, onsets, used = [], [], set()
    for turn_s, what in turns:
        answers = [(at_s, began_s) for at_s, name, began_s in told
                   if name == what and -0.2 <= at_s - turn_s <= TURN_S]  # fmt: skip
        delays.append(answers[0][0] - turn_s if answers else np.nan)
        onsets.append(answers[0][1] - turn_s if answers else np.nan)
        if answers:
            used.add(answers[0][0])
    return delays, onsets, sum(at_s not in used for at_s, _, _ in told)


def _or_none(of: Any, values: np.ndarray) -> float | None:
    return float(of(values)) if np.isfinite(values).any() else None


def _rms(values: list[float]) -> float | None:
    """Of runs that came so far."""
    return _or_none(lambda v: np.sqrt(np.nanmean(v)), np.square(values))


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.3f}"


def _share(found: dict[str, float] | None) -> str:
    if found is None:
        return "none"
    return (f"{found['rate']:.1%} ({found['lower']:.1%} to {found['upper']:.1%} of "
            f"{found['trials']:.0f})")  # fmt: skip
