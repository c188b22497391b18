"""Options of a robot with a tactile skin."""

from dataclasses import dataclass, field
from typing import Any

from lerobot.robots import RobotConfig

__all__ = ["F3TSkinConfig"]


@RobotConfig.register_subclass("f3t_skin")
@dataclass(kw_only=True)
class F3TSkinConfig(RobotConfig):
    """Options of `F3TSkin`.

    Attributes
    ----------
    topology : str
        Topology file of the skin, or the name of a built-in one.
    base : dict
        Options of the robot that carries the skin, with its `type`; empty if the skin is used
        alone. It is no RobotConfig, since the options of LeRobot cannot hold one of any type.
    simulate : str
        Scene of simulated units in place of the buses; empty for real units.
    wrench : bool
        Whether observations have the total force and moment.
    fill : float
        Value in place of forces that are not valid: policies do not take NaN.
    max_age_s : float, optional
        Age beyond which no value is valid; two periods of the skin if not given.
    start_s : float
        Longest wait for the first cycle: a first start compiles for minutes.
    """

    topology: str
    base: dict[str, Any] = field(default_factory=dict)
    simulate: str = ""
    wrench: bool = True
    fill: float = 0.0
    max_age_s: float | None = None
    start_s: float = 600.0
