"""The process that writes a recording: ``python -m skin.record.process``, started by `Recorder`.

What waits in the ring is written also where the loop's process was killed. Every `FLUSH_S` the file
is whole up to there, so that it lacks less than a second if this process is killed as well.
"""

from __future__ import annotations

import base64
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from skin.messages.encode import frames_message
from skin.messages.of_skin import SkinMessages
from skin.messages.topics import FRAMES, LAYOUT, POSES, SCENE, TF
from skin.record.container import Container
from skin.record.slot import Event
from skin.worker import WorkerEnd

__all__ = ["SlotsToMessages", "attach", "main"]

FLUSH_S = 0.4
POLL_S = 0.02
AT_ONCE = 64
"""Slots that are given back together."""
SCENE_NS = 50_000_000
"""Time of the state between two scenes, and frames of patches."""
MEDIA = {".toml": "application/toml", ".json": "application/json", ".npz": "application/x-npz"}


def attach(file: Container, name: str, data: bytes, stamp_ns: int | None = None) -> None:
    """Put a file into a recording."""
    media = MEDIA.get(Path(name).suffix, "application/octet-stream")
    file.attach(name, data, media, stamp_ns)


class SlotsToMessages:
    """Writes slots of the ring as messages.

    Parameters
    ----------
    file : Container
    request : dict
        As of `skin.messages.record.described`.
    counters : ndarray, shape (15,), int64, optional
        Frames before the first slot, which diagnostics do not count.
    """

    def __init__(
        self, file: Container, request: dict[str, Any], counters: np.ndarray | None = None
    ) -> None:
        self._file = file
        self._messages = SkinMessages(request, "recording", counters=counters)
        self._layout = self._messages.layout
        self._stamp_ns = 0
        self._scene_ns = -(1 << 62)
        self.cycles = self.frames = 0
        self._begun = False

    def write(self, slot: np.ndarray) -> None:
        """Write one slot."""
        count = int(slot["event_count"])
        done = 0
        has_state = bool(slot["has_state"])
        if has_state:
            self._stamp_ns = max(0, int(slot["stamp_ns"]))
        for event, value in zip(
            slot["events"][:count].tolist(), slot["event_values"][:count].tolist(), strict=True
        ):
            if event == Event.MOVED:
                self._move(slot)
            elif event in (Event.FED, Event.FED_PART):
                frames = slot["frames"][done : done + value]
                self._frames(slot, event, 0, frames)
                done += value
            else:
                self._frames(slot, event, value, slot["frames"][:0])
        if has_state:
            self._show(slot)

    def _frames(self, slot: np.ndarray, event: int, elapsed_ns: int, frames: np.ndarray) -> None:
        if frames.size and not self._stamp_ns:  # no state yet
            self._stamp_ns = max(0, int(frames[0, 0]))
        self._begin()
        part = event == Event.FED_PART
        values = {
            "event": Event.FED if part else event, "more": part, "elapsed_ns": elapsed_ns,
            "lost_cycles": slot["lost_cycles"], "lost_frames": slot["lost_frames"],
        }  # fmt: skip
        self._add(FRAMES, frames_message(values, self._stamp_ns, frames))
        self.frames += len(frames)

    def _begin(self) -> None:
        """What hangs where stands first, at the time of the first frame."""
        if not self._begun:
            self._begun = True
            self._add(LAYOUT, self._layout.message(self._stamp_ns))
            self._add(TF, self._layout.transforms(self._stamp_ns))

    def _move(self, slot: np.ndarray) -> None:
        self._begin()
        self._layout.move(slot["pose"])
        self._add(POSES, self._layout.poses(self._stamp_ns))

    def _show(self, slot: np.ndarray) -> None:
        stamp_ns = self._stamp_ns
        self._begin()
        for topic, data in self._messages.of_state(slot):
            self._add(topic, data)
        self.cycles += 1
        if abs(stamp_ns - self._scene_ns) >= SCENE_NS:
            self._scene_ns = stamp_ns
            self._add(SCENE, self._layout.scene(slot))
            self._add(TF, self._layout.transforms(stamp_ns))

    def _add(self, topic: str, data: bytes) -> None:
        self._file.add(topic, self._stamp_ns, data)


def main() -> None:
    """Write what comes, until the loop ends."""
    end = WorkerEnd()
    request, path = end.request, Path(end.request["file"])
    try:
        file = Container(path, "f3t-skin")
        for name, data in request["attached"].items():
            attach(file, name, base64.b64decode(data))
        file.flush()
    except OSError as error:
        if not isinstance(error, FileExistsError):
            path.unlink(missing_ok=True)  # a recording that has not begun is none
        end.command(None)
        end.answer(error=f"{path}: {error.strerror}")
        sys.exit(error.errno)
    try:
        _serve(end, file, SlotsToMessages(file, request))
    except OSError as error:
        sys.exit(error.errno)


def _serve(end: WorkerEnd, file: Container, written: SlotsToMessages) -> None:
    """Write slots and answer, until the loop has ended and nothing waits."""

    def told() -> dict[str, Any]:
        return {"cycles": written.cycles, "frames": written.frames, "bytes": file.size,
                "messages": file.count, "cpu_s": time.process_time()}  # fmt: skip

    flushed = time.monotonic()
    while True:
        ended = end.ended
        _drain(end, written)
        while ended and end.ring.waiting:
            _drain(end, written)
        if time.monotonic() - flushed >= FLUSH_S:
            file.flush()
            flushed = time.monotonic()
        command = end.command(POLL_S)
        if command is None:
            if ended:
                file.finish()
                return
        elif command["command"] == "open":
            end.answer()
        elif command["command"] == "report":
            _drain(end, written)
            file.flush()
            end.answer(**told())
        elif command["command"] == "finish":
            while end.ring.waiting:
                _drain(end, written)
            file.finish()
            end.answer(**told())
            return
        else:
            end.answer(error=f"command: must be 'open', 'report' or 'finish'; got {command}")


def _drain(end: WorkerEnd, written: SlotsToMessages) -> None:
    """Write what waits, but not for ever where more comes than can be written."""
    for _ in range(end.ring.waiting // AT_ONCE + 2):
        slots = end.ring.unread()[:AT_ONCE]
        for slot in slots:
            written.write(slot)
        end.ring.release(slots.size)


if __name__ == "__main__":
    main()
