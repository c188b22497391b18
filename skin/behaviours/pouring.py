"""Pouring: flow into a held vessel, its stage, and the poured volume.

The load of the pads is the vertical sum of their forces. It grows with a flow that is modelled as
constant until the weight disagrees. Hot water also warms the contents: the warming per millilitre
is learned while the flow is strong, and then the rise of the temperature measures a flow that is
too weak for the weight alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from skin.behaviours.decision import Decisions
from skin.behaviours.heard_units import HeardUnits
from skin.behaviours.kalman import INNOVATION_S, Kalman, Noise
from skin.behaviours.numbers import unit_vector
from skin.behaviours.pads import PadLoads, Pads
from skin.behaviours.warmth import Warmth
from skin.errors import check_kind, check_number, check_numbers
from skin.state import State
from topology import Topology

__all__ = ["Pouring", "PouringSettings", "water_density"]


class Row(IntEnum):
    """States of the filter, kilogram: the measured weight, its rise, the gain. The zero of the
    first depends on the set of heard units, that of the last does not."""

    MEASURED = 0
    FLOW = 1
    GAINED = 2


G = 9.80665

FIRST_NOISE_KG = 0.005
"""One-sigma of the noise of a weight, before it is learned [assumed]."""

TARE_S = 1.0
"""Duration of the tare [derived: 2 g of noise fall to 0.2 g]."""

FIRST_FLOW_KG_PER_S = 0.001
"""One-sigma of the flow during the tare [assumed]."""

LEARN_S, APART_S = 3.0, 1.0
"""Time constant of the warming per millilitre, which falls as the vessel fills [assumed]; and time
after which errors of rates and flows are independent [derived: the filters' own]."""

FIRST_SHARE, FIRST_SPREAD = 0.6, 0.4
"""Heat capacity of a vessel and its contents, over that of as much water, before pouring, and its
relative one-sigma [assumed: between empty glass and water]."""

INNOVATION_LONG_S = 0.5
"""Time constant of the mean of innovations that detects a small change of flow [derived: 3 ml/s
within a second, of 32 units]."""

UNHEARD_S, STALE_S = INNOVATION_S, 0.5
"""Silence after which the flow may have stopped or jumped [derived: the time to detect that]; and
after which no stage is reported [assumed: half of the second in which it is wanted]."""

UNSEEN_S = INNOVATION_S / 3**0.5
"""Undetected duration of a jump of flow: one-sigma [derived: uniform, up to `INNOVATION_S`]."""

HUNG_S = 0.1
"""Time constant of the load of each pad, used for units that fall silent [assumed]."""

LEFT_SPREAD = 0.5
"""Relative difference between the distribution of poured and of earlier load over silent units
[assumed: as in `PadLoads`]."""

FALL_SPREAD = 0.2
"""Relative one-sigma of the warming per millilitre, since it was learned [assumed]."""


def water_density(celsius: float) -> float:
    """Density of water, kilogram per litre: Kell (1975) to 1e-4 from 0 to 100 °C.

    Examples
    --------
    >>> round(water_density(4.0), 4), round(water_density(80.0), 4)
    (1.0, 0.9718)
    """
    t = celsius
    top = 999.83952 + t * (16.945176 + t * (-7.9870401e-3 + t * (
        -46.170461e-6 + t * (105.56302e-9 - t * 280.54253e-12))))  # fmt: skip
    return 1e-3 * top / (1.0 + 16.879850e-3 * t)


@dataclass(frozen=True)
class PouringSettings:
    """Thresholds of flows, and priors of the measurement.

    Attributes
    ----------
    high_ml_per_s, low_ml_per_s, least_ml_per_s : float
        Lower bounds of a "high", "low" and "micro" flow [paper: 15, 8 and about 1 ml/s in its three
        stages; assumed: the means of these in between].
    jump_ml_per_s : float
        One-sigma of a jump of flow [assumed: a tap].
    drift_ml_per_s15 : float
        One-sigma of its other changes after a second [assumed].
    gain_sigma : float
        Relative, of forces, common to all units [assumed].
    hot_c : float
        Of the poured liquid, if known; else NaN, and the first flow is measured by weight alone.
    down : tuple of 3 float
        Direction of gravity, skin frame.
    """

    high_ml_per_s: float = 10.0
    low_ml_per_s: float = 3.5
    least_ml_per_s: float = 0.4
    jump_ml_per_s: float = 8.0
    drift_ml_per_s15: float = 0.1
    gain_sigma: float = 0.01
    hot_c: float = math.nan
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)

    def __post_init__(self) -> None:
        check_numbers(1e-3, 1e3, least_ml_per_s=self.least_ml_per_s)
        check_numbers(self.least_ml_per_s, 1e3, low_ml_per_s=self.low_ml_per_s)
        check_numbers(self.low_ml_per_s, 1e3, high_ml_per_s=self.high_ml_per_s)
        check_numbers(1e-6, 1e3, jump_ml_per_s=self.jump_ml_per_s)
        check_numbers(1e-6, 1e3, drift_ml_per_s15=self.drift_ml_per_s15)
        check_numbers(0.0, 1.0, gain_sigma=self.gain_sigma)
        if not (isinstance(self.hot_c, float) and math.isnan(self.hot_c)):
            check_number("hot_c", self.hot_c, -273.15, 1e4)
        unit_vector("down", self.down)


