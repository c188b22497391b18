"""How good alarms are against labels: caught, how late, and how often where nothing slips.

- A *slip* is a time that is labelled so; two that are less than `JOIN_S` from each other are one.
  One that is there from the first sample has no onset, and is left out.
- An *alarm* is the moment when a detector goes from "sticks" to "slips".
- A slip is *caught* if an alarm comes before it ends, and `EARLY_S` before its onset at the
  earliest: labels that hands set are no better. An alarm that is on already is none.
- *Latency* is from the label's onset to the first such alarm; a slip that is not caught is
  infinitely late. It may be negative.
- `caught_before_gross`: of the slips of which the file says when all pillars had slipped.
- A *false alarm* comes in a time labelled as hold, more than `EARLY_S` from a slip. Its rate is
  over all such time, whether something touches or not: files do not say it.

Intervals are of 95 %: after Wilson for shares, after Garwood for rates, from order statistics for
the median. They take slips, and false alarms, for independent; slips of one object in one pose are
alike, so that the true ones are wider.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from benchmarks.recorded.detect import runs
from benchmarks.recorded.recording import Label, Recording

__all__ = ["Verdict", "at_most", "judge", "score"]

JOIN_S = 0.1
"""[assumed] second."""
EARLY_S = 0.1
"""[assumed] second: how exact labels are that were set by hand."""
LIMITS = 60
"""Limits tried of a detector whose limit is found in hindsight."""


@dataclass(frozen=True)
class Verdict:
    """What one recording says of a detector.

    Attributes
    ----------
    latency_s : tuple of float
        Of each slip; infinite where no alarm came.
    before_gross : tuple of bool
        Of the slips that are known to become gross: whether the alarm came before.
    false : int
        Alarms.
    hold_s : float
        Second: time in which an alarm is false.
    """

    latency_s: tuple[float, ...]
    before_gross: tuple[bool, ...]
    false: int
    hold_s: float


def judge(recording: Recording, alarm: np.ndarray) -> Verdict:
    """Hold alarms against labels.

    Parameters
    ----------
    recording : Recording
    alarm : ndarray, shape (t,), bool
    """
    time_s = recording.time_s
    rises_s = time_s[alarm & ~np.concatenate([[False], alarm[:-1]])]
    near = np.zeros(time_s.size, bool)
    latency: list[float] = []
    before: list[bool] = []
    for begin, end in _slips(recording):
        first_s, last_s = time_s[begin], time_s[end - 1]
        near |= (time_s >= first_s - EARLY_S) & (time_s <= last_s + EARLY_S)
        if begin == 0:
            continue
        of_it = rises_s[(rises_s >= first_s - EARLY_S) & (rises_s <= last_s)]
        late_s = float(of_it[0] - first_s) if of_it.size else np.inf
        latency.append(late_s)
        if recording.gross is not None and recording.gross[begin:end].any():
            gross_s = time_s[begin + int(np.argmax(recording.gross[begin:end]))]
            before.append(first_s + late_s < gross_s)
    holds = (recording.label == Label.HOLD) & ~near
    step_s = np.append(np.diff(time_s), 0.0)
    false = int(np.isin(rises_s, time_s[holds]).sum())
    return Verdict(tuple(latency), tuple(before), false, float(step_s[holds].sum()))


def score(verdicts: Sequence[Verdict]) -> dict[str, object]:
    """Figures of many recordings, rates as `rate`, `lower` and `upper`; None: nothing to tell, and
    for latencies: never."""
    late_s = sorted(late for one in verdicts for late in one.latency_s)
    before = [hit for one in verdicts for hit in one.before_gross]
    quiet = [one for one in verdicts if not one.latency_s and one.hold_s > 0.0]
    minutes = sum(one.hold_s for one in verdicts) / 60.0
    return {
        "caught": _share(sum(np.isfinite(late_s)), len(late_s)),
        "caught_before_gross": _share(sum(before), len(before)),
        "latency_ms_median": _median(late_s),
        "latency_ms_p90": _milliseconds(
            float(np.quantile(late_s, 0.9, method="higher")) if late_s else np.inf
        ),
        "false_alarms_per_minute": _rate(sum(one.false for one in verdicts), minutes),
        "quiet_recordings_with_alarm": _share(sum(one.false > 0 for one in quiet), len(quiet)),
        "slips": len(late_s),
        "gross": len(before),
        "recordings": len(verdicts),
        "hold_minutes": minutes,
    }


def at_most(
    recordings: Sequence[Recording], figures: Sequence[np.ndarray], false: int
) -> tuple[float, list[Verdict]]:
    """The limit at which a detector catches most, with no more than so many false alarms.

    It is found on the very recordings that are scored, which flatters the detector.

    Parameters
    ----------
    recordings : sequence of Recording
    figures : sequence of ndarray, shape (t,)
        Of each: the detector alarms above the limit.
    false : int
        False alarms that it may have in all.

    Returns
    -------
    limit : float
    verdicts : list of Verdict
    """
    everything = np.unique(np.concatenate(list(figures)))
    shares = 1.0 - np.geomspace(1.0, 1.0 / max(everything.size, 2), LIMITS)
    best: tuple[tuple[int, float], float, list[Verdict]] | None = None
    for limit in np.unique([*np.quantile(everything, shares), everything[-1]]).tolist():
        verdicts = [judge(one, figure > limit) for one, figure in zip(recordings, figures,
                                                                      strict=True)]  # fmt: skip
        if sum(one.false for one in verdicts) > false:
            continue
        caught = [late for one in verdicts for late in one.latency_s if np.isfinite(late)]
        worth = len(caught), -sum(max(late, 0.0) for late in caught)
        if best is None or worth >= best[0]:  # of equals the highest limit: the most cautious
            best = worth, limit, verdicts
    assert best is not None  # above the greatest there is no alarm
    return best[1], best[2]


def _slips(recording: Recording) -> list[tuple[int, int]]:
    joined: list[tuple[int, int]] = []
    for begin, end in runs(recording.label == Label.SLIP):
        if joined and recording.time_s[begin] - recording.time_s[joined[-1][1] - 1] < JOIN_S:
            joined[-1] = joined[-1][0], end
        else:
            joined.append((begin, end))
    return joined


def _share(hits: int, of: int) -> dict[str, float] | None:
    if not of:
        return None
    interval = stats.binomtest(int(hits), of).proportion_ci(0.95, "wilson")
    return {
        "rate": float(hits) / of, "lower": float(interval.low), "upper": float(interval.high)
    }  # fmt: skip


def _rate(count: int, minutes: float) -> dict[str, float] | None:
    """Events a minute, after Garwood."""
    if minutes <= 0.0:
        return None
    lower = float(stats.chi2.ppf(0.025, 2 * count)) / 2.0 if count else 0.0
    upper = float(stats.chi2.ppf(0.975, 2 * count + 2)) / 2.0
    return {"rate": count / minutes, "lower": lower / minutes, "upper": upper / minutes}


def _median(late_s: list[float]) -> dict[str, float | None] | None:
    """Median of sorted latencies, its interval from order statistics."""
    n = len(late_s)
    if not n:
        return None
    rank = int(stats.binom.ppf(0.025, n, 0.5))  # so many lie below the median, but in 2.5 %
    return {
        "median": _milliseconds(late_s[n // 2]),
        "lower": _milliseconds(late_s[rank - 1]) if rank else None,
        "upper": _milliseconds(late_s[n - rank]) if rank else None,
    }


def _milliseconds(seconds: float) -> float | None:
    return 1e3 * seconds if np.isfinite(seconds) else None
