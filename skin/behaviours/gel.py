"""Mean temperature of the gels in contact, while units come, go and fall silent.

All gels follow the temperature of a contact with the same lag, from any start. So does their mean
over a fixed set of units. Where the set changes, the mean jumps; the jump is reported, so that a
filter can subtract it. A gel at the upper rail of its wire has at least that temperature: this is a
bound, and not part of the mean.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled
from skin.behaviours.checks import check_patches, check_state
from skin.decode.limits import gel_rail_c
from skin.physics.least_squares import robust_sigma
from skin.state import State, if_wanted
from topology import Topology

__all__ = ["SMOOTH_S", "Gel", "GelMean"]

ON_SIGMAS, OFF_SIGMAS = 5.0, 2.0
"""Normal force over its sigma at which a unit becomes touched, and at which it ceases to be
[derived: once per hour of 32 units at 250 Hz, by noise]."""

LEAST_SIGMA_N = 0.005
"""Lower bound of the sigma of a normal force, and its value where it is unknown [assumed]."""

SMOOTH_S = 0.2
"""Time constant of the temperatures from which jumps are computed [assumed]."""

DEFAULT_SIGMA_C = 1.0
"""Of the constants of a unit without sigma [derived: the default of topologies]."""

LEAST_C, MOST_C = -100.0, 1000.0
"""Readings beyond are not temperatures of a gel [assumed]."""

COMPARE_S = 0.1
"""Interval of the search for outliers [assumed]."""

ASIDE_SIGMAS, ASIDE_C = 5.0, 3.0
"""Distance below the median at which a unit is an outlier: in robust sigmas of all units, and at
least three one-sigmas of a unit's constants [derived]."""

LEAST_COMPARED = 3
"""Units needed to find an outlier: of two, either may be wrong [derived]."""


class GelMean(NamedTuple):
    """Mean temperature of a cycle.

    Attributes
    ----------
    mean_c : float
        NaN where no touched unit is heard.
    jump_c : float
        Difference of the mean to that of the set of units before.
    sigma_c : float
        Of its constant errors: of the units' constants, and the standard error of their
        differences, which covers a single wrong unit.
    count : int
        Units in the mean.
    touched : int
        Touched units, heard or not.
    changed : bool
        Whether the set has changed.
    bound_c : float
        Lower bound by the hottest touched gel at its rail; NaN where there is none.
    """

    mean_c: float
    jump_c: float
    sigma_c: float
    count: int
    touched: int
    changed: bool
    bound_c: float


