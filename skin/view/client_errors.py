"""Log lines for invalid clients of a view's process: one line each, without traceback."""

from __future__ import annotations

import logging
import sys
import warnings

__all__ = ["log_in_lines"]

OF_SERVER = ("websockets", "asyncio", "concurrent.futures")
"""Loggers of the view's server."""
MOST = 20
"""Maximum number of lines: otherwise any client could fill a terminal."""


class _Lines(logging.Handler):
    """Logs each message once."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._said: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Log a record."""
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


def log_in_lines() -> None:
    """Let the view's server log one line in place of a traceback, in this process."""
    warnings.filterwarnings("ignore", category=UserWarning, module="viser")  # about unusual values
    lines = _Lines()
    for name in OF_SERVER:
        logger = logging.getLogger(name)
        logger.addHandler(lines)
        logger.propagate = False
