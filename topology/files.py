"""Files that are there whole or not at all."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

__all__ = ["whole_file"]


@contextmanager
def whole_file(path: Path, mode: str = "wb", **how: Any) -> Iterator[IO[Any]]:
    """Open a file beside `path`, which takes its place at the end of the block, and is gone if an
    error ends it; `how` is for `open`. Of several that write at once, the last one stays."""
    beside = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.part")
    try:
        with beside.open(mode, **how) as file:
            yield file
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
