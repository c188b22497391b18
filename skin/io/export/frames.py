"""Camera frames from files: a folder of images named by their stamps, or a CSV table."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from skin.errors import SkinError, shown
from skin.io.export.align import LATEST_NS, Frame, check_later
from skin.io.export.single import check_single
from topology.files import open_regular, read_regular

__all__ = ["read_frames"]

ENDINGS = (".jpeg", ".jpg", ".png")
CAMERA = "camera"
"""Camera name for a folder."""
LARGEST_IMAGE = 256 << 20
"""Maximum bytes of a cell [assumed]."""


def read_frames(path: Path, offset_ns: int = 0) -> Iterator[Frame]:
    """Frames in the order of the table, or of their stamps.

    Parameters
    ----------
    path : Path
        A folder of ``<stamp_ns>.png`` (or .jpg); or a CSV table with the column ``stamp_ns`` or
        ``time_s``, columns of image files (relative to it) named by their camera, and columns of
        numbers: ``action.grip`` is a part of the feature ``action``.
    offset_ns : int
        Offset of the skin's clock from the camera's.

    Raises
    ------
    SkinError
        An invalid name, column or cell; no frames; stamps that run back or are out of range.
    OSError
        A file cannot be read.
    """
    frames = _of_folder(path) if path.is_dir() else _of_table(path)
    last_ns: int | None = None
    for where, frame in frames:
        stamp_ns = frame.stamp_ns + offset_ns
        if not 0 <= stamp_ns <= LATEST_NS:
            raise SkinError(f"{where}: must be from 0 to {LATEST_NS} ns on the clock of the skin; "
                            f"got {shown(stamp_ns)}")  # fmt: skip
        if last_ns is not None:
            check_later(where, stamp_ns, last_ns)
        last_ns = stamp_ns
        yield frame._replace(stamp_ns=stamp_ns)


def _of_folder(folder: Path) -> Iterator[tuple[str, Frame]]:
    stamps: dict[int, Path] = {}
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() not in ENDINGS:
            continue
        if not (file.stem.isascii() and file.stem.isdigit()):
            raise SkinError(
                f"{file}: must be named by the time of its frame in ns, as "
                f"1700000000000000000{file.suffix}; got {file.name!r}"
            )
        other = stamps.setdefault(int(file.stem), file)
        if other is not file:
            raise SkinError(f"{file}: must be the only image of its time; got {other.name!r}, too")
    if not stamps:
        raise SkinError(f"{folder}: must have images ({', '.join(ENDINGS)}); got none")
    for stamp_ns, file in sorted(stamps.items()):
        yield str(file), Frame(stamp_ns, {CAMERA: read_regular(file, LARGEST_IMAGE)})


def _of_table(path: Path) -> Iterator[tuple[str, Frame]]:
    with open_regular(path) as raw:
        lines = raw.read().decode("utf-8-sig", errors="replace").splitlines()
    rows = _rows(path, lines)
    _, head = next(rows, ("", []))
    clock = next((name for name in ("stamp_ns", "time_s") if name in head), None)
    if clock is None:
        raise SkinError(f"{path}:1: must have a column stamp_ns or time_s; got {head}")
    if len(set(head)) < len(head):
        twice = next(name for name in head if head.count(name) > 1)
        raise SkinError(f"{path}:1: {twice}: must be a column of its own; got two of that name")
    count = 0
    for where, row in rows:
        if not row:
            continue
        if len(row) != len(head):
            raise SkinError(f"{where}: must have {len(head)} cells; got {len(row)}")
        yield where, _row(where, path.parent, clock, dict(zip(head, row, strict=True)))
        count += 1
    if not count:
        raise SkinError(f"{path}: must have rows below its head; got none")


def _rows(path: Path, lines: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Rows of a table, with the line where each ends."""
    rows = csv.reader(lines)
    while True:
        try:
            row = next(rows)
        except StopIteration:
            return
        except csv.Error as error:
            raise SkinError(
                f"{path}:{rows.line_num}: must be a row of a CSV table; got: {error}"
            ) from None
        yield f"{path}:{rows.line_num}", [cell.strip() for cell in row]


def _row(where: str, folder: Path, clock: str, cells: dict[str, str]) -> Frame:
    """The frame of a row: images by file name, all other cells as numbers."""
    stamp_ns = _stamp_ns(where, clock, cells.pop(clock))
    images, values = {}, {}
    for name, cell in cells.items():
        if cell.lower().endswith(ENDINGS):
            images[name] = read_regular(folder / cell, LARGEST_IMAGE)
        else:
            feature = name.rpartition(".")[0] or name
            number = _number(where, name, cell)
            check_single(f"{where}: {name}", number)
            values.setdefault(feature, []).append(number)
    return Frame(
        stamp_ns, images, {name: np.array(one, np.float32) for name, one in values.items()}
    )


def _number(where: str, name: str, cell: str) -> float | int:
    """A number; an integer stays one, since a float would round it silently."""
    for kind in (int, float):
        try:
            number = kind(cell)
        except ValueError:
            continue
        if isinstance(number, float) and not math.isfinite(number):
            raise SkinError(f"{where}: {name}: must be finite; got {cell[:40]!r}")
        return number
    raise SkinError(
        f"{where}: {name}: must be a number, or the name of an image; got {cell[:40]!r}"
    )


def _stamp_ns(where: str, clock: str, cell: str) -> int:
    if clock == "time_s":
        # a product of floats may be infinite
        return round(10**9 * Fraction(_number(where, clock, cell)))
    try:
        return int(cell)
    except ValueError:
        raise SkinError(f"{where}: stamp_ns: must be an integer; got {cell[:40]!r}") from None
