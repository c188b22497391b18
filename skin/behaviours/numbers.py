"""Checks of parameters that are several numbers."""

from __future__ import annotations

import math

from skin.errors import OptionError, check_number, shown

__all__ = ["check_direction", "check_tuple"]


def check_tuple(where: str, values: object, *bounds: tuple[float, float]) -> None:
    """Refuse what is no tuple of as many numbers as there are bounds, each within its own.

    Raises
    ------
    OptionError
        It is none.

    Examples
    --------
    >>> check_tuple("light", (0.1, 0.0), (-1.0, 1.0), (0.01, 1.0))
    Traceback (most recent call last):
    skin.errors.OptionError: light[1]: must be a number from 0.01 to 1; got 0.0
    """
    if not isinstance(values, tuple | list) or len(values) != len(bounds):
        raise OptionError(f"{where}: must be {len(bounds)} numbers; got {shown(values)}")
    for i, (value, (least, most)) in enumerate(zip(values, bounds, strict=True)):
        check_number(f"{where}[{i}]", value, least, most)


def check_direction(where: str, values: object, *, or_none: bool = False) -> None:
    """Refuse what is no direction; with `or_none` (0, 0, 0) is one, too.

    Raises
    ------
    OptionError
        It is none.
    """
    check_tuple(where, values, *[(-1e3, 1e3)] * 3)
    length = math.hypot(*values)  # pyright: ignore[reportGeneralTypeIssues]
    if not length > 1e-6 and not (or_none and length == 0.0):
        raise OptionError(f"{where}: must be a direction; got {shown(values)}")
