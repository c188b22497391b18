"""What a scene is: something touches the skin, and the whole truth about it is known."""

from __future__ import annotations

from typing import Protocol

from skin.sim.truth import Truth

__all__ = ["Scene"]


class Scene(Protocol):
    """What happens to a skin.

    A scene with surroundings that change has an attribute `steady` that is False: what its units
    read then depends on more than the truth, and is to be asked for instant by instant.
    """

    def at(self, time_s: float) -> Truth:
        """Go on to `time_s`, not before the last one asked for.

        The truth belongs to the scene and is valid until the next call.
        """
        ...
