"""A labelled recording of a tactile array, in the units that the contact stage takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from skin.errors import SkinError

__all__ = [
    "MOST",
    "Label",
    "LeftOut",
    "Recording",
    "RecordingError",
    "check_finite",
    "check_stamps",
]

SLOWEST_HZ, FASTEST_HZ = 50.0, 1200.0
"""Rates at which arrays of taxels are read [assumed]: what lies outside has another unit."""

MOST = 1e15
"""Of any number [assumed]: thirty years in microseconds; float32 still holds its square."""


class RecordingError(SkinError, ValueError):
    """A file is no recording that can be scored; the message names the file and what is wrong."""


class Label(IntEnum):
    """What a sample is said to be."""

    HOLD = 0
    """Nothing slips, or nothing touches."""
    SLIP = 1
    IGNORE = 2
    """Neither: an object is taken or let go, or the file says not to look."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One grasp; t samples, n taxels, axes of the taxel with z into the array.

    Attributes
    ----------
    name : str
        File, and the group in it.
    array : str
        Kind of array, and whose word the labels are: recordings of one kind are scored together.
    time_s : ndarray, shape (t,)
        Second.
    force : ndarray, shape (t, 3, n), float32
        Newton.
    force_sigma : ndarray, shape (3, n)
        Newton, one-sigma.
    displacement_mm : ndarray, shape (t, 3, n), float32
        Millimetre.
    displacement_sigma_mm : ndarray, shape (3, n)
        Millimetre, one-sigma.
    position_mm : ndarray, shape (2, n)
        Millimetre, along the taxels' x and y.
    label : ndarray, shape (t,), int8
        Of `Label`.
    gross : ndarray, shape (t,), bool, or None
        All that touches has slipped; None where the file does not say.
    """

    name: str
    array: str
    time_s: np.ndarray
    force: np.ndarray
    force_sigma: np.ndarray
    displacement_mm: np.ndarray
    displacement_sigma_mm: np.ndarray
    position_mm: np.ndarray
    label: np.ndarray
    gross: np.ndarray | None = None

    @property
    def rate_hz(self) -> float:
        """Samples a second: the median."""
        return 1.0 / float(np.median(np.diff(self.time_s)))


@dataclass(frozen=True)
class LeftOut:
    """A recording that is sound and still cannot be scored."""

    name: str
    why: str


def check_finite(where: str, values: np.ndarray) -> None:
    """Refuse what is not finite, or beyond `MOST`, by the index of the first.

    Raises
    ------
    RecordingError
        A value is.
    """
    wrong = np.argwhere(~(np.abs(values) <= MOST))
    if wrong.size:
        at = tuple(wrong[0].tolist())
        raise RecordingError(
            f"{where}: must be within ±{MOST:g}; got {values[at]} at {list(at)}, "
            f"{len(wrong)} in all"
        )


def check_stamps(
    place: Callable[[int], str], stamps: np.ndarray, unit_s: float, unit: str
) -> np.ndarray:
    """Stamps in seconds since the first, if they grow at the rate of a tactile array.

    Parameters
    ----------
    place : callable
        File and place of a sample, for messages.
    stamps : ndarray, shape (t,)
        Finite.
    unit_s : float
        Second: what one of them is.
    unit : str
        Its name, for messages.

    Raises
    ------
    RecordingError
        They do not increase, or their unit is another.
    """
    if stamps.size < 2:
        raise RecordingError(f"{place(0)}: must be 2 stamps or more; got {stamps.size}")
    steps = np.diff(stamps)
    if np.any(steps <= 0):
        at = int(np.argmax(steps <= 0)) + 1
        raise RecordingError(
            f"{place(at)}: must be after the stamp before, {float(stamps[at - 1])}; "
            f"got {float(stamps[at])}"
        )
    rate_hz = 1.0 / (float(np.median(steps)) * unit_s)
    if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise RecordingError(
            f"{place(0)}: must be {unit}, {SLOWEST_HZ:g} to {FASTEST_HZ:g} samples a second; "
            f"got steps of {np.median(steps):g}, {rate_hz:g} a second"
        )
    return (stamps - stamps[0]) * unit_s
