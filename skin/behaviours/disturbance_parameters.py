"""Parameters that distinguish a disturbance from rest."""

from __future__ import annotations

from dataclasses import dataclass

from skin.errors import check_number

__all__ = ["DisturbanceParameters"]


@dataclass(frozen=True, kw_only=True)
class DisturbanceParameters:
    """Parameters that distinguish a disturbance from rest.

    Attributes
    ----------
    learn_s : float
        Duration of learning the first rest, without reports [derived: noise of its mean is a
        seventh].
    rest_s : float
        Time constant of the rest [assumed: slower than a hand, faster than a drift].
    smooth_s, slow_s : float
        Time constants of the means compared with noise [assumed: half of a short tap, of a brush].
    onset, end : float
        Squared distance from rest, in sigmas, over force and torque: 34 for six numbers and a test
        every 30 ms is one false onset per hour of white noise; noise exceeds 9 one time in six
        [derived].
    quiet_s : float
        Duration below `end` that ends a disturbance [assumed].
    longest_s : float
        A longer change is of a person who leans on it [assumed].
    back : float
        Tolerance of a return to the own load, relative to what leaned on it [assumed].
    anchor_s : float
        Duration of learning the own load again where other units are heard [derived: its
        mean has a fourth of the noise].
    wander_n : float
        Sigma of the rest itself, newton [assumed].
    lever_m : float
        Lever that converts torques of a held object to forces: both then have the same noise on
        pads of some centimetres [derived].
    touch_lever_m : float
        The same for a finger that touches a skin [assumed: its radius of contact].
    held_n : float
        Load at rest above which an object is held [assumed: four sigma of two pads].
    """

    learn_s: float = 0.2
    rest_s: float = 1.0
    smooth_s: float = 0.015
    slow_s: float = 0.06
    onset: float = 34.0
    end: float = 9.0
    quiet_s: float = 0.05
    longest_s: float = 10.0
    back: float = 0.05
    anchor_s: float = 0.06
    wander_n: float = 0.01
    lever_m: float = 0.04
    touch_lever_m: float = 0.005
    held_n: float = 0.6

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            check_number(f"disturbance: {name}", getattr(self, name), 1e-6, 1e6)
