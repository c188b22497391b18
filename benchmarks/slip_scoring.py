"""The slip detector on a trial, and how good it is: what it must see, when, and what not.

A trial is a time series of the true share of the load that has slipped, and of the detector's
alarm; an alarm is the moment when it goes on. `benchmarks.slip` says what each figure means.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.intervals import Rate, per_minute, rate
from benchmarks.slip_play import FIRST, GROSS, ONSET, Trial, skin_of
from benchmarks.slip_seen import Seen
from skin.contact.record import SlipState
from skin.contact.stream import ContactStream

__all__ = ["Outcome", "outcome", "score", "watch"]

WARNING_S = 0.04
"""Time from onset to gross slip below which hardly anything could be done."""
FRICTION_S = 0.2
"""After the alarm: when the friction estimate is read."""


@dataclass(frozen=True)
class Outcome:
    """One trial: its true times and the alarm, in seconds since the motion began; NaN for never.

    Attributes
    ----------
    kind : str
    first_s, onset_s, gross_s : float
        When `FIRST`, `ONSET` and `GROSS` of the load have slipped.
    alarm_s : float
        The first alarm after the motion has begun.
    false : bool
        That alarm came while nothing had slipped.
    early : bool
        There was an alarm before the motion, while nothing had slipped.
    friction_error : float
        Relative, of the estimate after the alarm, of the friction of motion.
    held_s : float
        How long the contact was held, the way down included: all of a trial in which nothing slips.
    alarms : int
        How often the detector went on meanwhile.
    """

    kind: str
    first_s: float
    onset_s: float
    gross_s: float
    alarm_s: float
    false: bool
    early: bool
    friction_error: float = np.nan
    held_s: float = 0.0
    alarms: int = 0

    @property
    def lead_s(self) -> float:
        """From a true alarm to gross slip; 0 where there was none before that, NaN where the slip
        does not become gross."""
        if np.isnan(self.gross_s):
            return np.nan
        told = np.isfinite(self.alarm_s) and not self.false
        return max(self.gross_s - self.alarm_s, 0.0) if told else 0.0


def watch(trial: Trial, seen: Seen) -> tuple[np.ndarray, np.ndarray]:
    """Where the slip detector says that a contact slips, incipient or gross, bool; and its friction
    of the heaviest contact, NaN before it is known. Shape (t,) each."""
    skin = skin_of(trial.plan.skin)
    stream = ContactStream(
        skin.position, skin.rotation, skin.area, skin.neighbour_start, skin.neighbour_index,
        want={"slip"}, rate_hz=trial.plan.rate_hz,
    )  # fmt: skip
    stamps_ns = np.rint(1e9 * trial.time_s).astype(np.int64).tolist()
    alarm, friction = np.zeros(len(stamps_ns), bool), np.full(len(stamps_ns), np.nan)
    arrays = (seen.force, seen.force_sigma, seen.displacement_mm, seen.displacement_sigma_mm)
    # as a decoder's: always these
    now = [np.zeros(array.shape[1:], np.float32) for array in arrays]
    for t, stamp_ns in enumerate(stamps_ns):
        for mine, array in zip(now, arrays, strict=True):
            mine[:] = array[t]
        contacts = stream.update(*now, stamp_ns=stamp_ns)
        if contacts:
            alarm[t] = max(contact.slip for contact in contacts) >= SlipState.INCIPIENT
            heaviest = max(contacts, key=lambda contact: contact.load)
            if heaviest.friction_known:  # bounds are no estimates
                friction[t] = heaviest.friction
    return alarm, friction


def outcome(trial: Trial, alarm: np.ndarray, friction: np.ndarray | None = None) -> Outcome:
    """Hold a detector's alarm against the truth.

    Parameters
    ----------
    trial : Trial
    alarm : ndarray, shape (t,), bool
        The detector says that the contact slips.
    friction : ndarray, shape (t,), optional
        Its estimates.
    """
    since_s, share, moving = trial.time_s - trial.plan.begins_s, trial.share, trial.moving

    def when(true: np.ndarray) -> float:
        return float(since_s[np.argmax(true)]) if true.any() else np.nan

    rises = alarm & ~np.concatenate([[False], alarm[:-1]])
    alarm_s = when(rises & moving)
    first_s = when(moving & (share >= FIRST))
    error = np.nan
    if friction is not None and np.isfinite(alarm_s):
        at = min(np.searchsorted(since_s, alarm_s + FRICTION_S), since_s.size - 1)
        error = float(friction[at] / trial.plan.kinetic.mean() - 1.0)
    held = trial.plan.kind != "slip"
    return Outcome(
        trial.plan.kind, first_s, when(moving & (share >= ONSET)),
        when(moving & (share >= GROSS)), alarm_s,
        false=bool(np.isfinite(alarm_s) and not alarm_s >= first_s),
        early=bool(np.any(rises & ~moving & (np.maximum.accumulate(share) < FIRST))),
        friction_error=error,
        held_s=float(trial.time_s[-1]) if held else 0.0,
        alarms=int(rises.sum()) if held else 0,
    )  # fmt: skip


def _caught(one: Outcome) -> bool:
    return bool(not one.false and one.alarm_s < one.gross_s)


def score(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Figures of many trials of all kinds; `benchmarks.slip` says what they are.

    None where there is nothing to tell, or where the answer is never; ``rates`` have intervals.
    """
    slips = [one for one in outcomes if one.kind == "slip"]
    gross = [one for one in slips if np.isfinite(one.gross_s)]
    warned = [one for one in gross if one.gross_s - one.onset_s >= WARNING_S]
    held = [one for one in outcomes if one.kind != "slip"]
    first_s, late_s = (
        [float(np.nan_to_num(one.alarm_s - getattr(one, since), nan=np.inf)) for one in slips]
        for since in ("first_s", "onset_s")
    )
    alarmed = [one.friction_error for one in slips if np.isfinite(one.alarm_s)]
    errors = [abs(error) for error in alarmed if np.isfinite(error)]

    def false(kind: str) -> Rate | None:
        hits = [one.false or one.early for one in outcomes if one.kind == kind]
        return rate(sum(hits), len(hits))

    def quantile(values: list[float], q: float) -> float | None:
        value = float(np.quantile(values, q, method="higher")) if values else np.inf
        # of whole cycles: without the rounding of their sums
        return round(1e3 * value, 6) if np.isfinite(value) else None

    rates = {
        "caught_before_gross": rate(sum(map(_caught, gross)), len(gross)),
        "premature": false("slip"),
        "false_alarm_hold": false("hold"),
        "false_alarm_modulation": false("modulation"),
        "false_alarms_per_minute": per_minute(
            sum(one.alarms for one in held), sum(one.held_s for one in held)
        ),
    }
    return {
        **{name: one and one["rate"] for name, one in rates.items()},
        "caught_with_warning": float(np.mean([*map(_caught, warned)])) if warned else None,
        "latency_ms_first_median": quantile(first_s, 0.5),
        "latency_ms_first_p90": quantile(first_s, 0.9),
        "latency_ms_median": quantile(late_s, 0.5),
        "latency_ms_p90": quantile(late_s, 0.9),
        "lead_ms_median": 1e3 * float(np.median([one.lead_s for one in gross])) if gross else None,
        "friction_error_median": float(np.median(errors)) if errors else None,
        "friction_known": len(errors) / len(alarmed) if alarmed else None,
        "slips": len(slips),
        "gross": len(gross),
        "holds": sum(one.kind == "hold" for one in outcomes),
        "rates": rates,
    }
