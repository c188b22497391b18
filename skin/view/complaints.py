"""What a view's process says of clients that are no browsers: a line each, and no traceback."""

from __future__ import annotations

import logging
import sys
import warnings

__all__ = ["tell_in_lines"]

OF_SERVER = ("websockets", "asyncio", "concurrent.futures")
"""Loggers of what serves a view."""
MOST = 20
"""Lines in all: whoever can reach a view could fill a terminal otherwise."""


class _Lines(logging.Handler):
    """Says each thing once."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._said: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Say it."""
        error = record.exc_info[1] if record.exc_info else None
        if record.name.startswith("websockets") and error is not None:
            why = f"{type(error).__name__} {error}".strip().splitlines()[0]
            text = f"view: client: must send what a browser sends; got {why} (it was cut off)"
        else:
            why = f": {type(error).__name__} {error}".rstrip() if error is not None else ""
            text = f"view: {record.getMessage().strip().splitlines()[0]}{why}"
        if text not in self._said and len(self._said) < MOST:
            self._said.add(text)
            sys.stderr.write(f"{text}\n")


def tell_in_lines() -> None:
    """Let what serves a view say in a line what it would say with a traceback, in this process."""
    warnings.filterwarnings("ignore", category=UserWarning, module="viser")  # of odd values
    lines = _Lines()
    for name in OF_SERVER:
        logger = logging.getLogger(name)
        logger.addHandler(lines)
        logger.propagate = False
