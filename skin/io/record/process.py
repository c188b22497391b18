"""The process that writes a recording: ``python -m skin.io.record.process``, started by `Recorder`.

The backlog of the ring is written even where the loop's process was killed. The file is flushed
every `FLUSH_S`, so that it loses less than a second if this process is killed as well.
"""

from __future__ import annotations

import base64
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from skin.errors import SkinError
from skin.io.messages.encode import frames_message
from skin.io.messages.of_skin import SkinMessages
from skin.io.messages.topics import FORCES, FRAMES, LAYOUT, POINTS, POSES, SCENE, TF
from skin.io.record.container import Container
from skin.io.record.slot import Event
from skin.worker import Service, WorkerEnd, run

__all__ = ["Recording", "SlotsToMessages", "attach", "main"]

FLUSH_S = 0.4
AT_ONCE = 64
"""Slots that are freed together."""
SCENE_NS = 50_000_000
"""Interval of points and scenes, and of frames of patches."""
MEDIA = {".toml": "application/toml", ".json": "application/json", ".npz": "application/x-npz"}


def attach(file: Container, name: str, data: bytes, stamp_ns: int | None = None) -> None:
    """Attach a file to a recording."""
    media = MEDIA.get(Path(name).suffix, "application/octet-stream")
    file.attach(name, data, media, stamp_ns)


class SlotsToMessages:
    """Writes slots of the ring as messages.

    Parameters
    ----------
    file : Container
    request : dict
        As of `skin.io.messages.record.described`.
    counters : ndarray, shape (15,), int64, optional
        Counts before the first slot, which diagnostics subtract.
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
        """Write the layout of the skin, at the time of the first frame."""
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
            self._add(POINTS, self._layout.points(slot))
            self._add(FORCES, self._layout.forces(slot))
            self._add(SCENE, self._layout.scene(slot))
            self._add(TF, self._layout.transforms(stamp_ns))

    def _add(self, topic: str, data: bytes) -> None:
        self._file.add(topic, self._stamp_ns, data)


class Recording(Service):
    """Writes slots to a file, and answers commands.

    Parameters
    ----------
    file : Container
    written : SlotsToMessages
    """

    batch = AT_ONCE

    def __init__(self, file: Container, written: SlotsToMessages) -> None:
        self._file, self._written = file, written
        self._flushed = time.monotonic()
        self.commands = {"open": dict, "report": self._report, "finish": self._finish}

    def take(self, records: np.ndarray) -> None:
        """Write slots."""
        for slot in records:
            self._written.write(slot)

    def look(self) -> None:
        """Flush the file when it is due."""
        if time.monotonic() - self._flushed >= FLUSH_S:
            self._file.flush()
            self._flushed = time.monotonic()

    def stop(self) -> None:
        """End the file."""
        self._file.finish()

    def _report(self) -> dict[str, Any]:
        self._file.flush()
        return self._facts()

    def _finish(self) -> dict[str, Any]:
        self._file.finish()
        self.is_done = True
        return self._facts()

    def _facts(self) -> dict[str, Any]:
        file, written = self._file, self._written
        return {"cycles": written.cycles, "frames": written.frames, "bytes": file.size,
                "messages": file.count, "cpu_s": time.process_time()}  # fmt: skip


def begin(end: WorkerEnd) -> Recording:
    """Create the requested file."""
    request, path = end.request, Path(end.request["file"])
    try:
        file = Container(path, "f3t-skin")
        for name, data in request["attached"].items():
            attach(file, name, base64.b64decode(data))
        file.flush()
    except OSError as error:
        if not isinstance(error, FileExistsError):
            path.unlink(missing_ok=True)  # no empty recording is left behind
        raise SkinError(f"{path}: {error.strerror}") from error
    return Recording(file, SlotsToMessages(file, request))


def main() -> None:
    """Run the process until the loop ends; the exit status is the errno of the disk."""
    try:
        run(begin)
    except OSError as error:
        sys.exit(error.errno)


if __name__ == "__main__":
    main()
