"""How good a slip detector is: what it must see, when, and what it must not see.

A trial is a time series of the true share of the load that slips, and the time of the detector's
first alarm. Three times of the truth matter: the first slip (`FIRST` of the load), the onset
(`ONSET`), from which latency counts, and gross slip (`GROSS`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

__all__ = ["FIRST", "GROSS", "ONSET", "Outcome", "outcome", "score", "slipping_share"]

FIRST, ONSET, GROSS = 0.02, 0.1, 0.95
WARNING_S = 0.04
"""Time from onset to gross slip below which there is nothing to catch before."""
RECENT_S = 0.25
"""An alarm is true if slip happened this recently."""


@dataclass(frozen=True)
class Outcome:
    """One trial: its true times, the alarm, seconds; NaN for never."""

    first_s: float
    onset_s: float
    gross_s: float
    alarm_s: float
    false: bool
    """The alarm came while nothing slipped."""
    friction_error: float = np.nan
    """Relative, of the estimate after the alarm."""


def slipping_share(slipping: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Share of the load that slips.

    Parameters
    ----------
    slipping : ndarray, shape (t, n), bool
        Whether a unit slides under what it touches: the truth.
    load : ndarray, shape (t, n)
        Newton, true normal load.

    Returns
    -------
    ndarray, shape (t,)
    """
    return np.sum(slipping * load, axis=1) / np.maximum(load.sum(axis=1), 1e-12)


def outcome(
    time_s: np.ndarray,
    share: np.ndarray,
    alarm: np.ndarray,
    *,
    from_s: float = 0.0,
    friction_error: float = np.nan,
) -> Outcome:
    """Compare the alarms of one trial with its truth.

    Parameters
    ----------
    time_s, share : ndarray, shape (t,)
        Time, and true share of the load that slips.
    alarm : ndarray, shape (t,), bool
        The detector says that the contact slips.
    from_s : float
        When the trial begins; what was before is approach.
    friction_error : float
        Relative error of the friction estimate after the alarm.
    """
    counts = time_s >= from_s
    most = np.maximum.accumulate(np.where(counts, share, 0.0))

    def when(true: np.ndarray) -> float:
        return float(time_s[np.argmax(true)]) if true.any() else np.nan

    alarm_s = when(alarm & counts)
    recent = (time_s > alarm_s - RECENT_S) & (time_s <= alarm_s) & counts
    false = np.isfinite(alarm_s) and not np.any(share[recent] >= FIRST)
    return Outcome(
        when(most >= FIRST), when(most >= ONSET), when(most >= GROSS), alarm_s, bool(false),
        friction_error,
    )  # fmt: skip


def score(outcomes: Iterable[Outcome]) -> dict[str, float]:
    """Figures of many trials.

    Returns
    -------
    dict
        trials : number;
        caught_before_gross : share, of the trials that reach gross slip and give a warning of at
        least `WARNING_S`, with an alarm after the first slip and before gross slip;
        latency_median_s, latency_p90_s : from the onset to the alarm, of all trials with an onset;
        an alarm that never came counts as infinitely late, one before the onset as negative;
        premature : share of the trials with an onset with an alarm while nothing slipped;
        false_alarm : share of the trials without onset with an alarm while nothing slipped;
        abrupt : share of the trials with gross slip that give no warning;
        friction_error_median : of the trials with an alarm.
    """
    all_of = list(outcomes)
    slips = [one for one in all_of if np.isfinite(one.onset_s)]
    holds = [one for one in all_of if not np.isfinite(one.onset_s)]
    gross = [one for one in slips if np.isfinite(one.gross_s)]
    warned = [one for one in gross if one.gross_s - one.onset_s >= WARNING_S]
    late = np.array([np.inf if np.isnan(o.alarm_s) else o.alarm_s - o.onset_s for o in slips])
    errors = [o.friction_error for o in slips if np.isfinite(o.friction_error)]

    def share(hits: list[bool]) -> float:
        return float(np.mean(hits)) if hits else np.nan

    def at(quantile: float) -> float:
        return float(np.quantile(late, quantile, method="higher")) if late.size else np.nan

    return {
        "trials": len(all_of),
        "caught_before_gross": share([not o.false and o.alarm_s < o.gross_s for o in warned]),
        "latency_median_s": at(0.5),
        "latency_p90_s": at(0.9),
        "premature": share([o.false for o in slips]),
        "false_alarm": share([o.false for o in holds]),
        "abrupt": share([o.gross_s - o.onset_s < WARNING_S for o in gross]),
        "friction_error_median": float(np.median(errors)) if errors else np.nan,
    }
