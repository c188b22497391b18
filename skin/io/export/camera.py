"""Frames of a camera: from a folder of images, as encoded files in memory; the only file that
imports Pillow."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from skin.errors import SkinError, shown
from skin.io.messages.definitions import require
from topology.files import read_regular

__all__ = ["LATEST_NS", "Frame", "encoded", "read_frames"]

ENDINGS = (".jpeg", ".jpg", ".png")
CAMERA = "camera"
"""Name of the camera of a folder."""
LATEST_NS = 2**63 - 1
"""Latest stamp [derived: the largest int64]."""
LARGEST_IMAGE = 256 << 20
"""Maximum bytes of a file [assumed]."""
KINDS, MODE = ("JPEG", "PNG"), "RGB"


class Frame(NamedTuple):
    """Data of a camera, and optionally of the robot, at one time.

    Attributes
    ----------
    stamp_ns : int
        On the clock of the skin's stamps.
    images : dict of str to bytes or ndarray
        By camera: a PNG or JPEG file, or pixels, shape (h, w, 3), uint8.
    values : dict of str to ndarray, shape (m,)
        Other features, such as ``action`` and ``observation.state``.
    """

    stamp_ns: int
    images: Mapping[str, Any] = MappingProxyType({})
    values: Mapping[str, np.ndarray] = MappingProxyType({})


def read_frames(folder: Path, offset_ns: int = 0) -> Iterator[Frame]:
    """Frames of a folder of ``<stamp_ns>.png`` (or .jpg), in the order of their stamps.

    Parameters
    ----------
    folder : Path
    offset_ns : int
        Offset of the skin's clock from the camera's.

    Raises
    ------
    SkinError
        It is no folder, an image has no stamp or that of another one, or there is none.
    OSError
        A file cannot be read.
    """
    if not folder.is_dir():
        raise SkinError(f"{folder}: must be a folder of images named by their stamps in ns; got "
                        f"{'a file' if folder.exists() else 'none'}")  # fmt: skip
    stamps: dict[int, Path] = {}
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() not in ENDINGS:
            continue
        if not (file.stem.isascii() and file.stem.isdigit()):
            raise SkinError(
                f"{file}: must be named by the time of its frame in ns, as "
                f"1700000000000000000{file.suffix}; got {file.name!r}"
            )
        other = stamps.setdefault(int(file.stem) + offset_ns, file)
        if other is not file:
            raise SkinError(f"{file}: must be the only image of its time; got {other.name!r}, too")
    if not stamps:
        raise SkinError(f"{folder}: must have images ({', '.join(ENDINGS)}); got none")
    for stamp_ns, file in sorted(stamps.items()):
        if not 0 <= stamp_ns <= LATEST_NS:
            raise SkinError(f"{file}: must be from 0 to {LATEST_NS} ns on the clock of the skin; "
                            f"got {shown(stamp_ns)}")  # fmt: skip
        yield Frame(stamp_ns, {CAMERA: read_regular(file, LARGEST_IMAGE)})


def encoded(where: str, image: bytes | np.ndarray) -> tuple[bytes, np.ndarray]:
    """The encoded file of an image, unchanged if it is one, and its pixels.

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
        return image, _pixels(where, image)
    if not isinstance(image, np.ndarray):
        raise SkinError(f"{where}: must be pixels or the bytes of a file; got {shown(image)}")
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
        raise SkinError(f"{where}: must be pixels, shape (h, w, 3), uint8; got {image.shape}, "
                        f"{image.dtype}")  # fmt: skip
    out = io.BytesIO()
    _library(where).fromarray(image).save(out, format="PNG", compress_level=3)
    return out.getvalue(), image


def _pixels(where: str, file: bytes) -> np.ndarray:
    """Decoded pixels of an image file, shape (h, w, 3), uint8."""
    library = _library(where)
    try:
        opened = library.open(io.BytesIO(file), formats=KINDS)
    except (OSError, SyntaxError, ValueError, library.DecompressionBombError):
        raise SkinError(f"{where}: must be a PNG or JPEG file; got another") from None
    with opened as image:
        # a data set declares three channels: other images have one, two or four
        if image.mode != MODE:
            raise SkinError(f"{where}: must be an image of {MODE}; got one of {image.mode}")
        try:
            return np.asarray(image)
        except Exception as error:  # a damaged file may raise anything
            raise SkinError(f"{where}: must be a whole image; got: {error}") from None


def _library(where: str) -> Any:
    require(where, "data", "PIL")
    from PIL import Image

    return Image
