"""Taxel images: the forces of a patch, unit by unit, as an image."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skin.errors import OptionError, SkinError, shown

if TYPE_CHECKING:
    from skin.state import Reading, State
    from topology import Topology

__all__ = ["TaxelGrid", "TaxelImage"]

_CELL = re.compile(r"r(\d+)c(\d+)")
"""The name of a unit in a patch of rows and columns."""


class TaxelImage(NamedTuple):
    """Forces of a patch, unit by unit, as an image.

    Attributes
    ----------
    force : ndarray, shape (h, w, 3), float32
        Newton, unit frames: Fx, Fy, Fz of the unit in each cell; NaN where it is not valid.
    valid : ndarray, shape (h, w), bool
        Whether the cell has a unit that may be used.
    """

    force: np.ndarray
    valid: np.ndarray


class TaxelGrid:
    """The units of a patch as cells of an image.

    Parameters
    ----------
    topology : Topology
    patch : str, optional
        Name of the patch; the only one if not given.
    cells : array_like of int, shape (h, w), optional
        Index of the unit in each cell, -1 for none. If not given, row and column are those of the
        names, ``patch/r3c4``: patches of kind "grid" map exactly; in staggered rows ("hex") each
        second row lies half a cell further; the first and last columns of a whole "cylinder" are
        neighbours.

    Attributes
    ----------
    patch : str
    cells : ndarray, shape (h, w), int64

    Raises
    ------
    OptionError
        There is no such patch, or it has no rows and columns and `cells` are not given, or these
        are not units of the skin, each once.

    Examples
    --------
    >>> import topology
    >>> TaxelGrid(topology.load("palm")).cells[1, :3]
    array([ 8,  9, 10])
    """

    def __init__(self, topology: Topology, patch: str | None = None, cells: Any = None) -> None:
        if patch is None:
            if len(topology.patch_names) != 1:
                raise OptionError(f"patch: must be one of {', '.join(topology.patch_names)}; got "
                                  "none")  # fmt: skip
            patch = topology.patch_names[0]
        if patch not in topology.patch_names:
            raise OptionError.unknown("patch", patch, topology.patch_names)
        self.patch = patch
        self._n = topology.n
        if cells is None:
            self.cells = _cells_by_name(topology, patch)
        else:
            self.cells = _checked_cells(cells, np.flatnonzero(
                topology.patch == topology.patch_names.index(patch)
            ))  # fmt: skip

    def __call__(self, state: State | Reading) -> TaxelImage:
        """The image of a state, or images of a reading of t cycles, shapes (t, h, w, 3) and
        (t, h, w).

        Parameters
        ----------
        state : State or Reading
            With `force`.

        Raises
        ------
        NotWantedError
            Forces were not wanted.
        SkinError
            It is of another skin.
        """
        units: Any = getattr(state, "units", state)
        return self.image(units.force, units.valid)

    def image(self, force: np.ndarray, valid: np.ndarray) -> TaxelImage:
        """The image of the forces of all units, shape (…, 3, n), and their validity, (…, n)."""
        if np.shape(valid)[-1] != self._n:
            raise SkinError(f"{self.patch}: must be a state of {self._n} units; got one of "
                            f"{np.shape(valid)[-1]}")  # fmt: skip
        image = np.moveaxis(force[..., self.cells], -3, -1).astype(np.float32)
        is_valid = valid[..., self.cells] & (self.cells >= 0) & np.isfinite(image).all(axis=-1)
        image[~is_valid] = np.nan
        return TaxelImage(image, is_valid)


def _cells_by_name(topology: Topology, patch: str) -> np.ndarray:
    """Cells of a patch whose units are named by row and column."""
    units = np.flatnonzero(topology.patch == topology.patch_names.index(patch))
    names = [topology.unit_names[i].removeprefix(f"{patch}/") for i in units]
    found = [_CELL.fullmatch(name) for name in names]
    if not all(found):
        other = names[found.index(None)]
        raise OptionError(
            f"patch {patch!r}: must have rows and columns, or `cells` with the unit of each cell; "
            f"got a unit {other!r}"
        )
    at = np.array([(int(one[1]), int(one[2])) for one in found if one])
    cells = np.full(at.max(axis=0) + 1, -1, np.int64)
    cells[at[:, 0], at[:, 1]] = units
    return cells


def _checked_cells(cells: Any, units: np.ndarray) -> np.ndarray:
    """Given cells, if they are units of the patch, each at most once."""
    try:
        checked = np.array(cells).astype(np.int64, casting="same_kind")
    except (TypeError, ValueError, OverflowError):
        checked = np.zeros(0, np.int64)
    used = checked[checked >= 0]
    is_image = checked.ndim == 2 and checked.size > 0
    if not is_image or np.unique(used).size < used.size or not np.isin(used, units).all():
        raise OptionError(
            f"cells: must be units of the patch, {units[0]} to {units[-1]}, each once, or -1, "
            f"shape (h, w); got {shown(cells)}"
        )
    return np.maximum(checked, -1)
