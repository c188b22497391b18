"""Gripper: the interface of a behaviour to the gripper hardware, or to a simulated one."""

from __future__ import annotations

from typing import Protocol

from skin.errors import OptionError, shown

__all__ = ["Gripper", "check_gripper"]


class Gripper(Protocol):
    """An adapter of a real gripper; called once a cycle; must not wait.

    A force-controlled gripper closes its own loop: `squeeze` is its set point. A
    position-controlled one converts the difference to the measured load into a movement.
    """

    def squeeze(self, wanted_n: float, felt_n: float) -> None:
        """Set the normal force on each pad.

        Parameters
        ----------
        wanted_n : float
            Newton, on each pad, until the next call.
        felt_n : float
            Newton: measured by the pads, mean of those that are heard; NaN where none is: keep the
            set point.
        """

    def release(self) -> None:
        """Open slowly, until the next command."""


def check_gripper(gripper: object) -> None:
    """Require an adapter.

    Raises
    ------
    OptionError
        It has no `squeeze` or no `release`.
    """
    for name in ("squeeze", "release"):
        if not callable(getattr(gripper, name, None)):
            raise OptionError(f"gripper: must have {name!r}; got {shown(gripper)}")
