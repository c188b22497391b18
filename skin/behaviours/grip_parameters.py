"""User parameters of the grip control."""

from __future__ import annotations

from dataclasses import dataclass

from skin.errors import OptionError, check_flag, check_number

__all__ = ["GripParameters"]


@dataclass(frozen=True, kw_only=True)
class GripParameters:
    """Of `skin.behaviours.grip.GripControl`; loads are per pad.

    Attributes
    ----------
    safety : float
        Relative margin above the least grip, in addition to those for what is not known of
        friction and for the response time of the gripper [assumed: calibration of the ratio of
        tangential to normal force, 3 %; people take 0.1 to 0.4 in all, Johansson and Westling,
        1984].
    least_friction : float
        Prior coefficient of friction [assumed: silicone on a wet or dusty surface].
    first_grip_n : float
        Newton, before the lift [assumed: the faces are certainly in contact].
    least_grip_n, most_grip_n : float
        Newton, bounds of the grip while it holds [assumed: eight sigma of a pad; the limit of a
        small gripper].
    touch_n : float
        Newton, load above which a pad is in contact [assumed: five sigma of a pad].
    lifted_n : float
        Newton, tangential load above which an object hangs [assumed: two sigma of a pad's
        tangential force, of which the mean over 0.1 s leaves a seventh].
    horizon_s : float
        Second, response time of the gripper and horizon of the forecast, until a probe has measured
        it [assumed: a cycle and a servo of 15 Hz].
    easing_s : float
        Second, time constant with which the grip follows a falling load: a load that comes back
        soon is still held [assumed].
    unheard_s : float
        Second, silence of pads after which the grip rises [assumed: the longest lost burst of
        frames].
    unheard_rise : float
        Relative rise then [assumed].
    release_n_per_s : float
        Newton a second, rate of release [assumed].
    probe : bool
        Whether to measure friction by short dips of the grip on an object that hangs still.

    Raises
    ------
    OptionError
        A number is out of range.
    """

    safety: float = 0.05
    least_friction: float = 0.25
    first_grip_n: float = 2.5
    least_grip_n: float = 0.4
    most_grip_n: float = 20.0
    touch_n: float = 0.25
    lifted_n: float = 0.1
    horizon_s: float = 0.02
    easing_s: float = 0.15
    unheard_s: float = 0.1
    unheard_rise: float = 0.5
    release_n_per_s: float = 5.0
    probe: bool = True

    def __post_init__(self) -> None:
        check_number("safety", self.safety, 0.0, 10.0)
        check_number("least_friction", self.least_friction, 1e-3, 10.0)
        for name in ("first_grip_n", "least_grip_n", "most_grip_n", "touch_n", "lifted_n"):
            check_number(name, getattr(self, name), 1e-6, 1e4)
        for name in ("horizon_s", "easing_s", "unheard_s"):
            check_number(name, getattr(self, name), 1e-3, 60.0)
        check_number("unheard_rise", self.unheard_rise, 0.0, 10.0)
        check_number("release_n_per_s", self.release_n_per_s, 1e-3, 1e4)
        check_flag("probe", self.probe)
        if not self.least_grip_n <= self.first_grip_n <= self.most_grip_n:
            raise OptionError(
                "first_grip_n: must be from least_grip_n to most_grip_n, "
                f"{self.least_grip_n:g} to {self.most_grip_n:g}; got {self.first_grip_n:g}"
            )
