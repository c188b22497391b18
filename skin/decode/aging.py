"""What lags behind the gel, where cycles do not come once a period."""

from __future__ import annotations

import numpy as np

from topology import Topology

__all__ = ["Aging"]

WORTH = 0.5
"""Periods that may be missing before the lags are told."""


class Aging:
    """Lets the lags of film and chip age by periods that had no cycle.

    A cycle takes a period; what is more, or less, is gathered here and told when it is worth it. A
    change of the gel's temperature in a gap counts as if it came at its end.

    Parameters
    ----------
    topology : Topology
    state : ndarray, records of `skin.decode.records.state`
    phase : ndarray, int64
        `phase` of `skin.decode.records.CONTROL`, of the shares that decode single cycles.
    every : int
        Cycles for which temperatures are held.

    Attributes
    ----------
    missing : float
        Periods that were gathered.
    """

    def __init__(
        self, topology: Topology, state: np.ndarray, phase: np.ndarray, every: int
    ) -> None:
        p, period_s = topology.parameters, 1.0 / topology.cycle_rate_hz
        self._phase, self._every = phase, every
        self._lags = [
            (state[name], self._share(period_s, p[lag_s], state[name]))
            for name, lag_s in (("film_lag", "film_lag_s"), ("chip_lag", "hall_lag_s"))
        ]
        self.missing = 0.0

    @staticmethod
    def _share(period_s: float, lag_s: np.ndarray, like: np.ndarray) -> np.ndarray:
        """Time constants that a period is, by block and lane."""
        share = np.zeros(like.shape)
        known = np.divide(period_s, lag_s, out=np.zeros(lag_s.shape), where=lag_s > 0.0)
        share.reshape(-1)[: lag_s.size] = known
        return share

    def reset(self) -> None:
        """Forget what was gathered."""
        self.missing = 0.0

    def __call__(self, periods: float) -> None:
        """Say how many periods the next cycle is after the last one."""
        self.missing += periods - 1.0
        if abs(self.missing) < WORTH:
            return
        for lags, share in self._lags:
            np.multiply(lags, np.exp(-self.missing * share), out=lags)
        whole, self.missing = round(self.missing), 0.0
        phase, every = int(self._phase[0]), self._every
        if every > 1 and whole > 0:
            # temperatures that are due within the gap are due now
            due = -(-phase // every) * every
            self._phase[:] = due if due <= phase + whole else phase + whole
