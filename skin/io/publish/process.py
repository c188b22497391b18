"""The process that publishes records of the loop as topics. Run by `skin.io.publish.ros`."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from skin.io.messages.definitions import (
    DIAGNOSTICS,
    FORCES,
    LAYOUT,
    POINTS,
    POSES,
    STATE,
    TF,
    WRENCH,
    type_of,
)
from skin.io.messages.of_skin import SkinMessages
from skin.io.publish.dds import Participant, Writer
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
        self._request, self._moves = request, request["moves"]
        self._messages = SkinMessages(
            request, "publishing", name=request["name"], frame=request["frame"]
        )
        self._participant = Participant(request["domain"], request["local"])
        self._writers: dict[str, Writer] = {}
        for topic in (STATE, WRENCH, POINTS, FORCES, DIAGNOSTICS, POSES):
            self._writer(topic)
        self._write(self._messages.layout(time.time_ns()))

    def _writer(self, topic: str) -> Writer:
        """The writer of a topic of `skin.io.messages.definitions`, under the name that it has."""
        if topic not in self._writers:
            name = topic[1:].replace("skin", self._request["prefix"], 1)
            if topic == TF and not self._moves:
                name = "tf_static"
            latched = topic in (LAYOUT, POSES) or name == "tf_static"
            self._writers[topic] = self._participant.writer(name, type_of(topic), latched=latched)
        return self._writers[topic]

    def _write(self, messages: Iterable[tuple[str, bytes]]) -> None:
        for topic, data in messages:
            self._writer(topic).write(data)

    def send(self, record: np.ndarray) -> None:
        """Publish a record."""
        stamp_ns, messages = int(record["stamp_ns"]), self._messages
        moves = [*messages.moves(record, stamp_ns)]
        self._write(moves)
        if moves and not self._moves:
            self._write([(TF, messages.transforms(stamp_ns))])
        self._write(one for one in messages.of_state(record) if one[0] != TF or self._moves)

    def report_silence(self, seconds: float) -> None:
        """Report that the skin has no cycles."""
        told = self._messages.diagnostics.silence(time.time_ns(), seconds)
        self._write([(DIAGNOSTICS, told)])

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
