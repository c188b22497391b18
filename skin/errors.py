"""Errors of the skin.

::

    SkinError                base class, raised where none below fits
    ├── OptionError          an option or a quantity that does not exist
    ├── NotWantedError       a quantity was read that is not computed
    ├── CountsError          an array of another shape or type than the topology's
    ├── CalibrationError     parameters that no working unit can have
    ├── TooDenseError        units nearer to each other than their magnets allow
    ├── ScanError            a recording of a bench without the data that a fit needs
    ├── LibraryError         an optional library that is not installed
    └── SceneError           a scene file that is wrong or does not fit this skin
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

__all__ = [
    "MOST_SEED",
    "CalibrationError",
    "CountsError",
    "LibraryError",
    "NotWantedError",
    "OptionError",
    "ScanError",
    "SceneError",
    "SkinError",
    "TooDenseError",
    "as_numbers",
    "check_array",
    "check_choice",
    "check_flag",
    "check_kind",
    "check_number",
    "check_numbers",
    "no_attribute",
    "shown",
]

MOST_SEED = 2**63 - 1
"""Largest seed of noise: the largest int64."""
NEAR = 0.7
"""Likeness from which an attribute is suggested [assumed: `centre` for `centroid` is 0.71]."""
LISTED = 20
"""Names that a message lists; of more, it gives the first and the last."""


class SkinError(Exception):
    """Base class of errors between counts and contacts."""


class OptionError(SkinError, ValueError):
    """An option or a quantity that does not exist; the message lists those that do.

    Examples
    --------
    >>> raise OptionError.unknown("estimator", "sin", ["sine"])
    Traceback (most recent call last):
    skin.errors.OptionError: estimator: must be 'sine'; got 'sin' (nearest: 'sine')
    """

    @classmethod
    def unknown(cls, where: str, got: object, names: Iterable[str]) -> OptionError:
        """The error for a `got` that is none of `names`."""
        names = list(names)
        listed = ", ".join(map(repr, names))
        if len(names) > LISTED:
            listed = f"{len(names)} names from {names[0]!r} to {names[-1]!r}"
        one_of = "" if len(names) == 1 else "one of "
        near = get_close_matches(got, names, n=1) if isinstance(got, str) else []
        hint = f" (nearest: {near[0]!r})" if near else ""
        return cls(f"{where}: must be {one_of}{listed}; got {shown(got)}{hint}")


class NotWantedError(SkinError, AttributeError):
    """A quantity was read that is not computed, as it is not wanted; the message says which `want`
    gives it. ``getattr(state, name, None)`` is None for it."""


def no_attribute(one: object, name: str, names: Iterable[str] | None = None) -> AttributeError:
    """The error for an attribute that an object does not have; it suggests a public one of its
    class, or of some names, if one is near."""
    known = [each for each in names or dir(type(one)) if not each.startswith("_")]
    near = [] if name.startswith("_") else get_close_matches(name, known, n=1, cutoff=NEAR)
    hint = f" (nearest: {near[0]!r})" if near else ""
    return AttributeError(
        f"{type(one).__name__!r} object has no attribute {name!r}{hint}", name=name, obj=one
    )


def check_number(where: str, value: Any, least: float, most: float, *, whole: bool = False) -> None:
    """Require a number from `least` to `most`.

    Raises
    ------
    OptionError
        It is not.

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
    """Require numbers from `least` to `most`, by name; see `check_number`."""
    for name, value in values.items():
        check_number(name, value, least, most)


def check_flag(where: str, value: object) -> None:
    """Require True or False.

    Raises
    ------
    OptionError
        It is neither.
    """
    if value is not True and value is not False:
        raise OptionError(f"{where}: must be True or False; got {shown(value)}")


def check_kind(where: str, value: object, kind: type) -> None:
    """Require an instance of a class.

    Raises
    ------
    OptionError
        It is not one.

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
    """Require one of the given names.

    Raises
    ------
    OptionError
        It is none of them; the message suggests the nearest.
    """
    if not isinstance(value, str) or value not in names:
        raise OptionError.unknown(where, value, names)


def shown(value: object) -> str:
    """A value in short form, for messages."""
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        text = "an integer of thousands of digits"
    return text if len(text) <= 60 else text[:57] + "..."


class CountsError(SkinError, ValueError):
    """An array of another shape or type than the topology requires."""


class CalibrationError(SkinError):
    """Parameters that no working unit can have; the message names unit, parameter and value."""


class TooDenseError(SkinError):
    """Units nearer to each other than their magnets allow; the message has one patch a line.

    Attributes
    ----------
    units : sequence of int
        Those that a neighbour's film reaches, if that is the error.
    """

    def __init__(self, message: str, units: Sequence[int] = ()) -> None:
        super().__init__(message)
        self.units = units


class LibraryError(SkinError, ImportError):
    """An optional library that is not installed; the message says how to install it."""


class SceneError(SkinError, ValueError):
    """A scene file is wrong or does not fit this skin; the message has one problem a line."""


class ScanError(SkinError, ValueError):
    """A recording of a bench lacks data that a fit needs; the message names them."""


def as_numbers(where: str, value: Any) -> np.ndarray:
    """A value as an array of its own, float64.

    Raises
    ------
    OptionError
        It is not of real numbers; True and False are none.
    """
    import numpy as np

    try:
        found = np.array(value)
        parts = () if isinstance(value, np.ndarray) else np.array(value, object).flat
        is_flag = found.dtype == bool or any(isinstance(one, bool | np.bool_) for one in parts)
        if np.can_cast(found.dtype, float) and not is_flag:
            return found.astype(float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise OptionError(f"{where}: must be numbers; got {shown(value)}")


def check_array(name: str, array: np.ndarray, like: np.ndarray) -> None:
    """Require an array that kernels read in place."""
    flags = array.flags
    fits = array.dtype == like.dtype and array.shape == like.shape
    if not (fits and flags.c_contiguous and flags.aligned):
        raise SkinError(
            f"{name}: must be contiguous {like.dtype} of shape {like.shape}; "
            f"got {array.dtype} of shape {array.shape}"
        )
