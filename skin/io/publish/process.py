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
from skin.worker import Service, run

__all__ = ["Publishing"]

WAKES_S = 0.002
"""Poll interval of the ring [assumed: a fifth of the period at 100 Hz]."""
SETTLES_S = 0.5
"""Timeout of readers for the last messages [assumed]."""


class Publishing(Service):
    """Publishes records until the loop ends.

    Parameters
    ----------
    request : dict
        Of `skin.io.publish.ros`.
    """

    rest_s = WAKES_S

    def __init__(self, request: dict[str, Any]) -> None:
        self._prefix = request["prefix"]
        self._messages = SkinMessages(
            request, "publishing", name=request["name"], frame=request["frame"]
        )
        self.participant = Participant(request["domain"], request["local"])
        self._writers: dict[str, Writer] = {}
        for topic in (STATE, WRENCH, POINTS, FORCES, DIAGNOSTICS, POSES):
            self._writer(topic)
        self._write(self._messages.layout(time.time_ns()))
        self._count = 0
        self.commands = {"sent": self._sent}

    def _writer(self, topic: str) -> Writer:
        """The writer of a topic of `skin.io.messages.definitions`, made when it is first used."""
        if topic not in self._writers:
            name = topic[1:].replace("skin", self._prefix, 1)
            latched = topic in (LAYOUT, POSES, TF)
            self._writers[topic] = self.participant.writer(name, type_of(topic), latched=latched)
        return self._writers[topic]

    def _write(self, messages: Iterable[tuple[str, bytes]]) -> None:
        for topic, data in messages:
            self._writer(topic).write(data)

    def take(self, records: np.ndarray) -> None:
        """Publish records."""
        for record in records:
            self._write(self._messages.moves(record, int(record["stamp_ns"])))
            self._write(self._messages.of_state(record))
            self._count += 1

    def stop(self) -> None:
        """Wait until readers have received all messages."""
        for writer in self._writers.values():
            writer.wait_for_readers(SETTLES_S)

    def _sent(self) -> dict[str, Any]:
        return {"sent": self._count}


if __name__ == "__main__":
    run(lambda end: Publishing(end.request))
