"""Images of a camera as files in memory; the one file that imports Pillow."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from skin.errors import LibraryError, SkinError, shown

__all__ = ["encoded", "pixels"]

KINDS = ("JPEG", "PNG")
MODE = "RGB"
MOST_PIXELS = 64_000_000
"""Of an image [assumed: no camera of a robot has more]: a small file may unpack to gigabytes."""


def encoded(where: str, image: bytes | np.ndarray) -> tuple[bytes, tuple[int, int, int]]:
    """The file of an image, as it is if it is one, and the shape of its pixels.

    Parameters
    ----------
    where : str
        As messages name it.
    image : bytes or ndarray, shape (h, w, 3), uint8
        A PNG or JPEG file of RGB; pixels become PNG, without loss.

    Raises
    ------
    SkinError
        It is neither, not whole, or of other colours than RGB.
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
    """Pixels of the file of an image, shape (h, w, 3), uint8; see `encoded`."""
    with _opened(where, file) as image:
        # a data set says that its images have three channels: what is not RGB has one, two or four
        if image.mode != MODE:
            raise SkinError(f"{where}: must be an image of {MODE}; got one of {image.mode}")
        try:
            return np.asarray(image)
        except Exception as error:  # anything may come of reading what is damaged
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
