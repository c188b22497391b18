"""Tables of a bench: CSV with a head, or Parquet."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from skin.errors import ScanError
from topology.files import open_regular

__all__ = ["head_of", "read_table"]


def read_table(path: Path) -> dict[str, np.ndarray]:
    """Columns of a table by name, each shape (t,), float64; an empty cell is NaN.

    Parameters
    ----------
    path : Path
        ``.parquet``, or CSV: comma, decimal point, names in the first line.

    Raises
    ------
    ScanError
        A cell that is no number, with its line and column; two columns of one name; no rows.
    LibraryError
        Parquet without pyarrow.
    """
    if path.suffix.lower() == ".parquet":
        from skin.calibrate.bench.parquet import read_parquet

        return read_parquet(path)
    head = head_of(path)
    if len(set(head)) < len(head):
        twice = next(name for name in head if head.count(name) > 1)
        raise ScanError(f"{path}:1: {twice}: must be a column of its own; got two of that name")
    with open_regular(path) as raw:
        text = raw.read().decode("utf-8-sig", errors="replace")
    if not text.partition("\n")[2].strip():
        raise ScanError(f"{path}: must have rows below its head; got none")
    try:
        cells = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, ndmin=2)
    except ValueError:  # empty cells, or what is none of numbers: reported with its line
        cells = _slowly(path, head, text)
    if cells.shape[1] != len(head):
        raise ScanError(f"{path}:1: must have as many names as columns, {cells.shape[1]}; got "
                        f"{len(head)}")  # fmt: skip
    return dict(zip(head, cells.T, strict=True))


def head_of(path: Path) -> list[str]:
    """Names in the first line of a CSV file."""
    with open_regular(path) as raw:
        first = raw.readline(1 << 16).decode("utf-8-sig", errors="replace")
    return [name.strip() for name in next(csv.reader([first]), [])]


def _slowly(path: Path, head: list[str], text: str) -> np.ndarray:
    rows = []
    for line, row in enumerate(csv.reader(io.StringIO(text)), start=1):
        if line == 1 or not row:
            continue
        if len(row) != len(head):
            raise ScanError(f"{path}:{line}: must have {len(head)} cells; got {len(row)}")
        cells = []
        for name, cell in zip(head, row, strict=True):
            try:
                cells.append(float(cell) if cell.strip() else np.nan)
            except ValueError:
                raise ScanError(
                    f"{path}:{line}: {name}: must be a number; got {cell[:40]!r}"
                ) from None
        rows.append(cells)
    return np.array(rows, float).reshape(-1, len(head))
