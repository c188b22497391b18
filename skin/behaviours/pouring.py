"""Pouring: how fast a held vessel fills, in which stage, and how much is in it.

What hangs on the pads is the vertical sum of their forces. It grows with a flow that is taken for
constant until the weight disagrees. Hot water warms what is there as well: how many degrees a
millilitre brings is learned while the flow is strong, and then the rise of the temperature tells a
flow that is too weak for the weight alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from skin.behaviours.decision import Decisions
from skin.behaviours.kalman import Kalman, Noise
from skin.behaviours.pads import PadLoads, Pads
from skin.behaviours.warmth import Warmth
from skin.errors import check_numbers
from skin.state import State
from topology import Topology

__all__ = ["Pouring", "PouringSettings", "water_density"]


class Row(IntEnum):
    """States of the filter: mass, kilogram, and its rise."""

    MASS = 0
    FLOW = 1


G = 9.80665

FIRST_NOISE_KG = 0.005
"""One-sigma of the noise of a weight, before it is learned [assumed]."""

TARE_S = 1.0
"""In which what hangs there already is weighed [derived: 2 g of noise fall to 0.2 g]."""

LEARN_S, APART_S = 3.0, 1.0
"""Time constant of what a millilitre warms, which falls as the vessel fills [assumed]; and time
after which rates and flows have errors of their own [derived: the filters' own]."""

FIRST_SHARE, FIRST_SPREAD = 0.6, 0.4
"""Heat capacity of a vessel with something in it, over that of as much water, before any is poured,
and its relative one-sigma [assumed: between empty glass and water]."""

FALL_SPREAD = 0.2
"""Relative one-sigma of what a millilitre warms, since it was learned [assumed]."""


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
    """What counts as which flow, and what is known of the measurement.

    Attributes
    ----------
    high_ml_per_s, low_ml_per_s, least_ml_per_s : float
        From which on a flow is "high", "low" and "micro" [paper: 15, 8 and about 1 ml/s in its
        three stages; assumed: the means of these in between].
    jump_ml_per_s : float
        By how much a flow may jump: one-sigma [assumed: a tap].
    drift_ml_per_s15 : float
        How fast it changes otherwise: its one-sigma after a second [assumed].
    gain_sigma : float
        Of forces, relative, the same for all units [assumed].
    hot_c : float
        Of what is poured, where that is known; else NaN, and the weight alone tells the first flow.
    down : tuple of 3 float
        Where weight points, skin frame.
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


class Pouring:
    """Watches a vessel fill, from `begin` on.

    Parameters
    ----------
    topology : Topology
    names : iterable of str, optional
        Patches that hold it; all of them if not given.
    settings : PouringSettings
    warmth : Warmth, optional
        Of what is held; it is to be updated first. Without it, the weight alone tells.

    Attributes
    ----------
    weight_n : float
        What hangs on the pads, in this cycle; NaN where it is not known.
    poured_ml, sigma_ml : float
        Since `begin`; NaN before it.
    flow_ml_per_s, flow_sigma_ml_per_s : float
    stage : str
        "none", "micro", "low" or "high".
    began : bool
        Whether what hung there has been weighed.
    known : bool
        Whether the weight is heard.
    c_per_ml : float
        What a millilitre warms, where that is learned; else NaN.
    decisions : Decisions
    """

    fields = (
        "weight_n", "poured_ml", "sigma_ml", "flow_ml_per_s", "flow_sigma_ml_per_s", "stage",
        "began", "known",
    )  # fmt: skip

    def __init__(
        self, topology: Topology, names: Iterable[str] | None = None,
        settings: PouringSettings = PouringSettings(),
        warmth: Warmth | None = None,
    ) -> None:  # fmt: skip
        self.settings, self.warmth = settings, warmth
        self.decisions = Decisions()
        self._pads = Pads(topology, names)
        self._period_s = 1.0 / topology.cycle_rate_hz
        flows = np.array([[0.0, 1.0], [0.0, 0.0]])
        intensity = np.diag([0.0, (1e-3 * settings.drift_ml_per_s15) ** 2])
        self._filter = Kalman(flows, intensity, self._period_s)
        down = np.array(settings.down, float)
        self._down = tuple((down / np.linalg.norm(down)).tolist())
        self._first_ns: int | None = None
        self._last_ns: int | None = None
        self.weight_n = self.poured_ml = self.sigma_ml = math.nan
        self.flow_ml_per_s = self.flow_sigma_ml_per_s = self.c_per_ml = math.nan
        self.stage, self.began, self.known = "none", False, False
        self._noise = Noise(FIRST_NOISE_KG**2, self._period_s)
        self._wanted = False

    def begin(self) -> None:
        """Weigh what hangs there within the next second, and count from then on. It must hang
        still."""
        self._wanted, self.began = True, False
        self._tare, self._tared, self._weighed = 0.0, 0.0, 0
        self._squares = self._products = 0.0
        self._jumps = 0 if self.warmth is None else self.warmth.jumps
        self.poured_ml = self.sigma_ml = self.c_per_ml = math.nan
        self.flow_ml_per_s = self.flow_sigma_ml_per_s = math.nan
        self.stage = "none"

    def end(self) -> None:
        """Count no longer; what was poured stays."""
        self._wanted = False
        if self.stage != "none":
            self.stage = "none"
            self._say("end", f"{self.poured_ml:.1f} ± {self.sigma_ml:.1f} ml")

    def update(self, state: State, loads: PadLoads | None = None) -> None:
        """Look at a cycle; `loads` are those of the same pads, where somebody has read them."""
        loads = self._pads.read(state) if loads is None else loads
        if self._first_ns is None or self._last_ns is None:
            self._first_ns = self._last_ns = state.stamp_ns
        self._time_s = 1e-9 * (state.stamp_ns - self._first_ns)
        steps = max(round(1e-9 * (state.stamp_ns - self._last_ns) / self._period_s), 0)
        self._last_ns = state.stamp_ns
        x, y, z = self._down
        force = loads.force_n
        self.weight_n = float(
            x * sum(force[0].tolist()) + y * sum(force[1].tolist()) + z * sum(force[2].tolist())
        )
        known = not math.isnan(self.weight_n)
        if known != self.known:
            self.known = known
            what = "weight is known" if known else "weight is not known"
            self._say(what, f"{float(loads.heard.min()):.0%} of a pad's load is heard at least")
        self._noise.update(self.weight_n / G)
        if not self._wanted:
            return
        if self.began:
            self._follow(steps)
            self._tell()
        elif known:
            self._weigh()

    def _weigh(self) -> None:
        """Mean of what hangs there, first."""
        self._weighed += 1
        self._tare += (self.weight_n / G - self._tare) / self._weighed
        if self._weighed * self._period_s < TARE_S:
            return
        variance = self._noise.variance / self._weighed
        self._tared = variance
        self._filter.begin(np.array([self._tare, 0.0]), np.diag([variance, 1e-6]))
        self.began = True
        self._say("tare", f"{1e3 * self._tare:.1f} ± {1e3 * variance**0.5:.1f} g")

    def _follow(self, steps: int) -> None:
        filter = self._filter
        filter.update(Row.MASS, self.weight_n / G, self._noise.variance, steps)
        warmer = 0 if self.warmth is None else self.warmth.jumps
        if filter.changed or warmer != self._jumps:
            filter.open(Row.FLOW, 1e-3 * self.settings.jump_ml_per_s)
        self._jumps = warmer
        celsius = 20.0 if self.warmth is None else self.warmth.inside_c
        density = water_density(20.0 if math.isnan(celsius) else min(max(celsius, 0.0), 100.0))
        mass, flow = filter.x.tolist()
        gained = mass - self._tare
        self.poured_ml = 1e3 * gained / density
        random = filter.covariance[Row.MASS, Row.MASS] + self._tared
        own = self.settings.gain_sigma * gained
        self.sigma_ml = 1e3 * math.sqrt(float(random) + own * own) / density
        self.flow_ml_per_s = 1e3 * flow / density
        self.flow_sigma_ml_per_s = 1e3 * filter.sigma(Row.FLOW) / density
        if self.warmth is not None and self.warmth.known:
            self._warm(self.warmth)

    def _warm(self, warmth: Warmth) -> None:
        """Learn what a millilitre warms from strong flows, and weak flows from that."""
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
        told = rate / self.c_per_ml
        told_sigma = math.hypot(rate_sigma / self.c_per_ml, spread * told)
        own, other = 1.0 / sigma**2, 1.0 / told_sigma**2
        self.flow_ml_per_s = (own * flow + other * told) / (own + other)
        self.flow_sigma_ml_per_s = (own + other) ** -0.5

    def _tell(self) -> None:
        """The stage, which stays until the flow is beyond a bound by half a sigma."""
        flow, slack, ask = (
            max(self.flow_ml_per_s, 0.0),
            0.5 * self.flow_sigma_ml_per_s,
            self.settings,
        )
        bounds = ask.least_ml_per_s, ask.low_ml_per_s, ask.high_ml_per_s
        names = "none", "micro", "low", "high"
        now = names.index(self.stage)
        low = sum(flow - slack >= bound for bound in bounds)
        high = sum(flow + slack >= bound for bound in bounds)
        found = min(max(now, low), high)
        if found != now:
            self.stage = names[found]
            what = f"{self.stage} flow" if found else "no flow"
            why = f"{flow:.2f} ± {2.0 * slack:.2f} ml/s after {self.poured_ml:.1f} ml"
            self._say(what, why)

    def _say(self, what: str, why: str) -> None:
        self.decisions.add(self._time_s, what, why)
