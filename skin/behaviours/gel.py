"""Mean temperature of the gels that something touches, while units come, go and fall silent.

Every gel follows what touches it with the same lag, wherever it started. The mean over a set of
units does so, too, as long as the set stays; where it changes, the mean jumps, and by how much is
told, so that a filter can step over it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled
from skin.errors import OptionError
from skin.state import State
from topology import Topology

__all__ = ["SMOOTH_S", "Gel", "GelMean"]

ON_SIGMAS, OFF_SIGMAS = 5.0, 2.0
"""Normal force over its sigma from which on a unit is touched, and down to which it stays so
[derived: once in an hour of 32 units at 250 Hz, by noise]."""

LEAST_SIGMA_N = 0.005
"""Of a normal force, where sigma is smaller or unknown [assumed]."""

SMOOTH_S = 0.2
"""Time constant of the temperatures from which jumps are told [assumed]."""


class GelMean(NamedTuple):
    """Of a cycle.

    Attributes
    ----------
    mean_c : float
        NaN where no unit that is touched is heard.
    jump_c : float
        By how much the mean lies higher than it would, had the set of units stayed.
    sigma_c : float
        Of what is the same in every reading: of the units' constants.
    count : int
        Units in the mean.
    touched : int
        Units that are touched, heard or not.
    changed : bool
        Whether the set is another.
    """

    mean_c: float
    jump_c: float
    sigma_c: float
    count: int
    touched: int
    changed: bool


class Gel:
    """Reads the mean, a cycle after the other.

    Parameters
    ----------
    topology : Topology
    names : iterable of str, optional
        Patches; all of them if not given.

    Raises
    ------
    OptionError
        There is no such patch.
    """

    def __init__(self, topology: Topology, names: Iterable[str] | None = None) -> None:
        wanted = tuple(topology.patch_names if names is None else names)
        for name in wanted:
            if name not in topology.patch_names:
                raise OptionError.unknown("patches", name, topology.patch_names)
        chosen = [i for i, name in enumerate(topology.patch_names) if name in wanted]
        self._of_pads = np.isin(topology.patch, chosen)
        self._touched = np.zeros(topology.n, bool)
        self._members = np.zeros(topology.n, bool)
        self._smooth = np.full(topology.n, np.nan)
        self._gain = min(1.0, 1.0 / (SMOOTH_S * topology.cycle_rate_hz))
        self._no_sigma = np.full((3, topology.n), np.nan, np.float32)
        self._no_spread = np.zeros(topology.n, np.float32)
        self._out = np.zeros(6)

    def read(self, state: State) -> GelMean:
        """The mean in this cycle; `state` has force and temperature, and best their sigma."""
        units = state.units
        sigma = self._no_sigma if units.force_sigma is None else units.force_sigma
        spread = self._no_spread if units.temperature_sigma is None else units.temperature_sigma
        _gel_mean(
            (units.force, sigma, units.temperature, spread, units.valid), self._of_pads,
            self._touched, self._members, self._smooth, self._gain, self._out,
        )  # fmt: skip
        mean, jump, told, count, touched, changed = self._out.tolist()
        return GelMean(mean, jump, told, int(count), int(touched), changed > 0.0)

    def reset(self) -> None:
        """Forget which units were in the mean."""
        self._members[:] = False


def gel_mean_python(readings, of_pads, touched, members, smooth, gain, out):
    """See `Gel.read`; `out` is as `GelMean`."""
    force, force_sigma, temperature, spread, valid = readings
    count, before, among = 0, 0, 0
    total, old, new, spreads = 0.0, 0.0, 0.0, 0.0
    for i in range(touched.size):
        if not of_pads[i]:
            continue
        heard = valid[i] and not np.isnan(temperature[i])
        if valid[i]:
            sigma = force_sigma[2, i]
            sigma = LEAST_SIGMA_N if np.isnan(sigma) else max(sigma, LEAST_SIGMA_N)
            touched[i] = force[2, i] > (OFF_SIGMAS if touched[i] else ON_SIGMAS) * sigma
        if heard:
            here = temperature[i]
            smooth[i] = here if np.isnan(smooth[i]) else smooth[i] + gain * (here - smooth[i])
        if touched[i]:
            among += 1
        if members[i]:
            before += 1
            old += smooth[i]
        if touched[i] and heard:
            count += 1
            total += temperature[i]
            new += smooth[i]
            spreads += spread[i]
    out[0], out[1], out[2], out[3], out[4], out[5] = np.nan, 0.0, np.nan, count, among, 0.0
    if count == 0:
        return
    out[0] = total / count
    out[2] = spreads / count**1.5
    changed = False
    for i in range(touched.size):
        now = of_pads[i] and touched[i] and valid[i] and not np.isnan(temperature[i])
        changed = changed or now != members[i]
        members[i] = now
    if changed:
        out[1] = new / count - old / before if before else 0.0
        out[5] = 1.0


_gel_mean = compiled(gel_mean_python)
