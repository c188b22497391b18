"""Parameters of a disturbance: how it is told from rest."""

from __future__ import annotations

from dataclasses import dataclass

from skin.errors import check_number

__all__ = ["DisturbanceParameters"]


@dataclass(frozen=True, kw_only=True)
class DisturbanceParameters:
    """How a disturbance is told from rest.

    Attributes
    ----------
    learn_s : float
        First look at rest, in which nothing is told [derived: noise of its mean is a seventh].
    rest_s : float
        Time constant of the rest [assumed: slower than a hand, faster than a drift].
    smooth_s, slow_s : float
        Time constants of what is compared with noise [assumed: half of a short tap, of a brush].
    onset, end : float
        Squared distance from rest, in sigmas, over force and moment: 34 for six numbers and a look
        every 30 ms is a false onset in an hour of white noise; 9 is what noise has one time in six
        [derived].
    quiet_s : float
        For how long it must stay below `end` [assumed].
    longest_s : float
        What lasts longer is a new rest [assumed].
    back : float
        How far off the rest before it a return may be, as a share of its way [assumed].
    anchor_s : float
        In which the rest is found anew where other units are heard [derived: its mean has a fourth
        of the noise].
    wander_n : float
        Sigma of the rest itself, newton [assumed].
    lever_m : float
        Lever by which moments of a held object are compared with forces: noise of both is alike
        then on pads of some centimetres [derived].
    touch_lever_m : float
        The same of a finger that touches a skin [assumed: its radius of contact].
    held_n : float
        Load at rest from which on something is held [assumed: four sigma of two pads].
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
