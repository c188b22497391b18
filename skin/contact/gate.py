"""The gate: normal loads that start a contact, and that keep a unit in it.

The threshold of a start follows from the allowed rate of false contacts. A unit may start a contact
alone, by the mean of two successive cycles, or together with a neighbour; under noise alone all
three are normal deviates, and share the false contacts equally [derived]. A single unit that is
pressed within one cycle must exceed a threshold above five sigmas; slow and wide contacts are
detected as early as with that.
"""

from __future__ import annotations

import numpy as np

from skin.contact.model import NeighbourGraph
from skin.errors import SkinError
from skin.options import Options

__all__ = [
    "FALSE_CONTACTS_PER_DAY", "KEEP_SIGMA", "START_SIGMA", "start_sigma_for", "start_sigmas",
]  # fmt: skip

START_SIGMA = 5.0
"""Normal load of a contact in a single reading of an array, in sigmas [assumed]."""
KEEP_SIGMA = 3.0
"""Normal load that a unit must exceed to belong to a contact, in sigmas [assumed]."""
FALSE_CONTACTS_PER_DAY = Options.false_contacts_per_day
"""Allowed contacts due to noise on the whole skin, per day [assumed]."""


def start_sigmas(
    graph: NeighbourGraph, rate_hz: float, false_contacts_per_day: float
) -> tuple[float, float, float]:
    """Thresholds of a unit, of two cycles of it, and of two neighbours; see `Gate`.

    Parameters
    ----------
    graph : NeighbourGraph
    rate_hz : float
        Cycles a second.
    false_contacts_per_day : float
        On the whole skin, on white Gaussian noise.
    """
    per_hour = false_contacts_per_day / 24.0 / 3.0
    n, pairs = graph.start.size - 1, graph.neighbour.size // 2
    alone = start_sigma_for(per_hour, n, rate_hz)
    both = start_sigma_for(per_hour, pairs, rate_hz) if pairs else np.inf
    return alone, alone, both


def start_sigma_for(false_alarms_per_hour: float, n: int, rate_hz: float) -> float:
    """Threshold at which noise alone starts at most this rate of contacts.

    For white Gaussian noise. At `START_SIGMA`, noise of 64 units at 250 Hz starts a contact every
    3.6 minutes.

    Parameters
    ----------
    false_alarms_per_hour : float
    n : int
        Number of units, or of other tests per cycle.
    rate_hz : float
        Cycles a second.

    Returns
    -------
    float
        Sigmas of normal load.

    Examples
    --------
    >>> round(start_sigma_for(1.0, 64, 250.0), 2)
    5.52
    """
    from scipy.special import ndtri

    chance = false_alarms_per_hour / (3600.0 * n * rate_hz)
    if not 0.0 < chance < 0.5:
        raise SkinError(
            "false_alarms_per_hour, n, rate_hz: must leave each unit and cycle a chance between "
            f"0 and 0.5; got {chance:g}"
        )
    return float(-ndtri(chance))
