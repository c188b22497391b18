"""Progress of a job by the manifests of its logs: rate and remaining time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from skin.io.bulk.manifest import load_manifest

if TYPE_CHECKING:
    from skin.io.bulk.job import Job, Part

__all__ = ["OnProgress", "Progress", "ProgressReport"]

LOOK_S = 0.5


class ProgressReport(NamedTuple):
    """Progress of a job."""

    logs_done: int
    logs: int
    fraction: float  # of the bytes of all logs
    bytes_per_s: float
    left_s: float  # infinite until the rate is known

    def __str__(self) -> str:
        left = "" if self.left_s == float("inf") else (
            f", {int(self.left_s) // 60}:{int(self.left_s) % 60:02} left")  # fmt: skip
        return (f"{self.logs_done}/{self.logs} logs, {100 * self.fraction:.0f} %, "
                f"{self.bytes_per_s / 1e6:.1f} MB/s{left}")  # fmt: skip


OnProgress = Callable[[ProgressReport], None]


class Progress:
    """Polls the manifests, which this process, others or other machines write.

    Parameters
    ----------
    job : Job
    parts : list of Part
    on_progress : callable or None
        Called with a `ProgressReport`.
    """

    def __init__(self, job: Job, parts: list[Part], on_progress: OnProgress | None) -> None:
        self._job, self._on_progress, self._begun = job, on_progress, time.monotonic()
        self._open = {part.key: part for part in parts}
        self._total = max(sum(part.size for part in parts), 1)
        self._count, self._done_bytes = len(parts), 0

    def ended(self, part: Part) -> None:
        """A log is finished."""
        if self._open.pop(part.key, None) is not None:
            self._done_bytes += part.size
        self.look()

    def look(self) -> None:
        """Report the progress."""
        if self._on_progress is None:
            return
        done = self._done_bytes
        for part in [*self._open.values()]:
            found = load_manifest(self._job, part) or {}
            got = found.get("summary", {}).get("read_bytes") or 0
            done += min(int(got), part.size)
        passed_s = max(time.monotonic() - self._begun, 1e-6)
        left_s = passed_s * (self._total - done) / done if done else float("inf")
        self._on_progress(
            ProgressReport(
                logs_done=self._count - len(self._open),
                logs=self._count,
                fraction=done / self._total,
                bytes_per_s=done / passed_s,
                left_s=left_s,
            )
        )

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Poll while the block runs."""
        if self._on_progress is None:
            yield
            return
        ended = threading.Event()

        def work() -> None:
            while not ended.wait(LOOK_S):
                self.look()

        thread = threading.Thread(target=work, name="skin-progress", daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
