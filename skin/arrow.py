"""Import of pyarrow, for tables in Parquet files; the only file that imports it."""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

from skin.errors import LibraryError

__all__ = ["Arrow", "arrow_for"]


class Arrow(NamedTuple):
    """The modules of pyarrow that are used here."""

    arrow: Any
    parquet: Any


def arrow_for(where: object, purpose: str) -> Arrow:
    """Load pyarrow.

    Parameters
    ----------
    where : object
        The file that needs it; the error message names it.
    purpose : "read" or "written"
        What it is needed for.

    Raises
    ------
    LibraryError
        pyarrow is not installed.
    """
    try:
        return Arrow(import_module("pyarrow"), import_module("pyarrow.parquet"))
    except ImportError as error:
        raise LibraryError(
            f"{where}: must have pyarrow to be {purpose}; not installed: "
            "pip install 'f3t-skin[data]'"
        ) from error
