"""Warmth: true temperature of a held object, whether it heats or cools, and its limits.

The gel lags the contact by seconds, and a wall lags its contents. Both lags are known, so that a
Kalman filter can invert them: its states are the inside temperature, its rate, the wall's surface
and the gel. The surface temperature matters to a person who touches it, the inside temperature to a
solution or to tea. A rate is modelled as constant until the gels disagree; phases change where it
exceeds its noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from skin.behaviours.decision import Decisions
from skin.behaviours.gel import SMOOTH_S, Gel, GelMean
from skin.behaviours.kalman import INNOVATION_S, Kalman, Noise
from skin.behaviours.numbers import check_pair
from skin.errors import check_kind, check_number, check_numbers
from skin.state import State
from topology import Topology

__all__ = ["Warmth", "WarmthSettings"]


class Row(IntEnum):
    """States of the filter: inside temperature, its rate, outer face, mean gel."""

    INSIDE = 0
    RATE = 1
    WALL = 2
    GEL = 3


FIRST_SIGMA_C, WALL_SIGMA_C = 30.0, 2.0
"""One-sigma at the first contact: of the inside temperature, and of the wall's difference to it
[assumed: any cup that has stood for a while]."""

FIRST_RATE_C_PER_S = 1.0
"""One-sigma of the rate at the first contact [assumed]."""

KNOWN_SIGMA_C = 1.0
"""One-sigma up to which the temperature counts as known [assumed: a tenth of the usual bands]."""

FOUND_SIGMA_C = 3.0
"""One-sigma below which a result is measured and not assumed [derived: the prior of the first
contact then weighs a hundredth]."""

UNHEARD_S = INNOVATION_S
"""Silence after which the rate may have jumped [derived: the time in which a jump is detected;
fewer missing cycles lose nothing]."""

JUMP_ERROR = 0.02
"""Relative error of a jump of the mean gel where the set of units changes [assumed]."""

JUMPED_S = 2.0
"""Time after a change of rate in which its sign alone decides the phase [assumed]."""


@dataclass(frozen=True)
class WarmthSettings:
    """Properties of the contact, and limits.

    Attributes
    ----------
    gel_lag_s : float
        Lag of the gel behind the contact [1-D heat model, assumed].
    wall_lag_s : float
        Lag of the outer face behind the contents: of 1 mm of glass [derived: d²/a]; 0.05 for a
        solid object.
    lag_sigma_s : float
        One-sigma of the sum of both lags: times the rate, an error of the inside temperature
        [assumed: a tenth of the gel's].
    wall_sigma : float
        One-sigma of the relative difference of outer face and contents, above the gel's initial
        temperature [assumed: a cup in still air].
    jump_c_per_s : float
        One-sigma of a jump of the rate [assumed: a burner that is lit under a beaker].
    drift_c_per_s15 : float
        One-sigma of its other changes after a second [assumed: cooling by 40 K with a time constant
        of half a minute].
    noise_c : float
        One-sigma of the noise of a unit's temperature, before it is learned [assumed].
    turn_sigmas : float
        Rate over its sigma at which a phase begins, or half of it after the gels have disagreed;
        below half of it, it ends [derived: once in four hours by noise].
    band_c : (float, float)
        Target [paper: 60 to 75 °C for PVA].
    limit_c : float
        Upper limit [paper: 90 °C].
    hot_c : float
        Surface temperature for a warning [ISO 13732-1: a minute's contact].
    ahead_s : float
        Time before the limit, at this rate, at which it is reported [assumed].
    """

    gel_lag_s: float = 4.0
    wall_lag_s: float = 1.0
    lag_sigma_s: float = 0.4
    wall_sigma: float = 0.005
    jump_c_per_s: float = 2.0
    drift_c_per_s15: float = 0.04
    noise_c: float = 0.05
    turn_sigmas: float = 4.0
    band_c: tuple[float, float] = (60.0, 75.0)
    limit_c: float = 90.0
    hot_c: float = 51.0
    ahead_s: float = 2.0

    def __post_init__(self) -> None:
        check_numbers(1e-3, 1e3, gel_lag_s=self.gel_lag_s, wall_lag_s=self.wall_lag_s)
        check_numbers(1e-6, 1e3, jump_c_per_s=self.jump_c_per_s, noise_c=self.noise_c)
        check_numbers(1e-6, 1e3, drift_c_per_s15=self.drift_c_per_s15)
        check_numbers(1e-3, 100.0, turn_sigmas=self.turn_sigmas)
        check_numbers(0.0, 1e3, ahead_s=self.ahead_s, lag_sigma_s=self.lag_sigma_s)
        check_numbers(0.0, 1.0, wall_sigma=self.wall_sigma)
        low, high = check_pair("band_c", self.band_c)
        check_numbers(-273.15, 1e4, band_low=low, hot_c=self.hot_c)
        check_number("band_high", high, low, 1e4)
        check_number("limit_c", self.limit_c, high, 1e4)


class Warmth:
    """Monitors the temperature of an object held by pads.

    Parameters
    ----------
    topology : Topology
    names : iterable of str, optional
        Patches that hold it; all of them if not given.
    settings : WarmthSettings

    Attributes
    ----------
    inside_c, sigma_c : float
        Inside temperature, and its one-sigma; NaN before a contact.
    rate_c_per_s, rate_sigma_c_per_s : float
        Its rate.
    surface_c : float
        Of the outer face: contact temperature, corrected for the gel's lag.
    gel_c : float
        Mean of the units' readings; NaN where none is heard.
    phase : str
        "unknown", "steady", "heating" or "cooling".
    phase_began_s : float
        Since the first cycle: when the rate crossed zero, before it exceeded its noise.
    in_band, over_limit, hot, known : bool
        Within the band; at the limit, or there within `ahead_s`; too hot to touch; sigma is below 1
        °C. Without knowledge, one sigma is added before the comparison with limits. Warnings stay
        while nothing is heard, and after a release, until a new measurement. A gel at the rail of
        its wire is a lower bound, and while there is one, no warning ends.
    jumps : int
        Number of detected changes of the rate.
    decisions : Decisions

    Examples
    --------
    ::

        warmth = Warmth(skin.topology)
        for state in skin:
            warmth.update(state)
            if warmth.over_limit:
                flame.off()
    """

    def __init__(
        self, topology: Topology, names: Iterable[str] | None = None,
        settings: WarmthSettings = WarmthSettings(),
    ) -> None:  # fmt: skip
        check_kind("topology", topology, Topology)
        check_kind("settings", settings, WarmthSettings)
        self.settings = settings
        self.decisions = Decisions()
        self._gel = Gel(topology, names)
        self._period_s = 1.0 / topology.cycle_rate_hz
        flows = np.zeros((4, 4))
        flows[Row.INSIDE, Row.RATE] = 1.0
        for row, above, lag_s in ((Row.WALL, Row.INSIDE, settings.wall_lag_s),
                                  (Row.GEL, Row.WALL, settings.gel_lag_s)):  # fmt: skip
            flows[row, row], flows[row, above] = -1.0 / lag_s, 1.0 / lag_s
        intensity = np.zeros((4, 4))
        intensity[Row.RATE, Row.RATE] = settings.drift_c_per_s15**2
        self._filter = Kalman(flows, intensity, self._period_s)
        self._settled_c_per_s = self._filter.settled_sigma(
            Row.RATE, Row.GEL, settings.noise_c**2 / topology.n
        )
        self._first_ns: int | None = None
        self.reset()

    def reset(self) -> None:
        """Reset, including warnings."""
        self.over_limit = self.hot = False
        self._lose()

    def _lose(self) -> None:
        """Reset the estimates, but not the warnings."""
        nan = math.nan
        self.inside_c = self.sigma_c = self.rate_c_per_s = self.rate_sigma_c_per_s = nan
        self.surface_c = self.gel_c = self.phase_began_s = nan
        self._rate_before = self._crossed_s = 0.0
        self._jumped_s = -math.inf
        self.phase = "unknown"
        self.in_band = self.known = self._found = False
        self._last_ns: int | None = None
        self.jumps = 0
        self._free_s, self._is_free = 0.0, False
        self._unheard_s, self._heard, self._bound_c = 0.0, False, math.nan
        self._spread_c = 0.0
        self._gel.reset()

    def update(self, state: State) -> None:
        """Process a cycle."""
        if self._first_ns is None:
            self._first_ns = state.stamp_ns
        self._time_s = 1e-9 * (state.stamp_ns - self._first_ns)
        gel = self._gel.read(state)
        self.gel_c, self._bound_c = gel.mean_c, gel.bound_c
        if self._last_ns is None:
            self._heed_rail()
            if gel.count:
                self._begin(gel)
                self._last_ns = state.stamp_ns
            return
        steps = max(round(1e-9 * (state.stamp_ns - self._last_ns) / self._period_s), 0)
        self._last_ns = state.stamp_ns
        self._free_s = 0.0 if gel.touched else self._free_s + steps * self._period_s
        if self._free_s > self.settings.gel_lag_s:
            self.decisions.add(self._time_s, "nothing is held", f"for {self._free_s:.1f} s")
            self._lose()
            return
        self._follow(gel, steps)
        self._turn()
        self._watch()
        self._heed_rail()

    def _begin(self, gel: GelMean) -> None:
        own, between = FIRST_SIGMA_C**2, WALL_SIGMA_C**2
        covariance = np.zeros((4, 4))
        covariance[Row.INSIDE, Row.INSIDE] = covariance[Row.INSIDE, Row.WALL] = covariance[
            Row.WALL, Row.INSIDE
        ] = own
        covariance[Row.WALL, Row.WALL] = own + between
        covariance[Row.RATE, Row.RATE] = FIRST_RATE_C_PER_S**2
        covariance[Row.GEL, Row.GEL] = self.settings.noise_c**2
        self._filter.begin(np.array([gel.mean_c, 0.0, gel.mean_c, gel.mean_c]), covariance)
        self._noise = Noise(self.settings.noise_c**2 / gel.count, self._period_s)
        self._spread_c, self._room_c = gel.sigma_c, gel.mean_c
        self.decisions.add(self._time_s, "touched", f"gel at {gel.mean_c:.1f} °C")

    def _follow(self, gel: GelMean, steps: int) -> None:
        filter, noise = self._filter, self._noise
        noise.update(gel.mean_c, not gel.changed)
        steps = self._wait(gel, steps)
        if self._is_free and gel.count:
            filter.update(Row.GEL, math.nan, 1.0, steps)
            filter.restart(Row.GEL, gel.mean_c, noise.variance)
            steps = 0
        elif gel.changed:
            # smoothed differences lag, and differences decay with the gel's lag
            jump_c = gel.jump_c * math.exp(-SMOOTH_S / self.settings.gel_lag_s)
            filter.shift(Row.GEL, jump_c, noise.variance + (JUMP_ERROR * jump_c) ** 2)
        if gel.count:
            self._spread_c = gel.sigma_c
        if steps:
            filter.update(Row.GEL, gel.mean_c, noise.variance, steps)
        if gel.touched == 0:
            self._is_free = True
        elif gel.count:
            self._is_free = False
        if filter.changed:
            filter.inflate(Row.RATE, self.settings.jump_c_per_s)
            self.jumps += 1
            self._jumped_s = self._time_s
        self.inside_c, self.rate_c_per_s, self.surface_c, _ = filter.x.tolist()
        lost_c = self.settings.wall_sigma * (self.inside_c - self._room_c)
        lag_c = self.settings.lag_sigma_s * self.rate_c_per_s
        own_c = filter.sigma(Row.INSIDE)
        self.sigma_c = math.hypot(own_c, self._spread_c, lost_c, lag_c)
        self.rate_sigma_c_per_s = filter.sigma(Row.RATE)
        self.known = self.sigma_c < KNOWN_SIGMA_C
        self._heard = gel.count > 0
        self._found = self._found or own_c < FOUND_SIGMA_C

    def _wait(self, gel: GelMean, steps: int) -> int:
        """Predict to the last silent cycle but one, and let the rate jump after a long silence;
        returns the remaining steps."""
        before_s = self._unheard_s
        missed = steps - 1 if gel.count else steps
        self._unheard_s = before_s + missed * self._period_s
        if before_s <= UNHEARD_S < self._unheard_s:
            first = min(max(round((UNHEARD_S - before_s) / self._period_s), 0), missed)
            self._filter.update(Row.GEL, math.nan, 1.0, first)
            ago = round(UNHEARD_S / self._period_s)
            self._filter.jump(Row.RATE, self.settings.jump_c_per_s, ago)
            steps -= first
        if gel.count:
            self._unheard_s = 0.0
        return steps

    def _turn(self) -> None:
        """Heating, cooling or steady, where the rate exceeds its noise."""
        if not self._found:
            return
        rate, sigma = self.rate_c_per_s, self.rate_sigma_c_per_s
        most, settled = self.settings.turn_sigmas, self._settled_c_per_s
        found = self.phase
        direction = "heating" if rate > 0.0 else "cooling"
        if (rate > 0.0) != (self._rate_before > 0.0):
            self._crossed_s = self._time_s
        self._rate_before = rate
        jumped = self._time_s - self._jumped_s < JUMPED_S  # a change was detected
        if abs(rate) > most * (0.5 if jumped else 1.0) * max(sigma, settled):
            found = direction
        elif sigma < 2.0 * settled and abs(rate) < 0.5 * most * settled:
            found = "steady"
        if found != self.phase:
            self.phase = found
            self.phase_began_s = self._time_s if found == "steady" else self._crossed_s
            self.decisions.add(
                self._time_s, found, f"{self.rate_c_per_s:+.2f} ± {self.rate_sigma_c_per_s:.2f} "
                f"°C/s at {self.inside_c:.1f} °C",
            )  # fmt: skip

    def _watch(self) -> None:
        """Update band, limit and hot surface, with a sigma of hysteresis. A sigma is added where
        values are uncertain."""
        ask, sigma = self.settings, self.sigma_c
        is_railed = not math.isnan(self._bound_c)
        is_measured = self._found and self._heard and not is_railed  # otherwise no warning ends
        unsure = 0.0 if self.known else sigma
        low, high = ask.band_c
        slack = -sigma if self.in_band else 0.0
        in_band = low + slack <= self.inside_c <= high - slack
        if is_measured and in_band != self.in_band:
            self.in_band = in_band
            what = "in band" if in_band else "out of band"
            why = f"{self.inside_c:.1f} ± {sigma:.1f} °C, band {low:g} to {high:g} °C"
            self._say(what, why)
        rising = max(self.rate_c_per_s - 2.0 * self.rate_sigma_c_per_s, 0.0)
        coming_c = self.inside_c + rising * ask.ahead_s
        over = coming_c + unsure >= ask.limit_c - (sigma if self.over_limit else 0.0)
        if over != self.over_limit and (self._found if over else is_measured):
            self.over_limit = over
            self._say("limit" if over else "below limit",
                      f"{self.inside_c:.1f} ± {sigma:.1f} °C, {coming_c:.1f} °C in "
                      f"{ask.ahead_s:g} s; limit {ask.limit_c:g} °C")  # fmt: skip
        hot = self.surface_c + unsure >= ask.hot_c - (sigma if self.hot else 0.0)
        if hot != self.hot and (self._found if hot else is_measured):
            self.hot = hot
            why = f"surface {self.surface_c:.1f} ± {sigma:.1f} °C, limit {ask.hot_c:g} °C"
            self._say("hot" if hot else "not hot", why)

    def _heed_rail(self) -> None:
        """A gel at its rail is a lower bound, independent of the others."""
        for name, what, limit_c in (
            ("over_limit", "limit", self.settings.limit_c), ("hot", "hot", self.settings.hot_c),
        ):  # fmt: skip
            if self._bound_c >= limit_c and not getattr(self, name):
                setattr(self, name, True)
                self._say(what, f"a gel at its rail, {self._bound_c:.1f} °C; limit {limit_c:g} °C")

    def _say(self, what: str, why: str) -> None:
        self.decisions.add(self._time_s, what, why)
