"""Images of a camera as files in memory; the one file that imports Pillow."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from skin.errors import LibraryError, SkinError

__all__ = ["encoded", "pixels"]

KINDS = ("JPEG", "PNG")
MOST_PIXELS = 64_000_000
"""Of an image [assumed: no camera of a robot has more]: a small file may unpack to gigabytes."""


def encoded(where: str, image: bytes | np.ndarray) -> tuple[bytes, tuple[int, int, int]]:
    """The file of an image, as it is if it is one, and the shape of its pixels.

    Parameters
    ----------
    where : str
        As messages name it.
    image : bytes or ndarray, shape (h, w, 3), uint8
        A PNG or JPEG file; pixels become PNG, without loss.

    Raises
    ------
    SkinError
        It is neither.
    LibraryError
        Pillow is not installed.
    """
    if isinstance(image, bytes):
        with _opened(where, image) as file:
            return image, (file.height, file.width, 3)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise SkinError(f"{where}: must be pixels, shape (h, w, 3), uint8; got {image.shape}, "
                        f"{image.dtype}")  # fmt: skip
    out = io.BytesIO()
    _library(where).fromarray(image).save(out, format="PNG", compress_level=3)
    height, width, colours = image.shape
    return out.getvalue(), (height, width, colours)


def pixels(where: str, file: bytes) -> np.ndarray:
    """Pixels of the file of an image, shape (h, w, 3), uint8."""
    with _opened(where, file) as image:
        try:
            return np.asarray(image.convert("RGB"))
        except (OSError, SyntaxError, ValueError) as error:
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
