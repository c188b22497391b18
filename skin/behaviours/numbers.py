"""Checks of parameters of several numbers, such as directions."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

from skin.errors import OptionError, check_number, shown

__all__ = ["check_direction", "check_pair", "check_tuple", "unit_vector"]


def check_tuple(where: str, values: object, *bounds: tuple[float, float]) -> None:
    """Require a tuple of one number for each of the bounds.

    Raises
    ------
    OptionError
        It is not.

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
    """Require a direction; with `or_none` (0, 0, 0) is allowed.

    Raises
    ------
    OptionError
        It is not.
    """
    if not (or_none and isinstance(values, tuple | list) and list(values) == [0.0, 0.0, 0.0]):
        unit_vector(where, values)


def unit_vector(where: str, value: Any) -> tuple[float, float, float]:
    """A vector of three numbers, normalised.

    Raises
    ------
    OptionError
        It has not three finite numbers, or no length.

    Examples
    --------
    >>> unit_vector("down", (0, 0, -2))
    (0.0, 0.0, -1.0)
    """
    is_three = isinstance(value, tuple | list) and len(value) == 3
    if is_three and all(isinstance(one, Real) and not isinstance(one, bool) for one in value):
        x, y, z = map(float, value)
        length = math.hypot(x, y, z)
        if math.isfinite(length) and length > 1e-9:
            return x / length, y / length, z / length
    raise OptionError(
        f"{where}: must be three numbers (x, y, z), not all of them 0; got {shown(value)}"
    )


def check_pair(where: str, value: Any) -> tuple[Any, Any]:
    """Require a lower and an upper end.

    Raises
    ------
    OptionError
        They are not two.
    """
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise OptionError(f"{where}: must be (low, high); got {shown(value)}")
    return value[0], value[1]
