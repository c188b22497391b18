"""What lags behind the gel, where cycles do not come once a period."""

from __future__ import annotations

import numpy as np

from topology import Topology

__all__ = ["Aging"]


class Aging:
    """Lets the lags of film and chip age by periods that had no cycle.

    A cycle takes a period; what is more, or less, is gathered (`skin.cycle.set_elapsed`) and counts
    when it is worth it. A change of the gel's temperature in a gap counts as if it came at its end.

    Parameters
    ----------
    topology : Topology
    state : ndarray, records of `skin.decode.records.state`
    """

    def __init__(self, topology: Topology, state: np.ndarray) -> None:
        p, period_s = topology.parameters, 1.0 / topology.cycle_rate_hz
        self._lags = [
            (state[name], self._share(period_s, p[lag_s], state[name]))
            for name, lag_s in (("film_lag", "film_lag_s"), ("chip_lag", "hall_lag_s"))
        ]

    @staticmethod
    def _share(period_s: float, lag_s: np.ndarray, like: np.ndarray) -> np.ndarray:
        """Time constants that a period is, by block and lane."""
        share = np.zeros(like.shape)
        known = np.divide(period_s, lag_s, out=np.zeros(lag_s.shape), where=lag_s > 0.0)
        share.reshape(-1)[: lag_s.size] = known
        return share

    def __call__(self, periods: float) -> None:
        """Age by so many periods, in addition to those that had cycles."""
        for lags, share in self._lags:
            np.multiply(lags, np.exp(-periods * share), out=lags)
