"""Gripper: what a behaviour asks of the hardware that it drives, or of a simulated one."""

from __future__ import annotations

from typing import Protocol

from skin.errors import OptionError, shown

__all__ = ["Gripper", "check_gripper"]


class Gripper(Protocol):
    """An adapter of a real gripper; called once a cycle, and must not wait.

    A gripper that is driven by force closes its own loop: `squeeze` is then its set point. One that
    is driven by position turns the difference to what its pads feel into a movement.
    """

    def squeeze(self, wanted_n: float, felt_n: float) -> None:
        """Grip with this normal force on each pad.

        Parameters
        ----------
        wanted_n : float
            Newton, on each pad, from now on.
        felt_n : float
            Newton: what the pads feel, mean of those that are heard; NaN where none is, and what
            was set stays.
        """

    def release(self) -> None:
        """Open, gently, until told otherwise."""


def check_gripper(gripper: object) -> None:
    """Refuse what is no adapter.

    Raises
    ------
    OptionError
        It has no `squeeze` or no `release`.
    """
    for name in ("squeeze", "release"):
        if not callable(getattr(gripper, name, None)):
            raise OptionError(f"gripper: must have {name!r}; got {shown(gripper)}")
