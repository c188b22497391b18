"""What a file does not say of its array: where the taxels lie, and what a reading stands for.

A TOML file may tell it (``--array FILE``); every key may be left out:

.. code-block:: toml

    positions_mm = [[0.0, 0.0], [4.7, 0.0]]  # a taxel a pair, along its own x and y
    mm_per_reading = [0.0005, 0.001]         # shear, normal: readings that are no millimetres
    n_per_mm = [1.0, 3.0]                    # shear, normal: stiffness
    rest = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]  # readings of the untouched array, a taxel a row
    press = 1                                # -1 where z falls when the array is pressed
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.recorded.recording import RecordingError
from skin.errors import shown
from topology.files import TooLargeError, read_regular

__all__ = ["Array", "lattice_mm", "load"]

LARGEST = 1 << 20
"""Bytes of a description [assumed]."""


@dataclass(frozen=True, eq=False)
class Array:
    """What is known of an array; None where nothing is.

    Attributes
    ----------
    positions_mm : ndarray, shape (2, n), or None
    mm_per_reading, n_per_mm : (float, float) or None
        Of shear and normal.
    rest : ndarray, shape (3, n), or None
        In the file's own unit.
    press : int or None
        Sign of z when the array is pressed.
    """

    positions_mm: np.ndarray | None = None
    mm_per_reading: tuple[float, float] | None = None
    n_per_mm: tuple[float, float] | None = None
    rest: np.ndarray | None = None
    press: int | None = None

    def check_count(self, where: str, n: int) -> None:
        """Refuse a description of another number of taxels.

        Raises
        ------
        RecordingError
            Positions or rest are not of n taxels.
        """
        for name, values in (("positions_mm", self.positions_mm), ("rest", self.rest)):
            if values is not None and values.shape[1] != n:
                raise RecordingError(
                    f"{where}: must have as many taxels as {name} of --array, {values.shape[1]}; "
                    f"got {n}"
                )


def lattice_mm(columns: int, rows: int, pitch_mm: float) -> np.ndarray:
    """Positions of a lattice about its middle, the taxels of a column after one another.

    Returns
    -------
    ndarray, shape (2, columns * rows)
        Millimetre.

    Examples
    --------
    >>> lattice_mm(2, 3, 1.0).T.tolist()[:3]
    [[-0.5, -1.0], [-0.5, 0.0], [-0.5, 1.0]]
    """
    x, y = np.meshgrid(
        np.arange(columns) - (columns - 1) / 2, np.arange(rows) - (rows - 1) / 2, indexing="ij"
    )
    return pitch_mm * np.stack([x.ravel(), y.ravel()])


def load(path: str | Path) -> Array:
    """Read a description.

    Raises
    ------
    RecordingError
        It cannot be read, or says what no array can be.
    """
    try:
        text = read_regular(path, LARGEST).decode()
        found = tomllib.loads(text)
    except TooLargeError as error:
        raise RecordingError(
            f"{path}: must have {LARGEST} bytes at most; got {error.size}"
        ) from None
    except OSError as error:
        raise RecordingError(f"{path}: must be a file to read; got {error.strerror}") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RecordingError(f"{path}: must be TOML; got {error}") from None
    known = list(Array.__dataclass_fields__)
    for name in found:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f" (nearest: {near[0]!r})" if near else ""
            raise RecordingError(
                f"{path}: key: must be one of {', '.join(known)}; got {name!r}{hint}"
            )
    press = found.get("press")
    if press is not None and (isinstance(press, bool) or press not in (-1, 1)):
        raise RecordingError(f"{path}: press: must be 1 or -1; got {shown(press)}")
    array = Array(
        _rows(path, found, "positions_mm", 2),
        _pair(path, found, "mm_per_reading"),
        _pair(path, found, "n_per_mm"),
        _rows(path, found, "rest", 3),
        press,
    )
    at = array.positions_mm
    if at is not None and at.shape[1] < 2:
        raise RecordingError(f"{path}: positions_mm: must be two taxels or more; got 1")
    if at is not None and len(np.unique(at, axis=1).T) < at.shape[1]:
        raise RecordingError(f"{path}: positions_mm: must differ from one another; got two alike")
    return array


def _rows(path: str | Path, found: dict[str, Any], name: str, width: int) -> np.ndarray | None:
    """Rows of `width` numbers each, transposed."""
    if name not in found:
        return None
    rows = found[name]
    good = isinstance(rows, list) and rows and all(
        isinstance(row, list) and len(row) == width and all(map(_is_number, row)) for row in rows
    )  # fmt: skip
    if not good:
        raise RecordingError(
            f"{path}: {name}: must be a list of {width} finite numbers a taxel; got {shown(rows)}"
        )
    return np.array(rows, float).T


def _pair(path: str | Path, found: dict[str, Any], name: str) -> tuple[float, float] | None:
    if name not in found:
        return None
    pair = found[name]
    if not (isinstance(pair, list) and len(pair) == 2 and all(_is_number(v, 0.0) for v in pair)):
        raise RecordingError(
            f"{path}: {name}: must be 2 numbers above 0, shear and normal; got {shown(pair)}"
        )
    return float(pair[0]), float(pair[1])


def _is_number(value: Any, above: float = -np.inf) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and above < value < np.inf
