"""From the gel current to temperature: an exponential law, or a polynomial of its logarithm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skin.calibrate.cross_validation import cross_validated
from skin.errors import ScanError
from skin.physics.least_squares import (
    Fit,
    check_levels,
    check_samples,
    gauss_newton,
    least_squares,
)
from topology import UnitModel
from topology.gel import gel_ends, gel_share, gel_slope, gel_temperature

__all__ = ["MARGIN", "ORDERS", "fit_gel", "gel_misfit", "rises"]

TWO = ("gel_current_20c_ua", "gel_current_ratio")
ORDERS = {1: TWO, 2: (*TWO, "gel_bend_c"), 3: (*TWO, "gel_bend_c", "gel_twist_c")}
"""Parameters of the laws, by their order in the logarithm of the current."""
MARGIN = 3.0
"""Standard errors by which a law of higher order must predict better: it goes on less safely beyond
what was recorded [assumed]."""
LEAST_SLOPE = 0.1
"""Of that of the exponential law, for the noise of a current [assumed]."""


def gel_misfit(p: Mapping[str, Any], current_ua: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    """What a law misses temperatures by, as a relative error of the current, shape (t,)."""
    share = current_ua / p["gel_current_20c_ua"]
    slope = np.maximum(gel_slope(p, share), LEAST_SLOPE * 60.0 / np.log(p["gel_current_ratio"]))
    return (gel_temperature(p, share) - temperature) / slope


def rises(p: Mapping[str, Any]) -> bool:
    """Whether the temperature rises with the current over the whole calibrated range of a unit."""
    first, last = (gel_temperature(p, p["gel_current_ratio"] ** x) for x in gel_ends(p))
    return bool((first <= p["temperature_min_c"]) & (last >= p["temperature_max_c"]))


def fit_gel(
    current_ua: np.ndarray,
    temperature: np.ndarray,
    *,
    sigma_relative: float = 0.002,
    order: int | None = None,
) -> Fit:
    """Current at 20 °C, and at 80 °C over that, from a unit that is heated; bend and twist of the
    law, where it predicts better with them.

    Parameters
    ----------
    current_ua : ndarray, shape (t,)
    temperature : ndarray, shape (t,)
        Degree Celsius, of the gel, by the bench's own thermometer.
    sigma_relative : float
        Noise of the current, relative.
    order : int, optional
        Of the temperature in the logarithm of the current, 1 to 3; the lowest that predicts as well
        as any, by cross-validation, if not given.

    Returns
    -------
    Fit
        ``gel_current_20c_ua``, ``gel_current_ratio``, from the second order on ``gel_bend_c`` and
        from the third on ``gel_twist_c``.

    Raises
    ------
    ScanError
        Too few samples or temperatures, a current that is not above 0, or a value that is not
        finite.
    """
    check_samples(2, current_ua=current_ua, temperature=temperature)
    check_levels("temperature", temperature, 2, 5.0)
    given = np.asarray(current_ua, float)
    if not (given > 0.0).all():
        at = int(np.argmin(given))
        raise ScanError(f"current_ua[{at}]: must be above 0; got {given[at]:g}")
    ordered = np.argsort(temperature, kind="stable")
    current, warm = given[ordered], np.asarray(temperature, float)[ordered]
    if order is not None:
        return _fitted(current, warm, sigma_relative, order)

    def error(tried: int, training: np.ndarray) -> np.ndarray:
        fit = _fitted(current[training], warm[training], sigma_relative, tried)
        return gel_misfit(_law_of(fit), current[~training], warm[~training]) ** 2

    levels = 1 + int(np.sum(np.diff(warm) > 0.5))
    # a law goes through as many temperatures as it has constants, and predicts none of them
    tried = [k for k in ORDERS if k == 1 or levels > 2 * len(ORDERS[k])]
    best = cross_validated(tried, current.size, error, MARGIN) if len(tried) > 1 else 1
    found = _fitted(current, warm, sigma_relative, best)
    while best > 1 and not rises(_law_of(found)):
        best -= 1
        found = _fitted(current, warm, sigma_relative, best)
    return found


def _law_of(fit: Fit) -> dict[str, float]:
    """All parameters of a gel's law."""
    known = dict(zip(fit.names, fit.values.tolist(), strict=True))
    names = (*ORDERS[3], "temperature_min_c", "temperature_max_c")
    return {name: known.get(name, getattr(UnitModel(), name)) for name in names}


def _fitted(current: np.ndarray, warm: np.ndarray, sigma: float, order: int) -> Fit:
    """By least squares of the logarithm of the current."""
    matrix = np.stack([np.ones(current.size), (warm - 20.0) / 60.0], axis=1)
    names = ("ln I20", "ln ratio", "bend", "twist")[: order + 1]
    fit = least_squares(matrix, np.log(current), sigma, names[:2])
    if order > 1:

        def model(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            bend, twist = at[2], at[3] if order > 2 else 0.0
            p = {"gel_current_ratio": np.exp(at[1]), "gel_bend_c": bend, "gel_twist_c": twist}
            x = np.log(gel_share(p, warm)) / at[1]
            slope = 60.0 + bend * (2.0 * x - 1.0) + twist * (6.0 * x * (x - 1.0) + 1.0)
            sag = -at[1] * x * (x - 1.0) / np.maximum(slope, 60.0 * LEAST_SLOPE)
            rows = [np.ones_like(x), x, sag, sag * (2.0 * x - 1.0)]
            return at[0] + at[1] * x, np.stack(rows[: order + 1], axis=1)

        start = np.append(fit.values, np.zeros(order - 1))
        fit = gauss_newton(model, start, np.log(current), sigma, names)
    values = np.append(np.exp(fit.values[:2]), fit.values[2:])
    scale = np.append(values[:2], np.ones(order - 1))
    return fit.derived(ORDERS[order], values, np.diag(scale))
