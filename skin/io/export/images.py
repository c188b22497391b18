"""Images: forces of a patch as a taxel image, and those of cameras as encoded files in memory; the
only file that imports Pillow."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skin.errors import LibraryError, OptionError, SkinError, shown

if TYPE_CHECKING:
    from skin.state import Reading, State
    from topology import Topology

__all__ = ["TaxelGrid", "TaxelImage", "encoded", "pixels"]

KINDS = ("JPEG", "PNG")
MODE = "RGB"
MOST_PIXELS = 64_000_000
"""Maximum size [assumed: more than any robot camera]: a small file may unpack to gigabytes."""

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
        checked = np.array(cells)
    except ValueError:
        checked = np.zeros(0)
    if checked.ndim != 2 or checked.dtype.kind not in "iu" or not checked.size:
        raise OptionError(f"cells: must be indices of units, shape (h, w); got {shown(cells)}")
    used = checked[checked >= 0]
    if foreign := sorted(set(used.tolist()) - set(units.tolist())):
        raise OptionError(f"cells: must be units of the patch, {units[0]} to {units[-1]}, or -1; "
                          f"got {foreign[0]}")  # fmt: skip
    if used.size != np.unique(used).size:
        raise OptionError("cells: must have each unit once at most; got one in several cells")
    return np.where(checked < 0, -1, checked).astype(np.int64)


def encoded(where: str, image: bytes | np.ndarray) -> tuple[bytes, tuple[int, int, int]]:
    """The encoded file of an image, unchanged if it is one, and the shape of its pixels.

    Parameters
    ----------
    where : str
        Used in messages.
    image : bytes or ndarray, shape (h, w, 3), uint8
        A PNG or JPEG file of RGB; pixels become PNG, without loss.

    Raises
    ------
    SkinError
        It is neither, is truncated, or is not RGB.
    LibraryError
        Pillow is not installed.
    """
    if isinstance(image, bytes):
        height, width, _ = pixels(where, image).shape
        return image, (height, width, 3)
    if not isinstance(image, np.ndarray):
        raise SkinError(f"{where}: must be pixels or the bytes of a file; got {shown(image)}")
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
        raise SkinError(f"{where}: must be pixels, shape (h, w, 3), uint8; got {image.shape}, "
                        f"{image.dtype}")  # fmt: skip
    out = io.BytesIO()
    _library(where).fromarray(image).save(out, format="PNG", compress_level=3)
    height, width, colours = image.shape
    return out.getvalue(), (height, width, colours)


def pixels(where: str, file: bytes) -> np.ndarray:
    """Decoded pixels of an image file, shape (h, w, 3), uint8; see `encoded`."""
    with _opened(where, file) as image:
        # a data set declares three channels: other images have one, two or four
        if image.mode != MODE:
            raise SkinError(f"{where}: must be an image of {MODE}; got one of {image.mode}")
        try:
            return np.asarray(image)
        except Exception as error:  # a damaged file may raise anything
            raise SkinError(f"{where}: must be a whole image; got: {error}") from None


def _opened(where: str, file: bytes) -> Any:
    library = _library(where)
    try:
        image = library.open(io.BytesIO(file), formats=KINDS)
    except (OSError, SyntaxError, ValueError, library.DecompressionBombError) as error:
        raise SkinError(f"{where}: must be a PNG or JPEG file; got: {error}") from None
    if image.width * image.height > MOST_PIXELS:
        raise SkinError(f"{where}: must have {MOST_PIXELS} pixels at most; got {image.width} × "
                        f"{image.height}")  # fmt: skip
    return image


def _library(where: str) -> Any:
    try:
        from PIL import Image
    except ImportError as error:
        raise LibraryError(
            f"{where}: must have Pillow to be read; not installed: pip install 'f3t-skin[data]'"
        ) from error
    return Image
