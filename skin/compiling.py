"""Kernels are compiled once on a machine, which takes long: side by side, and not in silence.

On a terminal a bar on standard error says how far it is. Elsewhere, or where NO_COLOR is set, the
logger "skin" says it in two lines, as warnings: a program that sets up no logging shows them on
standard error; ``logging.getLogger("skin").setLevel("ERROR")`` keeps both away.
"""

from __future__ import annotations

import functools
import logging
import os
import shutil
import sys
import time
from collections.abc import Iterable
from threading import Thread
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from bus.compiled.warm import Job

__all__ = ["announce", "compile_calls", "terminal"]

CELLS = 24
"""Of the bar. [assumed]"""

_log = logging.getLogger("skin")


def compile_calls(calls: Iterable[tuple[Any, ...]]) -> Thread:
    """Have several processes compile kernels that are not in the cache.

    Parameters
    ----------
    calls : iterable of tuple
        Kernels with their arguments, those that take longest first.

    Returns
    -------
    Thread
        That ends when all are compiled.
    """
    from bus.compiled.warm import jobs_of

    thread = Thread(target=_compile, args=(jobs_of(calls),), daemon=True)
    thread.start()
    return thread


def _compile(jobs: list[Job]) -> None:
    """Compile, and show how far it is."""
    from bus.compiled.warm import side_by_side

    if not jobs:
        return
    file, began, left = terminal(), time.monotonic(), len(jobs)
    if file is None:
        _say_begun()
    else:
        _draw(file, 0, len(jobs), began)

    def done(job: Job) -> None:
        nonlocal left
        left -= 1
        if file is not None:
            _draw(file, len(jobs) - left, len(jobs), began)

    side_by_side(jobs, done)
    if file is not None:
        file.write("\r\x1b[K")
        file.flush()
    level = logging.INFO if file is not None else logging.WARNING
    _log.log(level, "f3t-skin: compiled in %.1f s", time.monotonic() - began)


def _draw(file: TextIO, done: int, total: int, began: float) -> None:
    """Draw the bar."""
    full = round(CELLS * done / total)
    text = (
        f"f3t-skin: compiling for this machine, once [{'#' * full}{'.' * (CELLS - full)}] "
        f"{done} of {total} kernels, {time.monotonic() - began:.0f} s"
    )
    file.write(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}")
    file.flush()


def terminal() -> TextIO | None:
    """Standard error, if it shows a bar."""
    file: TextIO | None = sys.stderr
    return file if file is not None and file.isatty() and not os.environ.get("NO_COLOR") else None


def announce() -> None:
    """Say that kernels will be compiled, where none is kept yet: for what compiles as it goes."""
    from bus.compiled import cache

    folder = cache.folder()
    if folder is None or next(folder.iterdir(), None) is None:
        _say_begun()


@functools.cache
def _say_begun() -> None:
    """Once in this process, whichever way comes first."""
    _log.warning("f3t-skin: compiling kernels for this machine, once …")
