"""Errors of the skin.

::

    SkinError                everything below, and what no narrower name fits
    ├── OptionError          an option, or the name of a quantity, that does not exist
    ├── CountsError          an array that is not what the topology says it must be
    ├── CalibrationError     parameters that no working unit can have
    ├── LibraryError         an optional library that is not installed
    └── SceneError           a scene file that is wrong, or that cannot be on this skin
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["CalibrationError", "CountsError", "LibraryError", "OptionError", "SceneError",
           "SkinError"]  # fmt: skip

LISTED = 20
"""Names that a message lists; of more, it tells the first and the last."""


class SkinError(Exception):
    """Anything that goes wrong between counts and contacts."""


class OptionError(SkinError, ValueError):
    """An option, or the name of a quantity, that does not exist; the message names those that do.

    Examples
    --------
    >>> raise OptionError.unknown("estimator", "sin", ["sine"])
    Traceback (most recent call last):
    skin.errors.OptionError: estimator: must be 'sine'; got 'sin' (nearest: 'sine')
    """

    @classmethod
    def unknown(cls, where: str, got: object, names: Iterable[str]) -> OptionError:
        """The error for `got`, which is none of `names`."""
        names = list(names)
        listed = ", ".join(map(repr, names))
        if len(names) > LISTED:
            listed = f"{len(names)} names from {names[0]!r} to {names[-1]!r}"
        one_of = "" if len(names) == 1 else "one of "
        near = get_close_matches(str(got), names, n=1)
        hint = f" (nearest: {near[0]!r})" if near else ""
        return cls(f"{where}: must be {one_of}{listed}; got {got!r}{hint}")


class CountsError(SkinError, ValueError):
    """An array whose shape or type is not what the topology says it must be."""


class CalibrationError(SkinError):
    """Parameters that no working unit can have; the message names unit, parameter and value."""


class LibraryError(SkinError, ImportError):
    """An optional library that is not installed; the message says how to install it."""


class SceneError(SkinError, ValueError):
    """A scene file is wrong, or cannot be on this skin; the message has one problem a line."""


class ScanError(SkinError, ValueError):
    """A recording of a bench that cannot tell what is asked of it; the message says what lacks."""
