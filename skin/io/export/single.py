"""Conversion of numbers to float32 for data sets; refuses those that it would change."""

from __future__ import annotations

from typing import Any

import numpy as np

from skin.errors import SkinError, shown

__all__ = ["as_single", "check_single"]

EXACT = 1 << 24
"""float32 holds every integer up to here [derived: 24 bits of mantissa]."""
LARGEST = float(np.finfo(np.float32).max)


def check_single(where: str, number: float) -> None:
    """Refuse a number that float32 cannot hold: an overflow, or a stamp that it would round.

    Parameters
    ----------
    where : str
        Used in messages.
    number : int or float
        Beyond 2**24 only numbers that float32 holds exactly are accepted; below, rounding is at
        most 1. NaN is accepted.

    Raises
    ------
    SkinError
        float32 cannot hold it.
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
        They are not numbers, are empty, or float32 cannot hold them.
    """
    try:
        given = np.atleast_1d(np.asarray(values))
    except ValueError:  # ragged rows
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
