"""From the gel current to temperature: an exponential law with two constants of the unit."""

from __future__ import annotations

import numpy as np

from skin.errors import ScanError
from skin.physics.least_squares import Fit, check_levels, check_samples, least_squares

__all__ = ["fit_gel"]


def fit_gel(
    current_ua: np.ndarray, temperature: np.ndarray, *, sigma_relative: float = 0.002
) -> Fit:
    """Current at 20 °C, and at 80 °C over that, from a unit that is heated.

    Parameters
    ----------
    current_ua : ndarray, shape (t,)
    temperature : ndarray, shape (t,)
        Degree Celsius, of the gel, by the bench's own thermometer.
    sigma_relative : float
        Noise of the current, relative.

    Returns
    -------
    Fit
        ``gel_current_20c_ua``, ``gel_current_ratio``.

    Raises
    ------
    ScanError
        Too few samples or temperatures, a current that is not above 0, or a value that is not
        finite.
    """
    check_samples(2, current_ua=current_ua, temperature=temperature)
    check_levels("temperature", temperature, 2, 5.0)
    current = np.asarray(current_ua, float)
    if not (current > 0.0).all():
        at = int(np.argmin(current))
        raise ScanError(f"current_ua[{at}]: must be above 0; got {current[at]:g}")
    share = (np.asarray(temperature, float) - 20.0) / 60.0
    matrix = np.stack([np.ones(current.size), share], axis=1)
    fit = least_squares(matrix, np.log(current), sigma_relative, ("ln I20", "ln ratio"))
    values = np.exp(fit.values)
    return fit.derived(("gel_current_20c_ua", "gel_current_ratio"), values, np.diag(values))
