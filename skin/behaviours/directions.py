"""Directions that somebody gives: checked, and made unit vectors."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

from skin.errors import OptionError, shown

__all__ = ["unit_vector"]


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
