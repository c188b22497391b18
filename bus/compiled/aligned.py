"""Arrays that begin on the boundary of a cache line."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["LINE", "zeros"]

LINE = 64
"""Bytes of a cache line, and of the widest vectors."""


def zeros(shape: int | tuple[int, ...], dtype: Any = float) -> np.ndarray:
    """As `numpy.zeros`, for arrays that kernels walk: numpy begins large ones 16 bytes into a line,
    and nearly every vector that is read of them lies in two lines then.

    Parameters
    ----------
    shape : int or tuple of int
    dtype : dtype-like

    Returns
    -------
    ndarray
        C-contiguous.
    """
    dtype = np.dtype(dtype)
    size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    room = np.zeros(size + LINE, np.uint8)
    start = -room.ctypes.data % LINE
    return room[start : start + size].view(dtype).reshape(shape)
