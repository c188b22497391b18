"""Directions and bands that somebody gives: checked, directions made unit vectors."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

from skin.errors import OptionError, shown

__all__ = ["check_pair", "unit_vector"]


def unit_vector(where: str, value: Any) -> tuple[float, float, float]:
    """A direction of three numbers, of length 1.

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
    """A lower and an upper end.

    Raises
    ------
    OptionError
        They are not two.
    """
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise OptionError(f"{where}: must be (low, high); got {shown(value)}")
    return value[0], value[1]
