"""The process that publishes: records of the loop to topics. Run by `skin.publish.ros`."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from skin.errors import SkinError
from skin.publish import content
from skin.publish.dds import Participant, Writer
from skin.publish.names import topic
from skin.publish.snapshot import contacts_of
from skin.worker import WorkerEnd

__all__ = ["Topics", "main"]

WAKES_S = 0.002
"""Between two looks at the ring [assumed: a fifth of the period at 100 Hz]."""
SILENT_S = 2.0
"""Without a record after which the skin is told to be stale [assumed]."""
SETTLES_S = 0.5
"""That readers have for what was sent last [assumed]."""

STATE, WRENCH = "f3t_msgs/msg/SkinState", "geometry_msgs/msg/WrenchStamped"
LAYOUT, TF = "f3t_msgs/msg/SkinLayout", "tf2_msgs/msg/TFMessage"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"


class Topics:
    """The topics of a skin.

    Parameters
    ----------
    request : dict
        What `skin.publish.ros` asks for.
    """

    def __init__(self, request: dict[str, Any]) -> None:
        self._request, self._frame = request, request["frame"]
        self._participant = Participant(request["domain"], request["local"])
        self._state = self._writer("state", STATE)
        self._wrench = self._writer("wrench", WRENCH)
        self._layout = self._writer("layout", LAYOUT, latched=True)
        self._diagnostics = self._writer("/diagnostics", DIAGNOSTICS, reliable=True)
        moves = request["moving"]
        self._tf = self._writer("/tf" if moves else "/tf_static", TF, latched=not moves,
                                reliable=True)  # fmt: skip
        self._contacts: dict[int, Writer] = {}
        self._slots, self._noted = content.Slots(), None
        now_ns = time.time_ns()
        self._layout.write(content.layout(now_ns, self._frame, request))
        self._send_poses(now_ns, np.array(request["poses"]))

    def _writer(
        self, name: str, message: str, latched: bool = False, reliable: bool | None = None
    ) -> Writer:
        how = self._request["reliable"] or latched if reliable is None else reliable
        full = topic(self._request["prefix"], name)
        return self._participant.writer(full, message, latched=latched, reliable=how)

    def _send_poses(self, stamp_ns: int, poses: np.ndarray) -> None:
        children = self._request["patch_frames"]
        self._tf.write(content.transforms(stamp_ns, self._frame, children, poses))

    def send(self, record: np.void) -> None:
        """Publish a record."""
        stamp_ns = int(record["stamp_ns"])
        self._state.write(content.state(record, self._frame))
        if not np.isnan(record["wrench"][0]):
            self._wrench.write(content.wrench(stamp_ns, self._frame, record["wrench"]))
        present, ended = self._slots.take(contacts_of(record))
        for slot, contact in present:
            self._contact(slot).write(content.wrench(stamp_ns, self._frame, contact["wrench"]))
        for slot in ended:  # else who reads takes the last load for one that lasts
            self._contact(slot).write(content.wrench(stamp_ns, self._frame, np.zeros(6)))
        if record["has_pose"]:
            self._send_poses(stamp_ns, record["pose"])
        if record["is_noted"]:
            self._diagnostics.write(content.diagnostics(record, self._noted, self._request))
            self._noted = record.copy()

    def tell_silence(self, seconds: float) -> None:
        """Say that the skin has no cycles."""
        self._diagnostics.write(content.silence(time.time_ns(), seconds, self._request))

    def _contact(self, slot: int) -> Writer:
        if slot not in self._contacts:
            self._contacts[slot] = self._writer(f"contact/{slot}", WRENCH)
        return self._contacts[slot]

    def wait_for_readers(self) -> None:
        """Wait until readers have what was sent."""
        for writer in (self._state, self._wrench, self._diagnostics, *self._contacts.values()):
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
