"""The bound that physics sets a slip detector: a matched filter that knows the truth.

It is told how units would be displaced if nothing slipped from the beginning of the motion on, and
how they are displaced in truth, with the relaxation of the elastomer; its readings have noise and
no other error, and it knows the noise. It sums the logarithm of the likelihood ratio of the two and
alarms when that reaches ``log(1 / false_alarms)``: while nothing slips, that happens in no more
than a share `false_alarms` of the trials, however long they last (Ville 1939), and no test that is
as seldom wrong is sooner by much (Wald and Wolfowitz 1948). What alarms before 2 % of the load have
slipped waits until they have.
"""

from __future__ import annotations

import numpy as np

from benchmarks.slip_play import FIRST, Trial, play
from benchmarks.slip_seen import Seen

__all__ = ["FALSE_ALARMS", "alarms", "evidence", "matched", "stuck"]

FALSE_ALARMS = 0.001
"""Share of the trials without slip: what is asked of the detector in held contacts."""


def stuck(trial: Trial) -> np.ndarray:
    """Displacements, mm, shape (t, 3, n), if nothing had slipped since the motion began."""
    return play(trial.plan, sticks_for=len(trial.time_s)).displacement_mm


def evidence(
    reading: np.ndarray, sticks: np.ndarray, slips: np.ndarray, sigma: np.ndarray
) -> np.ndarray:
    """Logarithm of the likelihood ratio of "slips" over "sticks" so far, shape (t,).

    Parameters
    ----------
    reading, sticks, slips, sigma : ndarray, shape (t, ...)
        What is read, what is expected of it in either case, and its noise.
    """
    each = ((reading - sticks) ** 2 - (reading - slips) ** 2) / (2.0 * sigma**2)
    return np.cumsum(each.reshape(len(each), -1).sum(axis=1))


def alarms(level: np.ndarray, false_alarms: float = FALSE_ALARMS) -> np.ndarray:
    """Where the evidence is enough, shape (t,), bool; it stays so from then on."""
    return np.logical_or.accumulate(level >= np.log(1.0 / false_alarms))


def matched(trial: Trial, seen: Seen) -> np.ndarray:
    """Alarms of the matched filter, shape (t,), bool; of what is seen, the sigma is used."""
    rng = np.random.default_rng([trial.plan.seed, 2])
    sigma = seen.displacement_sigma_mm
    reading = trial.displacement_mm + sigma * rng.standard_normal(sigma.shape)
    level = evidence(reading, stuck(trial), trial.displacement_mm, sigma)
    there = np.logical_or.accumulate(trial.moving & (trial.share >= FIRST))
    return alarms(level) & there
