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
SILENT_S = 2.0
"""Silence after which the skin is reported as stale [assumed]."""
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
        self._prefix, self._has_joints = request["prefix"], request["has_joints"]
        self._messages = SkinMessages(
            request, "publishing", name=request["name"], frame=request["frame"]
        )
        self.participant = Participant(request["domain"], request["local"])
        self._writers: dict[str, Writer] = {}
        for topic in (STATE, WRENCH, POINTS, FORCES, DIAGNOSTICS, POSES):
            self._writer(topic)
        self._write(self._messages.layout(time.time_ns()))
        self._heard = self._said = time.monotonic()
        self._count = 0
        self.commands = {"sent": self._sent}

    def _writer(self, topic: str) -> Writer:
        """The writer of a topic of `skin.io.messages.definitions`, made when it is first used."""
        if topic not in self._writers:
            name = topic[1:].replace("skin", self._prefix, 1)
            if topic == TF and not self._has_joints:
                name = "tf_static"
            latched = topic in (LAYOUT, POSES) or name == "tf_static"
            self._writers[topic] = self.participant.writer(name, type_of(topic), latched=latched)
        return self._writers[topic]

    def _write(self, messages: Iterable[tuple[str, bytes]]) -> None:
        for topic, data in messages:
            self._writer(topic).write(data)

    def take(self, records: np.ndarray) -> None:
        """Publish a record."""
        record, messages = records[0], self._messages
        stamp_ns = int(record["stamp_ns"])
        moves = [*messages.moves(record, stamp_ns)]
        self._write(moves)
        if moves and not self._has_joints:
            self._write([(TF, messages.transforms(stamp_ns))])
        self._write(one for one in messages.of_state(record) if one[0] != TF or self._has_joints)
        self._count += 1
        self._heard = self._said = time.monotonic()

    def look(self) -> None:
        """Report a silent skin."""
        now = time.monotonic()
        if now - self._said > SILENT_S:
            silence = self._messages.diagnostics.silence(time.time_ns(), now - self._heard)
            self._write([(DIAGNOSTICS, silence)])
            self._said = now

    def stop(self) -> None:
        """Wait until readers have received all messages."""
        for writer in self._writers.values():
            writer.wait_for_readers(SETTLES_S)

    def _sent(self) -> dict[str, Any]:
        return {"sent": self._count}


if __name__ == "__main__":
    run(lambda end: Publishing(end.request))
