"""The process that publishes records of the loop as topics. Run by `skin.io.publish.ros`."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from skin.io.messages.of_skin import SkinMessages
from skin.io.messages.topics import (
    CONTACT,
    DIAGNOSTICS,
    LAYOUT,
    POSES,
    SKIN,
    STATE,
    TF,
    WRENCH,
    type_of,
)
from skin.io.publish.dds import Participant, Writer
from skin.io.publish.names import topic
from skin.worker import Service, WorkerEnd, run

__all__ = ["Publishing", "Topics"]

WAKES_S = 0.002
"""Poll interval of the ring [assumed: a fifth of the period at 100 Hz]."""
SILENT_S = 2.0
"""Silence after which the skin is reported as stale [assumed]."""
SETTLES_S = 0.5
"""Timeout of readers for the last messages [assumed]."""


class Topics:
    """The topics of a skin.

    Parameters
    ----------
    request : dict
        The request of `skin.io.publish.ros`.
    """

    def __init__(self, request: dict[str, Any]) -> None:
        self._request, self._moving = request, request["moving"]
        self._messages = SkinMessages(
            request, "publishing", name=request["name"], frame=request["frame"],
            patch_frames=request["patch_frames"],
        )  # fmt: skip
        self._participant = Participant(request["domain"], request["local"])
        best = self._request["reliable"]
        self._writers = {of: self._writer(of, reliable=best) for of in (STATE, WRENCH)}
        self._writers[DIAGNOSTICS] = self._writer(DIAGNOSTICS)
        for of in (LAYOUT, POSES):
            self._writers[of] = self._writer(of, latched=True)
        self._writers[TF] = self._writer(TF, latched=not self._moving)
        now_ns = time.time_ns()
        self._write(LAYOUT, self._messages.layout.message(now_ns))
        self._write(TF, self._messages.layout.transforms(now_ns))

    def _writer(self, of: str, latched: bool = False, reliable: bool = True) -> Writer:
        name = "/tf_static" if of == TF and latched else of.removeprefix(f"{SKIN}/")
        full = topic(self._request["prefix"], name)
        return self._participant.writer(full, type_of(of), latched=latched, reliable=reliable)

    def _write(self, of: str, data: bytes) -> None:
        if of not in self._writers:
            assert of.startswith(CONTACT)
            self._writers[of] = self._writer(of, reliable=self._request["reliable"])
        self._writers[of].write(data)

    def send(self, record: np.ndarray) -> None:
        """Publish a record."""
        stamp_ns, layout = int(record["stamp_ns"]), self._messages.layout
        if record["has_moved"]:
            layout.move(record["pose"])
            self._write(POSES, layout.poses(stamp_ns))
        for of, data in self._messages.of_state(record):
            self._write(of, data)
        if record["has_moved"] or self._moving:
            self._write(TF, layout.transforms(stamp_ns))

    def report_silence(self, seconds: float) -> None:
        """Report that the skin has no cycles."""
        self._write(DIAGNOSTICS, self._messages.diagnostics.silence(time.time_ns(), seconds))

    def wait_for_readers(self) -> None:
        """Wait until readers have received all messages."""
        for writer in self._writers.values():
            writer.wait_for_readers(SETTLES_S)


class Publishing(Service):
    """Publishes records until the loop ends."""

    rest_s = WAKES_S

    def __init__(self, end: WorkerEnd) -> None:
        self._topics = Topics(end.request)
        self._heard = self._said = time.monotonic()
        self._count = 0
        self.commands = {"sent": self._sent}

    def take(self, records: np.ndarray) -> None:
        """Publish a record."""
        self._topics.send(records[0])
        self._count += 1
        self._heard = self._said = time.monotonic()

    def look(self) -> None:
        """Report a silent skin."""
        now = time.monotonic()
        if now - self._said > SILENT_S:
            self._topics.report_silence(now - self._heard)
            self._said = now

    def stop(self) -> None:
        """Wait until readers have received all messages."""
        self._topics.wait_for_readers()

    def _sent(self) -> dict[str, Any]:
        return {"sent": self._count}


if __name__ == "__main__":
    run(Publishing)
