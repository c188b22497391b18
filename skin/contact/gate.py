"""The gate: normal loads that start a contact, and that keep a unit in one."""

from __future__ import annotations

from skin.errors import SkinError

__all__ = ["KEEP_SIGMA", "START_SIGMA", "start_sigma_for"]

START_SIGMA = 5.0
"""Normal load that starts a contact, in sigmas."""
KEEP_SIGMA = 3.0
"""Normal load that a unit must exceed to belong to a contact, in sigmas."""


def start_sigma_for(false_alarms_per_hour: float, n: int, rate_hz: float) -> float:
    """Gate at which noise alone starts no more than so many contacts.

    For white Gaussian noise. At `START_SIGMA` 64 units at 250 Hz start one contact in 3.6 minutes.

    Parameters
    ----------
    false_alarms_per_hour : float
    n : int
        Number of units.
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
