"""Files that are there whole or not at all."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

__all__ = ["named", "whole_file"]


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Let errors of writing name `path`: where the disk is full they name none, and a file that is
    to take its place means nothing to the user."""
    try:
        yield
    except OSError as error:
        other = Path(str(error.filename or path)).name
        if path.name in other and error.filename != str(path):
            raise type(error)(error.errno, error.strerror or str(error), str(path)) from error
        raise


@contextmanager
def whole_file(path: Path, mode: str = "wb", **how: Any) -> Iterator[IO[Any]]:
    """Open a file beside `path`, which takes its place at the end of the block, and is gone if an
    error ends it; `how` is for `open`. Of several that write at once, the last one stays. An error
    of writing names `path`."""
    beside = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.part")
    try:
        with named(path):
            with beside.open(mode, **how) as file:
                yield file
            os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
