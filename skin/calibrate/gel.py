"""Laws from the gel current to temperature, by their order: which there are, and which rise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from topology.gel import gel_ends, gel_slope, gel_temperature

__all__ = ["MARGIN", "ORDERS", "gel_misfit", "rises"]

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
