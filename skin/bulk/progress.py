"""How far a job is, by the manifests of its logs: rate and time left."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from skin.bulk.manifest import load_manifest

if TYPE_CHECKING:
    from skin.bulk.job import Job, Part

__all__ = ["Progress", "Tell", "Told"]

LOOK_S = 0.5


class Told(NamedTuple):
    """How far a job is."""

    logs_done: int
    logs: int
    share: float  # of the bytes of all logs
    bytes_per_s: float
    left_s: float  # infinite before anything is known

    def __str__(self) -> str:
        left = "" if self.left_s == float("inf") else (
            f", {int(self.left_s) // 60}:{int(self.left_s) % 60:02} left")  # fmt: skip
        return (f"{self.logs_done}/{self.logs} logs, {100 * self.share:.0f} %, "
                f"{self.bytes_per_s / 1e6:.1f} MB/s{left}")  # fmt: skip


Tell = Callable[[Told], None]


class Progress:
    """Looks at manifests, whoever writes them: this process, others, or other machines.

    Parameters
    ----------
    job : Job
    parts : list of Part
    tell : callable or None
        Is called with a `Told`.
    """

    def __init__(self, job: Job, parts: list[Part], tell: Tell | None) -> None:
        self._job, self._tell, self._begun = job, tell, time.monotonic()
        self._open = {part.key: part for part in parts}
        self._total = max(sum(part.size for part in parts), 1)
        self._count, self._done_bytes = len(parts), 0

    def ended(self, part: Part) -> None:
        """A log is done with."""
        if self._open.pop(part.key, None) is not None:
            self._done_bytes += part.size
        self.look()

    def look(self) -> None:
        """Tell how far it is."""
        if self._tell is None:
            return
        done = self._done_bytes
        for part in [*self._open.values()]:
            found = load_manifest(self._job, part) or {}
            got = found.get("summary", {}).get("read_bytes") or 0
            done += min(int(got), part.size)
        passed_s = max(time.monotonic() - self._begun, 1e-6)
        left_s = passed_s * (self._total - done) / done if done else float("inf")
        self._tell(Told(self._count - len(self._open), self._count, done / self._total,
                        done / passed_s, left_s))  # fmt: skip

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Look now and then while the block runs."""
        if self._tell is None:
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
