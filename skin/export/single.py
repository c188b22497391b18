"""Numbers as float32, in which data sets have them: refused where it would make others of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from skin.errors import SkinError, shown

__all__ = ["as_single", "check_single"]

EXACT = 1 << 24
"""Up to which float32 holds every integer [derived: 24 bits of mantissa]."""
LARGEST = float(np.finfo(np.float32).max)


def check_single(where: str, number: float) -> None:
    """Refuse a number that float32 does not hold: infinite in it, or a stamp that it would round.

    Parameters
    ----------
    where : str
        As messages name it.
    number : int or float
        Up to 2**24 float32 rounds by 1 at most; beyond, only what it holds exactly is taken. NaN
        is.

    Raises
    ------
    SkinError
        It does not hold it.
    """
    if abs(number) > LARGEST:
        raise SkinError(f"{where}: must be finite as float32; got {shown(number)}")
    if abs(number) > EXACT and float(np.float32(number)) != number:
        raise SkinError(
            f"{where}: must be a number that float32 holds exactly, where it is beyond {EXACT}; "
            f"got {shown(number)}"
        )


def as_single(where: str, values: Any) -> np.ndarray:
    """Values of a feature, shape (m, …), float32.

    Raises
    ------
    SkinError
        They are no numbers, none at all, or such that float32 does not hold.
    """
    try:
        given = np.atleast_1d(np.asarray(values))
    except ValueError:  # rows of several lengths
        raise SkinError(f"{where}: must be an array of numbers; got {shown(values)}") from None
    if given.dtype.kind not in "biuf":
        raise SkinError(f"{where}: must be an array of numbers; got {shown(values)}")
    if not given.size:
        raise SkinError(f"{where}: must have numbers; got none, shape {given.shape}")
    with np.errstate(over="ignore"):
        beyond = np.abs(given.astype(np.float64)) > EXACT
    for number in given[beyond].tolist():
        check_single(where, number)
    return given.astype(np.float32)