class Pouring:
    """Monitors the filling of a vessel, from `begin` on.

    Parameters
    ----------
    topology : Topology
    names : iterable of str, optional
        Patches that hold it; all of them if not given.
    settings : PouringSettings
    warmth : Warmth, optional
        Of the held vessel, updated by the caller before. Without it, only the weight is used.

    Attributes
    ----------
    weight_n : float
        Load of the pads, in this cycle; NaN where it is unknown.
    poured_ml, sigma_ml : float
        Since `begin`; NaN before it. Sigma includes the possible load of silent units and, while
        nothing is heard, a stop or jump of the flow.
    flow_ml_per_s, flow_sigma_ml_per_s : float
    stage : str
        "none", "micro", "low" or "high"; "unknown" while nothing is heard for half a second.
    began : bool
        Whether the tare has been taken.
    known : bool
        Whether the weight is heard.
    c_per_ml : float
        Warming per millilitre, once it is learned; else NaN.
    decisions : Decisions
    """

    def __init__(
        self, topology: Topology, names: Iterable[str] | None = None,
        settings: PouringSettings = PouringSettings(),
        warmth: Warmth | None = None,
    ) -> None:  # fmt: skip
        check_kind("topology", topology, Topology)
        check_kind("settings", settings, PouringSettings)
        if warmth is not None:
            check_kind("warmth", warmth, Warmth)
        self.settings, self.warmth = settings, warmth
        self.decisions = Decisions()
        self._pads = Pads(topology, names)
        self._period_s = 1.0 / topology.cycle_rate_hz
        flows = np.zeros((3, 3))
        flows[[Row.MEASURED, Row.GAINED], Row.FLOW] = 1.0
        intensity = np.diag([0.0, (1e-3 * settings.drift_ml_per_s15) ** 2, 0.0])
        self._filter = Kalman(flows, intensity, self._period_s, (INNOVATION_S, INNOVATION_LONG_S))
        self._down = np.array(unit_vector("down", settings.down))
        self._units = HeardUnits(topology, self._pads.names)
        self._hung = np.zeros(len(self._pads.names))
        self._first_ns: int | None = None
        self._last_ns: int | None = None
        self.weight_n = self.poured_ml = self.sigma_ml = math.nan
        self.flow_ml_per_s = self.flow_sigma_ml_per_s = self.c_per_ml = math.nan
        self.stage, self.began, self.known = "none", False, False
        self._noise = Noise(FIRST_NOISE_KG**2, self._period_s)
        self._wanted = False
        self._unheard_s = 0.0

    def begin(self) -> None:
        """Tare within the next second, and count from then on. The vessel must hang still."""
        self._wanted, self.began = True, False
        self._tare, self._tared, self._weighed = 0.0, 0.0, 0
        self._scale = 1.0  # from the measured weight to the whole one
        self._filled, self._filled_at, self._filled_variance = 0.0, 0.0, 0.0
        self._scaled_s = math.inf
        self._level = 0
        self._squares = self._products = 0.0
        self._jumps = 0 if self.warmth is None else self.warmth.jumps
        self.poured_ml = self.sigma_ml = self.c_per_ml = math.nan
        self.flow_ml_per_s = self.flow_sigma_ml_per_s = math.nan
        self.stage = "none"

    def end(self) -> None:
        """Stop counting; the poured volume stays."""
        self._wanted = False
        if self.stage != "none":
            self.stage = "none"
            self._say("end", f"{self.poured_ml:.1f} ± {self.sigma_ml:.1f} ml")

    def update(self, state: State, loads: PadLoads | None = None) -> None:
        """Process a cycle; `loads` are those of the same pads, if they were read already."""
        loads = self._pads.read(state) if loads is None else loads
        if self._first_ns is None or self._last_ns is None:
            self._first_ns = self._last_ns = state.stamp_ns
        self._time_s = 1e-9 * (state.stamp_ns - self._first_ns)
        steps = max(round(1e-9 * (state.stamp_ns - self._last_ns) / self._period_s), 0)
        self._last_ns = state.stamp_ns
        hung = self._down @ loads.force_n
        self.weight_n = float(hung.sum())
        known = math.isfinite(self.weight_n)
        if known != self.known:
            self.known = known
            what = "weight is known" if known else "weight is not known"
            self._say(what, f"{float(loads.heard.min()):.0%} of a pad's load is heard at least")
        changed = self._units.update(state, loads, self._hung) if known else 0.0
        self._noise.update(self.weight_n / G, not changed)
        if self._wanted and self.began and changed:
            self._other_units(changed)
        if known:
            gain = 1.0 if changed else min(1.0, self._period_s / HUNG_S)
            self._hung += gain * (hung - self._hung)
        if not self._wanted:
            return
        if self.began:
            self._follow(steps)
            self._report()
        elif known:
            self._weigh()

    def _weigh(self) -> None:
        """Mean of the load, for the tare."""
        self._weighed += 1
        self._tare += (self.weight_n / G - self._tare) / self._weighed
        if self._weighed * self._period_s < TARE_S:
            return
        variance = self._noise.variance / self._weighed
        self._tared = variance
        covariance = np.full((3, 3), variance)
        covariance[Row.FLOW, :] = covariance[:, Row.FLOW] = 0.0
        covariance[Row.FLOW, Row.FLOW] = FIRST_FLOW_KG_PER_S**2
        self._filter.begin(np.array([self._tare, 0.0, 0.0]), covariance)
        self._units.keep()
        self.began = True
        self._say("tare", f"{1e3 * self._tare:.1f} ± {1e3 * variance**0.5:.1f} g")

    def _other_units(self, lost_n: float) -> None:
        """The set of heard units has changed: their weight has another zero, and perhaps another
        scale."""
        filter = self._filter
        weight, gained = float(filter.x[Row.MEASURED]), float(filter.x[Row.GAINED])
        since = self._filled * (gained - self._filled_at)
        self._filled_at = gained
        if self._units.as_kept:  # the set at the tare: the same zero
            self._filled, self._filled_variance, self._scale = 0.0, 0.0, 1.0
            filter.equate(Row.MEASURED, Row.GAINED, self._tare)
            self._scaled_s = math.inf
            return
        self._filled_variance += since * since
        share = lost_n / (G * max(weight, 1e-3))
        self._filled = math.hypot(self._filled, share)
        filter.shift(Row.MEASURED, 0.0, (lost_n / G) ** 2)
        self._scaled_s = self._time_s + TARE_S

    def _rescale(self) -> None:
        """Compute the scale of the new set of units, since the load is the same as before."""
        filter = self._filter
        weight, hangs = float(filter.x[Row.MEASURED]), self._tare + float(filter.x[Row.GAINED])
        self._scaled_s = math.inf
        if not 0.2 * weight < hangs < 5.0 * weight:
            return
        own = filter.covariance
        off = own[Row.MEASURED, Row.MEASURED] + own[Row.GAINED, Row.GAINED]
        off = max(float(off - 2.0 * own[Row.MEASURED, Row.GAINED]), 0.0)
        scale = hangs / weight
        self._scale *= scale
        filter.scale(Row.MEASURED, scale)
        gained = float(filter.x[Row.GAINED])
        since = self._filled * (gained - self._filled_at)
        self._filled_variance += since * since
        self._filled_at = gained
        self._filled = math.hypot(LEFT_SPREAD * self._filled, math.sqrt(off) / hangs)

    def _follow(self, steps: int) -> None:
        filter = self._filter
        before_s, self._unheard_s = self._unheard_s, self._unheard_s + steps * self._period_s
        if before_s <= UNHEARD_S + self._period_s < self._unheard_s:
            jump = max(1e-3 * self.settings.jump_ml_per_s, abs(float(filter.x[Row.FLOW])))
            filter.jump(Row.FLOW, jump, round(before_s / self._period_s))
        weight = self._scale * self.weight_n / G
        variance = self._scale**2 * self._noise.variance
        filter.update(Row.MEASURED, weight, variance, steps)
        if self.known:
            self._unheard_s = 0.0
        warmer = 0 if self.warmth is None else self.warmth.jumps
        if filter.changed or warmer != self._jumps:
            filter.inflate(Row.FLOW, 1e-3 * self.settings.jump_ml_per_s)
        self._jumps = warmer
        if self._time_s >= self._scaled_s and self.known:
            self._rescale()
        celsius = 20.0 if self.warmth is None else self.warmth.inside_c
        density = water_density(20.0 if math.isnan(celsius) else min(max(celsius, 0.0), 100.0))
        flow, gained = filter.x[Row.FLOW :].tolist()
        self.poured_ml = 1e3 * gained / density
        since = self._filled * (gained - self._filled_at)
        self.sigma_ml = 1e3 / density * math.hypot(
            filter.sigma(Row.GAINED), math.sqrt(self._tared), since,
            math.sqrt(variance) * filter.lag,
            1e-3 * self.settings.jump_ml_per_s * UNSEEN_S,
            math.sqrt(self._filled_variance), self.settings.gain_sigma * gained,
        )  # fmt: skip
        self.flow_ml_per_s = 1e3 * flow / density
        own = math.hypot(filter.sigma(Row.FLOW), self._filled * flow)
        self.flow_sigma_ml_per_s = 1e3 * own / density
        warmth = self.warmth
        if warmth is not None and math.isfinite(warmth.gel_c) and warmth.phase != "unknown":
            self._warm(warmth)

    def _warm(self, warmth: Warmth) -> None:
        """Learn the warming per millilitre from strong flows, and weak flows from that."""
        rate, rate_sigma = warmth.rate_c_per_s, warmth.rate_sigma_c_per_s
        flow, sigma = self.flow_ml_per_s, self.flow_sigma_ml_per_s
        coldness_c = self.settings.hot_c - warmth.inside_c
        if not self._squares and coldness_c > 1.0:
            first = coldness_c / (1e3 * FIRST_SHARE * self._tare)
            self._squares = 1.0 / (FIRST_SPREAD * first) ** 2
            self._products = first * self._squares
        if flow > 5.0 * sigma and rate > 5.0 * rate_sigma:
            keep = 1.0 - self._period_s / LEARN_S
            first = 0.0 if math.isnan(self.c_per_ml) else self.c_per_ml
            variance = rate_sigma**2 + (first * sigma) ** 2
            gained = self._period_s / APART_S * flow / variance
            self._squares = keep * self._squares + gained * flow
            self._products = keep * self._products + gained * rate
        if not self._products > 0.0:
            return
        self.c_per_ml = self._products / self._squares
        spread = math.hypot(FALL_SPREAD, 1.0 / math.sqrt(self._squares) / self.c_per_ml)
        flow_by_rate = rate / self.c_per_ml
        by_rate_sigma = math.hypot(rate_sigma / self.c_per_ml, spread * flow_by_rate)
        own, other = 1.0 / sigma**2, 1.0 / by_rate_sigma**2
        self.flow_ml_per_s = (own * flow + other * flow_by_rate) / (own + other)
        self.flow_sigma_ml_per_s = (own + other) ** -0.5

    def _report(self) -> None:
        """Report the stage, with a hysteresis of half a sigma."""
        flow, slack, ask = (
            max(self.flow_ml_per_s, 0.0),
            0.5 * self.flow_sigma_ml_per_s,
            self.settings,
        )
        bounds = ask.least_ml_per_s, ask.low_ml_per_s, ask.high_ml_per_s
        names = "none", "micro", "low", "high"
        if self._unheard_s > STALE_S:
            if self.stage != "unknown":
                self.stage = "unknown"
                self._say("flow is not known", f"nothing is heard for {self._unheard_s:.1f} s")
            return
        now = self._level
        low = sum(flow - slack >= bound for bound in bounds)
        high = sum(flow + slack >= bound for bound in bounds)
        if self.stage == "unknown" and high - low > 1:
            return
        self._level = found = min(max(now, low), high)
        if names[found] != self.stage:
            self.stage = names[found]
            what = f"{self.stage} flow" if found else "no flow"
            why = f"{flow:.2f} ± {2.0 * slack:.2f} ml/s after {self.poured_ml:.1f} ml"
            self._say(what, why)

    def _say(self, what: str, why: str) -> None:
        self.decisions.add(self._time_s, what, why)
