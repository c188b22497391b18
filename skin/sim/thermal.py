"""Heat conduction through a unit: from the contact to gel, film, elastomer and chip.

Each layer is a first-order lag behind the one above it. Between two steps contact and room are
constant, and the update is exact for any step.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm

from skin.errors import OptionError
from topology import Topology

__all__ = ["LAYERS", "STEADY_SHARES", "ThermalChain"]

LAYERS = ("gel", "film", "elastomer", "chip")
"""From the outside in: rows of all temperatures."""

CONTACT_LAG_S = 4.0
"""Lag of the gel behind the contact."""

FREE_LAG_S = 60.0
"""Lag of the untouched gel behind the room [assumed]."""

ELASTOMER_LAG_S = 60.0
"""Lag of the elastomer: the part of the chip's that lies between film and elastomer [assumed]."""

STEADY_SHARES = (0.99, 0.974, 0.86, 0.76)
"""Steady-state fraction of the difference between contact and room in each layer: 1-D heat model,
the elastomer's half-way between its neighbours' [assumed]."""

SHORTEST_S = 1e-6
"""Lower bound of a lag."""


class ThermalChain:
    """Temperatures of the layers of n units.

    Parameters
    ----------
    topology : Topology
        Its `film_lag_s` is the film's lag behind the gel, `hall_lag_s` the chip's lag behind the
        gel: mean delays of a change.
    ambient : float
        Initial temperature of all layers, degree Celsius.
    direct : bool
        Each layer follows the gel itself, with its whole lag, instead of the layer above it,
        without loss of heat: the model of the decoder.

    Attributes
    ----------
    temperature : ndarray, shape (4, n)
        Degree Celsius, rows as in `LAYERS`.

    Raises
    ------
    OptionError
        The lag of a chip is too short for that of the elastomer.

    Examples
    --------
    >>> from topology import load
    >>> chain = ThermalChain(load("palm"), ambient=20.0)
    >>> warm = chain.step(4.0, contact=np.ones(64, bool), source=80.0, ambient=20.0)
    >>> warm[:, 0].round(1)
    array([57.5, 30.1, 20.2, 20. ])
    """

    def __init__(self, topology: Topology, *, ambient: float, direct: bool = False) -> None:
        film, chip = (topology.parameters[f"{layer}_lag_s"] for layer in ("film", "hall"))
        own = [film, np.full_like(film, ELASTOMER_LAG_S), chip]
        if not direct:
            own[2] = chip - film - ELASTOMER_LAG_S
            if own[2].min(initial=0.0) < 0.0:
                worst = int(np.argmin(own[2]))
                raise OptionError(
                    f"{topology.unit_names[worst]}: hall_lag_s: must be at least film_lag_s and "
                    f"{ELASTOMER_LAG_S:g} s of the elastomer; got {chip[worst]:g}"
                )
        shares = np.array([1.0, *((1.0,) * len(LAYERS) if direct else STEADY_SHARES)])
        self._state = np.full((len(LAYERS) + 2, topology.n), float(ambient))
        self.temperature = self._state[:-2]
        # units with the same lags share a row
        lags, self._kind = np.unique(np.stack(own), axis=1, return_inverse=True)
        self._flows = np.stack(
            [
                [_flows(first, shares, kind, touched, direct) for kind in lags.T]
                for first, touched in ((FREE_LAG_S, False), (CONTACT_LAG_S, True))
            ]
        )
        self._kind = self._kind.reshape(-1)
        self._dt_s, self._update = -1.0, np.empty(0)

    def step(
        self,
        dt_s: float,
        contact: np.ndarray,
        source: float | np.ndarray,
        ambient: float | np.ndarray,
    ) -> np.ndarray:
        """Advance by `dt_s` seconds; returns `temperature`, updated in place.

        Parameters
        ----------
        dt_s : float
        contact : ndarray, shape (n,), bool
            Units in contact during the step.
        source, ambient : float or ndarray, shape (n,)
            Temperature of the contact, and of the room, degree Celsius.
        """
        # differences of times differ in the last bit
        if not math.isclose(dt_s, self._dt_s, rel_tol=1e-9):
            self._update = expm(dt_s * self._flows)[:, :, : len(LAYERS)]
            self._dt_s = dt_s
        self._state[-2], self._state[-1] = source, ambient
        flow = self._update[contact.astype(int), self._kind]
        self.temperature[...] = np.einsum("nab,bn->an", flow, self._state)
        return self.temperature


def _flows(
    first_lag_s: float, shares: np.ndarray, lags_s: np.ndarray, touched: bool, direct: bool
) -> np.ndarray:
    """d/dt of (gel, film, elastomer, chip, source, room), shape (6, 6); the last two are constant.

    A layer goes to room + s (above - room), s being its share over the share of the one above.
    """
    flows = np.zeros((6, 6))
    for layer, lag_s in enumerate([first_lag_s, *lags_s]):
        rate = 1.0 / max(lag_s, SHORTEST_S)
        above = 4 if layer == 0 else 0 if direct else layer - 1
        below = shares[0] if layer == 0 else shares[1] if direct else shares[layer]
        share = (shares[layer + 1] / below) if layer or touched else 0.0
        flows[layer, layer] -= rate
        flows[layer, above] += rate * share
        flows[layer, 5] += rate * (1.0 - share)
    return flows
