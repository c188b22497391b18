"""The process that publishes: records of the loop to topics. Run by `skin.publish.ros`."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from skin.errors import SkinError
from skin.messages.of_skin import SkinMessages
from skin.messages.topics import (
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
from skin.publish.dds import Participant, Writer
from skin.publish.names import topic
from skin.worker import WorkerEnd

__all__ = ["Topics", "main"]

WAKES_S = 0.002
"""Between two looks at the ring [assumed: a fifth of the period at 100 Hz]."""
SILENT_S = 2.0
"""Without a record after which the skin is told to be stale [assumed]."""
SETTLES_S = 0.5
"""That readers have for what was sent last [assumed]."""


class Topics:
    """The topics of a skin.

    Parameters
    ----------
    request : dict
        What `skin.publish.ros` asks for.
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

    def tell_silence(self, seconds: float) -> None:
        """Say that the skin has no cycles."""
        self._write(DIAGNOSTICS, self._messages.diagnostics.silence(time.time_ns(), seconds))

    def wait_for_readers(self) -> None:
        """Wait until readers have what was sent."""
        for writer in self._writers.values():
            writer.wait_for_readers(SETTLES_S)


def main() -> None:
    """Publish records until the loop ends."""
    end = WorkerEnd()
    try:
        topics = Topics(end.request)
    except SkinError as error:
        end.command(None)
        end.answer(error=str(error))
        return
    heard = told = time.monotonic()
    sent = 0
    while True:
        ended, command = end.ended, end.command(WAKES_S)
        # what was handed over before the command, or the end, is published before it
        while (records := end.ring.unread()).size:
            topics.send(records[0])
            end.ring.release(1)
            sent += 1
            heard = told = time.monotonic()
        if command is not None:
            end.answer(sent=sent)
        elif ended:
            break
        now = time.monotonic()
        if now - told > SILENT_S:
            topics.tell_silence(now - heard)
            told = now
    topics.wait_for_readers()


if __name__ == "__main__":
    main()
