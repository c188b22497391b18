"""Processes of a pool end with who made them, however that ends.

A pool waits for what runs in it, and where its own process is killed, the others wait for ever. So
each of them has the reading end of a pipe whose other end nobody writes to: it is closed by who
made them, or by its death.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import Any

__all__ = ["hold"]

GRACE_S = 10.0
"""For files to be dropped that are not whole."""


def hold(pipe: Any) -> None:
    """Let this process end with the other end of a pipe; what it does is left as by Ctrl-C."""
    signal.signal(signal.SIGINT, _leave)
    threading.Thread(target=_end_with, args=(pipe,), name="skin-leash", daemon=True).start()


def _leave(_number: int, _frame: object) -> None:
    """Without the traceback of who waits."""
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
