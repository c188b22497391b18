"""Score of a disturbed grip: margins, return, reaction, slide."""

from __future__ import annotations

import numpy as np

from skin.demos.disturbance import PULLED_S, REST_S, Disturbance

__all__ = ["figures_of", "reactions_s"]

LOOK_S = 0.3
"""Ends of the compared rest and recovery."""

ONSET_UNITS = 1
"""Units that slip, by the truth, above which a slip counts."""

QUIET_S = 0.1
"""Time without slip before a slip that counts as new."""

RISEN = 0.01
"""Relative rise of the command that counts as a reaction."""

LATEST_S = 0.5
"""Timeout of a reaction."""


def figures_of(run: Disturbance) -> dict[str, object]:
    """Figures of a run, by name.

    `margin_…` are friction times grip over the tangential load, minus 1, by the truth: at rest just
    before the pulls, at the largest load, and the median from there to the end. `return_error` is
    the grip at the end over that at rest, minus 1. `reaction_ms` is the median time from a unit's
    true slip to a rise of the command.
    """
    clock_s, margin = run.clock_s, np.array(run.margin)
    load, down = np.array(run.true_load_n), np.hypot(run.true_side_n, run.true_down_n)
    figures: dict[str, object] = {
        "dropped": bool(run.dropped),
        "slid_mm": round(1e3 * max(run.slid_m), 3),
        "slips": run.slips,
        "friction_believed": round(run.friction[-1], 4),
        "work_us": round(float(np.median(run.work_us)), 2),
        "grip_peak_n": round(float(load.max()), 3),
    }
    rest = (clock_s > REST_S - LOOK_S) & (clock_s < REST_S)
    after = clock_s > clock_s[-1] - LOOK_S
    pulled = (clock_s > REST_S) & (clock_s < PULLED_S)
    if not (rest.any() and pulled.any() and clock_s[-1] > PULLED_S + LOOK_S):
        none = ("margin_rest", "margin_peak", "margin_median", "grip_rest_n", "grip_after_n",
                "return_error", "reaction_ms")  # fmt: skip
        return figures | dict.fromkeys(none)
    peak = np.flatnonzero(pulled)[np.argmax(down[pulled])]
    since = clock_s > REST_S - LOOK_S
    reactions = reactions_s(run)
    figures |= {
        "margin_rest": _median(margin[rest]),
        "margin_peak": round(float(margin[peak]), 4),
        "margin_median": _median(margin[since]),
        "grip_rest_n": round(float(load[rest].mean()), 3),
        "grip_after_n": round(float(load[after].mean()), 3),
        "return_error": round(float(load[after].mean() / load[rest].mean() - 1.0), 4),
        "reaction_ms": round(1e3 * float(np.median(reactions)), 1) if reactions else None,
    }
    return figures


def reactions_s(run: Disturbance) -> list[float]:
    """Times from a unit's true slip, in the pulls, to a rise of the command above its value then.

    Of a command that is rising already, the time is 0.
    """
    clock_s, slipping, wanted = run.clock_s, np.array(run.slipping), np.array(run.wanted_n)
    period_s = float(np.median(np.diff(clock_s)))
    quiet, late = round(QUIET_S / period_s), round(LATEST_S / period_s)
    found = []
    for i in np.flatnonzero(slipping >= ONSET_UNITS):
        if not REST_S < clock_s[i] < PULLED_S or (slipping[max(i - quiet, 0) : i] > 0).any():
            continue
        risen = np.flatnonzero(wanted[i : i + late] > (1.0 + RISEN) * wanted[i - 1])
        found.append(float(risen[0]) * period_s if risen.size else LATEST_S)
    return found


def _median(values: np.ndarray) -> float | None:
    kept = values[np.isfinite(values)]
    return round(float(np.median(kept)), 4) if kept.size else None
