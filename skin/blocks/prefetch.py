"""Runs an iterator ahead in a thread."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable, Iterator
from typing import TypeVar

__all__ = ["prefetch"]

T = TypeVar("T")
POLL_S = 0.2
"""Poll interval of a thread that waits for its reader, to see whether it may end."""


def prefetch(items: Iterable[T], most: int = 4) -> Iterator[T]:
    """The same items, produced ahead by a thread, up to `most`; exceptions are passed on.

    Examples
    --------
    >>> list(prefetch(range(3)))
    [0, 1, 2]
    """
    waiting: queue.Queue[tuple[bool, T | BaseException | None]] = queue.Queue(most)
    ended = threading.Event()

    def put(is_last: bool, item: T | BaseException | None) -> None:
        while not ended.is_set():
            try:
                waiting.put((is_last, item), timeout=POLL_S)
                return
            except queue.Full:
                continue

    def work() -> None:
        try:
            for item in items:
                put(False, item)
                if ended.is_set():
                    return
            put(True, None)
        except BaseException as error:  # raised again in the reader
            put(True, error)

    thread = threading.Thread(target=work, name="skin-ahead", daemon=True)
    thread.start()
    try:
        while True:
            is_last, item = waiting.get()
            if is_last:
                if isinstance(item, BaseException):
                    raise item
                return
            yield item  # type: ignore[misc]
    finally:
        ended.set()
        thread.join()
