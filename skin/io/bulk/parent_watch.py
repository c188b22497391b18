"""Ends the processes of a pool when their parent process ends, for any reason.

A killed parent would leave its pool waiting for ever. So each worker process holds the reading end
of a pipe that nobody writes to: it is closed when the parent ends.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import Any

__all__ = ["hold"]

GRACE_S = 10.0
"""Time to remove incomplete files."""


def hold(pipe: Any) -> None:
    """End this process when the other end of a pipe closes, as Ctrl-C does."""
    signal.signal(signal.SIGINT, _leave)
    threading.Thread(target=_end_with, args=(pipe,), name="skin-parent-watch", daemon=True).start()


def _leave(_number: int, _frame: object) -> None:
    """Exit without a traceback."""
    raise SystemExit(128 + signal.SIGINT)


def _end_with(pipe: Any) -> None:
    try:
        pipe.recv_bytes()
    except (EOFError, OSError):
        pass
    main = threading.main_thread().ident
    if main is not None and hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main, signal.SIGINT)
        time.sleep(GRACE_S)
    os._exit(1)
