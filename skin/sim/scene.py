"""Interface of a scene: bodies in contact with the skin, and the truth."""

from __future__ import annotations

from typing import Protocol

from skin.sim.truth import Truth

__all__ = ["Scene"]


class Scene(Protocol):
    """Contacts and temperatures of a skin over time.

    One with an end has an attribute `ends_s`, in seconds: a skin that plays it has no states from
    then on. One with `units`, a `skin.sim.unit.UnitSimulator`, has units of its own.
    """

    def at(self, time_s: float) -> Truth:
        """Advance to `time_s`, which must not be before the last one.

        The truth belongs to the scene and is valid until the next call.
        """
        ...
