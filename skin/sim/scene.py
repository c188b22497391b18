"""Interface of a scene: bodies in contact with the skin, and the truth."""

from __future__ import annotations

from typing import Protocol

from skin.sim.truth import Truth

__all__ = ["Scene"]


class Scene(Protocol):
    """Contacts and temperatures of a skin over time.

    A scene with surroundings that change has an attribute `steady` that is False: what its units
    read then depends on more than the truth, and is to be asked for instant by instant. One with an
    end has an attribute `ends_s`, in seconds: a skin that plays it has no states from then on.
    """

    def at(self, time_s: float) -> Truth:
        """Advance to `time_s`, which must not be before the last one.

        The truth belongs to the scene and is valid until the next call.
        """
        ...
