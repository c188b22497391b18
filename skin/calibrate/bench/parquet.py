"""Tables from Parquet files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skin.arrow import arrow_for
from skin.errors import ScanError

__all__ = ["read_parquet"]


def read_parquet(path: Path) -> dict[str, np.ndarray]:
    """Columns of a Parquet file by name, float64; NaN where a cell is empty.

    Raises
    ------
    LibraryError
        pyarrow is not installed.
    ScanError
        The file is damaged, or a column holds no numbers.
    """
    arrow, parquet = arrow_for(path, "read")
    try:
        table = parquet.read_table(path)
    except (arrow.ArrowException, OSError) as error:
        raise ScanError(f"{path}: must be a Parquet file; got: {error}") from None
    found = {}
    for name in table.column_names:
        try:
            found[name] = table.column(name).cast(arrow.float64()).to_numpy()
        except arrow.ArrowException as error:
            raise ScanError(f"{path}: column {name!r}: must be numbers; got: {error}") from None
    return found
