"""HDF5 files of numbers: opened to read, and nothing followed, unpickled or executed.

Links to other files are not followed, and datasets whose numbers lie elsewhere are refused, as are
those whose type is none of numbers: objects, references, text and records.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.recorded.recording import RecordingError
from skin.errors import LibraryError

__all__ = ["SIGNATURE", "groups_with", "numbers", "opened"]

SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""First bytes of an HDF5 file [HDF5 File Format Specification 3.0, II.A]."""
LARGEST = 1 << 30
"""Bytes of one dataset, unpacked [assumed: nearly three hours of 24 taxels at 180 Hz]."""
LISTED = 5
BROKEN = (OSError, RuntimeError, KeyError, TypeError, ValueError)
"""What h5py raises where a file is damaged: which of them depends on where."""


def _library(path: Path) -> Any:
    try:
        import h5py
    except ImportError as error:
        raise LibraryError(
            f"{path}: must have h5py to be read; not installed: pip install 'f3t-skin[hdf5]'"
        ) from error
    return h5py


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open a file to read.

    Raises
    ------
    RecordingError
        It is cut short, or no HDF5.
    LibraryError
        h5py is not installed.
    """
    h5py = _library(path)
    try:
        file = h5py.File(path, "r")
    except BROKEN as error:
        raise RecordingError(f"{path}: must be a whole HDF5 file; got {error}") from None
    with file:
        yield file


def groups_with(path: Path, file: Any, name: str) -> list[str]:
    """Names of all groups that hold a dataset `name`, in natural order.

    Raises
    ------
    RecordingError
        There is none, or the file is damaged.
    """
    h5py, found, others = _library(path), [], []

    def visit(at: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            group, _, last = at.rpartition("/")
            (found if last == name else others).append(group if last == name else at)

    try:
        file.visititems(visit)  # hard links only: neither soft nor external ones
    except BROKEN as error:
        raise RecordingError(f"{path}: must be a whole HDF5 file; got {error}") from None
    if not found:
        shown = ", ".join(map(repr, others[:LISTED])) or "no dataset at all"
        more = f" and {len(others) - LISTED} more" if len(others) > LISTED else ""
        raise RecordingError(f"{path}: must hold groups with a dataset {name!r}; got {shown}{more}")
    return sorted(found, key=_natural)


def _natural(name: str) -> list[tuple[str, int]]:
    """A key that puts Exp2 before Exp10."""
    parts = []
    for part in name.split("/"):
        digits = len(part) - len(part.rstrip("0123456789"))
        parts.append((part[: len(part) - digits], int(part[len(part) - digits :] or 0)))
    return parts


def numbers(path: Path, file: Any, group: str, name: str, *, whole: bool = False) -> np.ndarray:
    """A dataset of a group, as float64, or int64 where `whole`.

    Raises
    ------
    RecordingError
        It is not there, its numbers are none or lie elsewhere, or it cannot be read.
    """
    where = f"{path}: {group}/{name}"
    try:
        return _numbers(_library(path), where, file[group], name, whole)
    except BROKEN as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(f"{where}: must be readable; got {error}") from None


def _numbers(h5py: Any, where: str, group: Any, name: str, whole: bool) -> np.ndarray:
    node = group.get(name)
    if not isinstance(node, h5py.Dataset):
        near = get_close_matches(name, group, n=1)
        hint = f" (nearest: {near[0]!r})" if near else ""
        raise RecordingError(f"{where}: must be a dataset; got none{hint}")
    if node.dtype.kind not in ("iub" if whole else "iuf"):
        wanted = "integers" if whole else "numbers"
        raise RecordingError(f"{where}: must be {wanted}; got dtype {node.dtype}")
    if node.is_virtual or node.external:
        raise RecordingError(f"{where}: must hold its numbers itself; got a link to other files")
    if node.size * 8 > LARGEST:
        raise RecordingError(f"{where}: must have {LARGEST // 8} numbers at most; got {node.size}")
    return np.asarray(node[()], np.int64 if whole else np.float64)
