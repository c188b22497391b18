"""Level: whether an object hangs evenly between two pads, and how far it is off their middle.

Two pads that hold a weight evenly bear half of it each, without torsion. A pad that is nearer to
the weight bears more; a weight off the line between them twists them, by torsion over weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skin.behaviours.checks import check_patches
from skin.behaviours.decision import Decisions
from skin.behaviours.numbers import unit_vector
from skin.behaviours.pads import PadLoads, Pads
from skin.errors import OptionError, check_kind, check_numbers, shown
from skin.state import State
from topology import Topology

__all__ = ["Level", "LevelSettings"]

LEFT_SIGMAS = 5.0
"""Distance beyond a bound at which the object is no longer level [derived: not by noise within
hours]."""


@dataclass(frozen=True)
class LevelSettings:
    """Bounds of level.

    Attributes
    ----------
    most_arm_m : float
        Between the weight and the line between the pads [assumed: a fifth of the pitch of units].
    most_imbalance : float
        Difference of what the two pads bear over their sum [assumed].
    least_n : float
        Weight below which nothing is reported [assumed: five sigma of two pads].
    mean_s : float
        Time constant of the means [derived: 0.3 s take noise of 2 mm to 0.2 mm].
    down : tuple of 3 float
        Direction of gravity, skin frame.
    """

    most_arm_m: float = 0.0025
    most_imbalance: float = 0.15
    least_n: float = 0.5
    mean_s: float = 0.3
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)

    def __post_init__(self) -> None:
        check_numbers(0.0, 1.0, most_arm_m=self.most_arm_m, most_imbalance=self.most_imbalance)
        check_numbers(1e-3, 1e3, least_n=self.least_n, mean_s=self.mean_s)
        unit_vector("down", self.down)


class Level:
    """Monitors two pads that face each other.

    Parameters
    ----------
    topology : Topology
    names : (str, str), optional
        Patches; the first two if not given.
    settings : LevelSettings

    Raises
    ------
    OptionError
        They are not two pads, or gravity is along their normals.

    Attributes
    ----------
    imbalance, imbalance_sigma : float
        Load of the first pad minus that of the second, over their sum; NaN where it is unknown.
    arm_m, arm_sigma_m : float
        Distance of the weight from the line between the pads, along `across`; NaN where it is
        unknown.
    across : ndarray, shape (3,)
        Unit vector, skin frame: horizontal, across that line.
    level, known : bool
    decisions : Decisions
    """

    def __init__(
        self, topology: Topology, names: tuple[str, str] | None = None,
        settings: LevelSettings = LevelSettings(),
    ) -> None:  # fmt: skip
        check_kind("topology", topology, Topology)
        check_kind("settings", settings, LevelSettings)
        pads = check_patches(topology, topology.patch_names[:2] if names is None else names)
        if len(pads) != 2:
            raise OptionError(f"pads: must be two that face each other; got {shown(pads)}")
        self.settings = settings
        self.decisions = Decisions()
        self._pads = Pads(topology, pads)
        self._down = np.array(unit_vector("down", settings.down))
        first = topology.patch == topology.patch_names.index(self._pads.names[0])
        normal = topology.rotation[:, 2, first].mean(axis=1)
        across = np.cross(self._down, normal)
        length = float(np.linalg.norm(across))
        if not length > 0.1:
            raise OptionError(
                f"down: must not be along the normal of pad {pads[0]!r}; got {settings.down}"
            )
        self.across = across / length
        self._gain = min(1.0, 1.0 / (settings.mean_s * topology.cycle_rate_hz))
        self._first_ns: int | None = None
        self.reset()

    def reset(self) -> None:
        """Reset the estimates."""
        self._lose()
        self._means: list[float] | None = None
        self._spreads = [0.0, 0.0]
        self._age = 0

    def _lose(self) -> None:
        self.imbalance = self.imbalance_sigma = self.arm_m = self.arm_sigma_m = math.nan
        self.level = self.known = False

    def update(self, state: State, loads: PadLoads | None = None) -> None:
        """Process a cycle; `loads` are those of the same two pads, if they were read already."""
        loads = self._pads.read(state) if loads is None else loads
        if self._first_ns is None:
            self._first_ns = state.stamp_ns
        one, two = (self._down @ loads.force_n).tolist()
        twist_one, twist_two = loads.torsion_nm.tolist()
        twist = twist_one - twist_two
        now = [one - two, one + two, twist]
        if not all(map(math.isfinite, now)):
            self._lose()
            return
        if self._means is None:
            self._means = now
        means, gain = self._means, max(self._gain, 1.0 / (self._age + 1))
        self._age += 1
        offs = [value - mean for value, mean in zip(now, means, strict=True)]
        for i, off in enumerate(offs):
            means[i] += gain * off
        for i, off in enumerate((offs[0], offs[2])):
            self._spreads[i] += gain * (off * off - self._spreads[i])
        self._report(state, gain)

    def _report(self, state: State, gain: float) -> None:
        assert self._means is not None
        difference, weight, twist = self._means
        settled = self._age * self._gain >= 1.0
        self.known = settled and weight > self.settings.least_n
        if not self.known:
            self._lose()
            return
        self.imbalance, self.arm_m = difference / weight, twist / weight
        share = 0.5 * gain
        self.imbalance_sigma = math.sqrt(share * self._spreads[0]) / weight
        self.arm_sigma_m = math.sqrt(share * self._spreads[1]) / weight
        ask, slack = self.settings, LEFT_SIGMAS if self.level else 0.0
        level = (
            abs(self.arm_m) <= ask.most_arm_m + slack * self.arm_sigma_m
            and abs(self.imbalance) <= ask.most_imbalance + slack * self.imbalance_sigma
        )
        if level != self.level:
            self.level = level
            assert self._first_ns is not None
            self.decisions.add(
                1e-9 * (state.stamp_ns - self._first_ns), "level" if level else "not level",
                f"weight {1e3 * self.arm_m:+.1f} ± {1e3 * self.arm_sigma_m:.1f} mm off the line, "
                f"imbalance {self.imbalance:+.0%}",
            )  # fmt: skip
