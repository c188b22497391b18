"""The process that writes a recording: ``python -m skin.io.record.process``, started by `Recorder`.

The backlog of the ring is written even where the loop's process was killed. The file is flushed
every `FLUSH_S`, so that it loses less than a second if this process is killed as well.
"""

from __future__ import annotations

import base64
import os
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from bus.frame import FRAME_DTYPE
from skin.errors import SkinError
from skin.io.messages.definitions import FRAMES, encode, header, make
from skin.io.messages.of_skin import SkinMessages
from skin.io.record.container import Container
from skin.worker import Service, WorkerEnd, run

__all__ = ["Recording", "main"]

FLUSH_S = 0.4


class Recording(Service):
    """Writes slots of the ring to a file as messages, and answers commands.

    Parameters
    ----------
    file : Container
    request : dict
        As of `skin.io.messages.record.described`.
    """

    def __init__(self, file: Container, request: dict[str, Any]) -> None:
        self._file, self._messages = file, SkinMessages(request, "recording")
        self._stamp_ns, self._lost = 0, (0, 0)
        self._cycles = self._frames = 0
        self._begun = False
        self._flushed = time.monotonic()
        self.commands = {"open": dict, "report": self._report, "finish": self._finish}

    def take(self, records: np.ndarray) -> None:
        """Write slots."""
        for slot in records:
            self._write(slot)

    def _write(self, slot: np.ndarray) -> None:
        frames = slot["frames"][: int(slot["frame_count"])]
        if slot["has_state"]:
            self._stamp_ns = max(0, int(slot["stamp_ns"]))
            self._lost = int(slot["lost_cycles"]), int(slot["lost_frames"])
        elif not self._stamp_ns and len(frames):
            self._stamp_ns = max(0, int(frames[0].view(FRAME_DTYPE)["stamp_ns"][0]))
        if not self._begun:
            self._begun = True
            self._add(self._messages.layout(self._stamp_ns))
        if slot["event_count"]:
            self._add([(FRAMES, self._inputs(slot, frames))])
            self._frames += len(frames)
        self._add(self._messages.moves(slot, self._stamp_ns))
        if slot["has_state"]:
            self._add(self._messages.of_state(slot))
            self._cycles += 1

    def _inputs(self, slot: np.ndarray, frames: np.ndarray) -> bytes:
        """The events of a slot and their frames, as ``f3t_msgs/msg/CanFrames``."""
        events = slot["events"][: int(slot["event_count"])]
        return encode(FRAMES, make(
            "f3t_msgs/msg/CanFrames", header(self._stamp_ns, "skin"), *self._lost,
            events[:, 0].astype(np.uint8), events[:, 1].copy(), frames.reshape(-1),
        ))  # fmt: skip

    def _add(self, messages: Iterable[tuple[str, bytes]]) -> None:
        for topic, data in messages:
            self._file.add(topic, self._stamp_ns, data)

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
        return {"cycles": self._cycles, "frames": self._frames, "bytes": self._file.size,
                "messages": self._file.count, "cpu_s": time.process_time()}  # fmt: skip


def begin(end: WorkerEnd) -> Recording:
    """Create the requested file."""
    request, path = end.request, Path(end.request["file"])
    try:
        file = Container(path)
        for name, data in request["attached"].items():
            file.attach(name, base64.b64decode(data))
        file.flush()
    except OSError as error:
        if not isinstance(error, FileExistsError):
            path.unlink(missing_ok=True)  # no empty recording is left behind
        raise SkinError(f"{path}: {error.strerror}") from error
    return Recording(file, request)


def main() -> None:
    """Run the process until the loop ends; the exit status is the errno of the disk."""
    try:
        run(begin)
    except OSError as error:
        os._exit(error.errno or 1)  # at an ordinary end the file would be written to once more


if __name__ == "__main__":
    main()