class Gel:
    """Computes the mean, cycle by cycle.

    Parameters
    ----------
    topology : Topology
    names : iterable of str, optional
        Patches; all of them if not given.

    Raises
    ------
    OptionError
        No patch, one that does not exist, or one twice.
    """

    def __init__(self, topology: Topology, names: Iterable[str] | None = None) -> None:
        wanted = check_patches(topology, names)
        chosen = [i for i, name in enumerate(topology.patch_names) if name in wanted]
        self._of_pads = np.isin(topology.patch, chosen)
        self._touched = np.zeros(topology.n, bool)
        self._members = np.zeros(topology.n, bool)
        self._aside = np.zeros(topology.n, bool)
        self._every = max(1, round(COMPARE_S * topology.cycle_rate_hz))
        self._cycle = 0
        self._smooth = np.full(topology.n, np.nan)
        self._gain = min(1.0, 1.0 / (SMOOTH_S * topology.cycle_rate_hz))
        self._no_sigma = np.full((3, topology.n), np.nan, np.float32)
        self._no_spread = np.full(topology.n, np.nan, np.float32)
        self._rail_c = np.minimum(gel_rail_c(topology), MOST_C)
        self._out = np.zeros(7)
        self._last: tuple[np.ndarray, ...] = ()

    def read(self, state: State) -> GelMean:
        """The mean in this cycle; `state` has force and temperature, and preferably their sigma.

        Raises
        ------
        OptionError
            The state is of another topology, or has no force or temperature.
        """
        units = state.units
        last = self._last
        if not last or if_wanted(units, "force") is not last[0] or (
            if_wanted(units, "temperature") is not last[2]
        ):  # fmt: skip
            check_state(state, self._touched.size, "force", "temperature")
        sigma, spread = if_wanted(units, "force_sigma"), if_wanted(units, "temperature_sigma")
        sigma = self._no_sigma if sigma is None else sigma
        spread = self._no_spread if spread is None else spread
        self._last = last = (units.force, sigma, units.temperature, spread, units.valid)
        if self._cycle % self._every == 0:
            self._set_aside(units.valid)
        self._cycle += 1
        _gel_mean(
            last, (self._of_pads, self._aside, self._rail_c), self._touched, self._members,
            self._smooth, self._gain, self._out,
        )  # fmt: skip
        mean, jump, sigma_c, count, touched, changed, bound = self._out.tolist()
        return GelMean(mean, jump, sigma_c, int(count), int(touched), changed > 0.0, bound)

    def reset(self) -> None:
        """Empty the set of units."""
        self._members[:] = self._aside[:] = False

    def _set_aside(self, valid: np.ndarray) -> None:
        """Find outliers: units far colder than the other touched ones."""
        celsius = self._smooth[self._of_pads & self._touched & valid]
        celsius = celsius[np.isfinite(celsius)]
        self._aside[:] = False
        if celsius.size >= LEAST_COMPARED:
            middle = np.median(celsius)
            width = robust_sigma(celsius)
            self._aside[:] = self._smooth < middle - max(ASIDE_C, ASIDE_SIGMAS * width)


def gel_mean_python(readings, marks, touched, members, smooth, gain, out):
    """See `Gel.read`; `marks` are units of the pads, outliers, and the rails of the gels; `out` is
    `GelMean`."""
    force, force_sigma, temperature, spread, valid = readings
    of_pads, aside, rail_c = marks
    bound = np.nan
    count, before, among, changed = 0, 0, 0, False
    total, old, new, squares, variances = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(touched.size):
        if not of_pads[i]:
            continue
        here = temperature[i]
        heard = valid[i] and LEAST_C < here < rail_c[i]  # False where it is NaN
        if valid[i] and not np.isnan(force[2, i]):
            sigma = force_sigma[2, i]
            sigma = max(sigma, LEAST_SIGMA_N) if np.isfinite(sigma) else LEAST_SIGMA_N
            touched[i] = force[2, i] > (OFF_SIGMAS if touched[i] else ON_SIGMAS) * sigma
        if heard:
            smooth[i] = here if np.isnan(smooth[i]) else smooth[i] + gain * (here - smooth[i])
        among += 1 if touched[i] else 0
        if touched[i] and valid[i] and rail_c[i] <= here < MOST_C and not bound >= here:
            bound = here
        if members[i]:
            before += 1
            old += smooth[i]
        now = touched[i] and heard and not aside[i]
        if now:
            count += 1
            total += here
            new += smooth[i]
            squares += smooth[i] ** 2
            own = spread[i] if np.isfinite(spread[i]) else DEFAULT_SIGMA_C
            variances += own * own
        changed = changed or now != members[i]
    out[0], out[1], out[2], out[3], out[4], out[5] = np.nan, 0.0, np.nan, count, among, 0.0
    out[6] = bound
    if count == 0:
        return
    out[0] = total / count
    scatter = max(squares - new * new / count, 0.0) / max(count - 1, 1)
    out[2] = np.sqrt((variances / count + scatter) / count)
    if changed:
        for i in range(touched.size):
            members[i] = (
                of_pads[i] and touched[i] and valid[i] and not aside[i]
                and LEAST_C < temperature[i] < rail_c[i]
            )  # fmt: skip
        out[1] = new / count - old / before if before else 0.0
        out[5] = 1.0


_gel_mean = compiled(gel_mean_python)
