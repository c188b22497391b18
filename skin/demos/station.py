"""Station: a gripper with a vessel, a flame, a kettle and a person, and all behaviours.

The vessel is simulated physics: its mass grows, its surface warms, the person pulls. The behaviours
have no data but the frames on the bus.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from skin.behaviours.handover import Handover, Phase
from skin.behaviours.level import Level
from skin.behaviours.pads import Pads
from skin.behaviours.pouring import Pouring, PouringSettings, water_density
from skin.behaviours.shaking import Shaking
from skin.behaviours.warmth import Warmth, WarmthSettings
from skin.demos.hand import Hand
from skin.demos.vessel import Vessel, VesselSettings
from skin.errors import OptionError
from skin.grasp.episode import Episode
from skin.grasp.object import GraspObject
from skin.grasp.world import World, grasp
from skin.state import State

__all__ = ["DROPPED_M", "Person", "Setting", "Station"]

BENCH_M = -0.05
CLEAR_M = 5e-4
"""Gap between the vessel and the bench at the start [numeric]."""

DROPPED_M = 0.01
"""Longest allowed slide down the pads."""

TAP_LAG_S = 0.1
"""Flow after the tap is closed [assumed]."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Parameters that differ between runs.

    Attributes
    ----------
    thing : GraspObject
        Its mass is that of the vessel.
    vessel : VesselSettings
    hot_c : float
        Of the kettle's water.
    warmth, pouring : settings of the behaviours
    """

    thing: GraspObject
    vessel: VesselSettings = field(default_factory=VesselSettings)
    hot_c: float = 88.0
    warmth: WarmthSettings = field(default_factory=WarmthSettings)
    pouring: PouringSettings = field(default_factory=PouringSettings)


@dataclass
class Person:
    """Takes the offered vessel: bears a growing fraction of its weight, and holds its position.

    Attributes
    ----------
    rise_s : float
        Time in which the fraction grows to 1.
    stiffness_n_per_m, damping_ns_per_m : float
        Of the arm.
    share : float
        Current fraction.
    """

    rise_s: float = 0.5
    stiffness_n_per_m: float = 150.0
    damping_ns_per_m: float = 15.0
    share: float = 0.0
    _at: np.ndarray | None = None

    def force(self, dt_s: float, position: np.ndarray, velocity: np.ndarray, weight_n: float):
        """On the vessel, newton, shape (3,)."""
        if self._at is None:
            self._at = position.copy()
        self.share = min(self.share + dt_s / self.rise_s, 1.0)
        spring = self.stiffness_n_per_m * (self._at - position)
        force = spring - self.damping_ns_per_m * velocity
        force[2] += weight_n
        return self.share * force


class Station:
    """A world with a vessel and all behaviours; iterate over `cycles`.

    Attributes
    ----------
    world : World
    vessel : Vessel
    hand : Hand
    warmth, pouring, shaking, level
        Behaviours, updated every cycle.
    power_w, flow_ml_per_s : float
        Settings of flame and tap.
    burner_w, tap_ml_per_s, person_rise_s : float
        Power of the flame when lit, flow of the tap when open, and time in which a person takes the
        weight.
    off_centre_m, middle_m : float
        Memory of a story: offset of the weight, and height about which it shakes.
    person : Person or None
        The person that takes the vessel.
    time_s, started_s : float
        Current time, and that of the first cycle.
    released : bool
        Whether it has been released to a person.
    handover : Handover
        Updated once it is asked to give.
    """

    def __init__(
        self, setting: Setting, *, seed: int = 0, episode: Episode | None = None, pace: bool = False
    ) -> None:
        self.setting = setting
        self.vessel = Vessel(setting.vessel)
        thing = replace(
            setting.thing,
            mass_kg=self.vessel.mass_kg,
            position_m=(*setting.thing.position_m[:2], BENCH_M + _height(setting.thing) + CLEAR_M),
            temperature_c=self.vessel.wall_c,
        )
        self.name = thing.name
        self.world: World = grasp(
            Path(__file__).with_name("station.xml"), "gripper", objects=[thing], episode=episode,
            seed=seed, pace=pace, want=("force", "temperature", "sigma"),
        )  # fmt: skip
        topology = self.world.skin.topology
        self._period_s = 1.0 / topology.cycle_rate_hz
        self._pads = Pads(topology)
        self.hand = Hand(self.world)
        self.warmth = Warmth(topology, settings=setting.warmth)
        self.pouring = Pouring(topology, settings=setting.pouring, warmth=self.warmth)
        self.shaking = Shaking(topology)
        self.level = Level(topology)
        self.handover = Handover(topology)
        self.power_w = self.flow_ml_per_s = self.time_s = 0.0
        self.burner_w = self.tap_ml_per_s = 0.0
        self.person_rise_s = 0.5
        self.off_centre_m = self.middle_m = 0.0
        self.started_s = math.nan
        self.person: Person | None = None
        self.released = False
        self.slid_m = 0.0
        self._start_m: float | None = None

    def feels(self) -> dict[str, object]:
        """Behaviours, by the first word of a field."""
        return {
            "warmth": self.warmth, "pouring": self.pouring, "shaking": self.shaking,
            "level": self.level, "handover": self.handover, "hand": self.hand, "station": self,
        }  # fmt: skip

    def update(self, state: State) -> None:
        """Update the behaviours; the hand is moved by `act`."""
        self.time_s = self.world.time_s
        if math.isnan(self.started_s):
            self.started_s = self.time_s
        self.loads = self._pads.read(state)
        self.warmth.update(state)
        for behaviour in (self.pouring, self.shaking, self.level):
            behaviour.update(state, self.loads)
        if self.handover.phase is not Phase.IDLE:
            self.handover.update(state)

    def act(self) -> None:
        """Move the hand, and advance the world."""
        self.hand.update(self.loads)
        vessel, dt_s = self.vessel, self._period_s
        flow = 1e-3 * self.flow_ml_per_s
        vessel.step(dt_s, power_w=self.power_w, flow_kg_per_s=flow, hot_c=self.setting.hot_c)
        self.world.warm(self.name, vessel.wall_c)
        if vessel.flow_kg_per_s > 1e-7:
            self.world.weigh(self.name, vessel.mass_kg)
        truth = self.world.truth
        position = truth.position[:, 0]
        if self.person is not None:
            weight_n = 9.81 * vessel.mass_kg
            force = self.person.force(dt_s, position, truth.velocity[:3, 0], weight_n)
            self.world.push(self.name, force)
        height = float(position[2]) - self.world.joints["lift"]
        if self.hand.held and self._start_m is None:
            self._start_m = height
        if self._start_m is not None and not self.released:
            self.slid_m = max(self.slid_m, self._start_m - height)

    @property
    def coming_c(self) -> float:
        """Predicted temperature of the contents if the tap is closed now: it lags."""
        return self.warmth.inside_c + TAP_LAG_S * self.warmth.rate_c_per_s

    @property
    def true_poured_ml(self) -> float:
        """Since the start, at the current temperature."""
        return 1e3 * self.vessel.poured_kg / water_density(self.vessel.water_c)

    def regripped(self) -> None:
        """Restart the measurement of slides after a new grip."""
        self._start_m = None

    @property
    def dropped(self) -> bool:
        """Whether the vessel slid down the pads, or fell."""
        fell = self.world.truth.position[2, 0] < BENCH_M - 0.01
        return self.slid_m > DROPPED_M or bool(fell)

    @property
    def tilt_deg(self) -> float:
        """Of the vessel from upright."""
        return math.degrees(math.acos(min(1.0, float(self.world.truth.rotation[2, 2, 0]))))

    def close(self) -> None:
        """Close the world."""
        self.world.close()

    def __enter__(self) -> Station:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _height(thing: GraspObject) -> float:
    if thing.shape == "box":
        return thing.size_m[2]
    if thing.shape == "cylinder":
        return thing.size_m[1]
    raise OptionError(f"thing: must be a box or a cylinder; got {thing.shape!r}")
