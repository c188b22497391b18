"""Errors of the skin.

::

    SkinError                everything below, and what no narrower name fits
    ├── OptionError          an option, or the name of a quantity, that does not exist
    ├── CountsError          an array that is not what the topology says it must be
    ├── CalibrationError     parameters that no working unit can have
    ├── TooDenseError        units nearer to each other than their magnets allow
    ├── ScanError            a recording of a bench that cannot tell what is asked of it
    ├── LibraryError         an optional library that is not installed
    └── SceneError           a scene file that is wrong, or that cannot be on this skin
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from numbers import Integral, Real
from typing import Any

__all__ = [
    "MOST_SEED",
    "CalibrationError",
    "CountsError",
    "LibraryError",
    "OptionError",
    "ScanError",
    "SceneError",
    "SkinError",
    "TooDenseError",
    "check_choice",
    "check_flag",
    "check_kind",
    "check_number",
    "check_numbers",
    "shown",
]

MOST_SEED = 2**63 - 1
"""Largest seed of noise: what an integer of numpy holds."""
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
        near = get_close_matches(got, names, n=1) if isinstance(got, str) else []
        hint = f" (nearest: {near[0]!r})" if near else ""
        return cls(f"{where}: must be {one_of}{listed}; got {shown(got)}{hint}")


def check_number(where: str, value: Any, least: float, most: float, *, whole: bool = False) -> None:
    """Refuse what is no number from `least` to `most`.

    Raises
    ------
    OptionError
        It is none.

    Examples
    --------
    >>> check_number("deadline_s", float("nan"), 0, 60)
    Traceback (most recent call last):
    skin.errors.OptionError: deadline_s: must be a number from 0 to 60; got nan
    """
    is_number = isinstance(value, Integral if whole else Real) and not isinstance(value, bool)
    number: Any = value
    if not is_number or not least <= number <= most:
        kind = "an integer" if whole else "a number"
        raise OptionError(f"{where}: must be {kind} from {least:g} to {most:g}; got {shown(value)}")


def check_numbers(least: float, most: float, **values: Any) -> None:
    """Refuse what is no number from `least` to `most`, by name; see `check_number`."""
    for name, value in values.items():
        check_number(name, value, least, most)


def check_flag(where: str, value: object) -> None:
    """Refuse what is neither True nor False.

    Raises
    ------
    OptionError
        It is neither.
    """
    if value is not True and value is not False:
        raise OptionError(f"{where}: must be True or False; got {shown(value)}")


def check_kind(where: str, value: object, kind: type) -> None:
    """Refuse what is not of a class.

    Raises
    ------
    OptionError
        It is of another.

    Examples
    --------
    >>> check_kind("topology", "palm", dict)
    Traceback (most recent call last):
    skin.errors.OptionError: topology: must be a dict; got 'palm'
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        raise OptionError(f"{where}: must be {article} {kind.__name__}; got {shown(value)}")


def check_choice(where: str, value: object, names: Iterable[str]) -> None:
    """Refuse what is none of some names.

    Raises
    ------
    OptionError
        It is none of them; the message has the nearest.
    """
    if not isinstance(value, str) or value not in names:
        raise OptionError.unknown(where, value, names)


def shown(value: object) -> str:
    """A value as messages show it: short."""
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        text = "an integer of thousands of digits"
    return text if len(text) <= 60 else text[:57] + "..."


class CountsError(SkinError, ValueError):
    """An array whose shape or type is not what the topology says it must be."""


class CalibrationError(SkinError):
    """Parameters that no working unit can have; the message names unit, parameter and value."""


class TooDenseError(SkinError):
    """Units nearer to each other than their magnets allow; the message has one patch a line.

    Attributes
    ----------
    units : sequence of int
        Those that a film comes into, where that is what is wrong.
    """

    def __init__(self, message: str, units: Sequence[int] = ()) -> None:
        super().__init__(message)
        self.units = units


class LibraryError(SkinError, ImportError):
    """An optional library that is not installed; the message says how to install it."""


class SceneError(SkinError, ValueError):
    """A scene file is wrong, or cannot be on this skin; the message has one problem a line."""


class ScanError(SkinError, ValueError):
    """A recording of a bench that cannot tell what is asked of it; the message says what lacks."""
