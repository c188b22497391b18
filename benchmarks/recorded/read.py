"""Read a file by what it holds, whatever its name."""

from __future__ import annotations

from pathlib import Path

from benchmarks.recorded import arq, papillarray
from benchmarks.recorded.array import Array
from benchmarks.recorded.hdf5 import SIGNATURE
from benchmarks.recorded.recording import LeftOut, Recording, RecordingError
from topology.files import open_regular

__all__ = ["read"]

POINTER = b"version https://git-lfs"
"""How a file begins that Git LFS has not fetched."""


def read(path: Path, array: Array) -> tuple[list[Recording], list[LeftOut]]:
    """All recordings of a file, and those that cannot be scored.

    Raises
    ------
    RecordingError
        It cannot be read, or is of no layout that is known.
    LibraryError
        h5py is not installed, and the file needs it.
    """
    try:
        with open_regular(path) as file:
            head = file.read(len(POINTER))
    except OSError as error:
        raise RecordingError(f"{path}: must be a file to read; got {error.strerror}") from None
    if head == POINTER:
        raise RecordingError(
            f"{path}: must be the recording itself; got a pointer of Git LFS: git lfs pull"
        )
    if head.startswith(SIGNATURE):
        return arq.read(path, array)
    return papillarray.read(path, array)
