"""The process of a view: ``python -m skin.view.process``, started by `skin.view.browser`."""

from __future__ import annotations

import logging
import os
import sys
import time
import warnings
from typing import Any

import numpy as np

from skin.view.drawing import Pose
from skin.view.panel import Panel
from skin.view.scene import Scales, Scene
from skin.view.server import address_of, open_server
from skin.view.snapshot import RATE_HZ
from skin.worker import Service, WorkerEnd, run
from topology.packed import unpacked

LOOK_S = 0.85 / RATE_HZ
"""Interval of polling for snapshots, requests and commands [assumed]: rarely two snapshots are
waiting, of which one would be skipped, and rarely none, since polling costs a tenth of a
picture."""
WORDS_S = 0.2
"""Interval of updates of all text: more often is not readable [assumed]."""


class Viewer(Service):
    """Draws the snapshots of the ring, and handles requests of browsers."""

    reads_to_end = False

    def __init__(self, end: WorkerEnd) -> None:
        asked = end.request
        self._topology = topology = unpacked(asked["topology"])
        self._server = open_server(asked["host"], asked["port"], topology.name)
        self.address = address_of(asked["host"], self._server.get_port())
        self._panel = Panel(self._server, topology, asked["is_live"])
        self._asked = np.memmap(asked["asked"], float, "r+")
        self._scales = Scales()
        self._scene: Scene | None = None
        self._pose, self._moved = Pose(np.zeros((3, 0)), np.zeros((3, 3, 0))), -1
        self._newest: Any = None
        self._words_due_s, self._due_s = 0.0, time.monotonic()
        self._is_new = False
        self.commands = {
            "address": lambda: {"address": self.address},
            "zeros": self._panel.report_tare,
        }
        # callbacks run in threads of the server: requests wait for `look`
        self._server.on_client_connect(lambda client: self._panel.requests.put(("draw", client)))

    def take(self, records: np.ndarray) -> None:
        """Store the snapshots of the ring."""
        for record in records:
            if record["moved"] != self._moved:
                self._moved = int(record["moved"])
                pose = record["pose"].astype(np.float32)
                self._pose = Pose(pose[:3], pose[3:].reshape(3, 3, -1), record["q"].copy())
                self._panel.follow(self._pose.q)
            self._panel.add(record, time.monotonic())
        self._newest, self._is_new = records[-1].copy(), True
        if self._scene is None:
            requests = self._panel.requests
            self._scene = Scene(
                self._server, self._topology, self._pose, lambda unit: requests.put(("unit", unit))
            )

    def look(self) -> None:
        """Handle requests of browsers, and draw new snapshots while a browser is connected."""
        is_new, self._is_new = self._is_new, False
        is_asked = self._handle_requests()
        if self._scene is not None and self._server.get_clients():
            self._refresh(self._scene, is_new, is_asked, time.monotonic())
        self._due_s = max(self._due_s + LOOK_S, time.monotonic())

    def rests_s(self, waiting: int) -> float:
        """Time until the next poll is due, for any backlog."""
        return max(0.0, self._due_s - time.monotonic())

    def stop(self) -> None:
        """Stop serving."""
        self._server.stop()

    def _refresh(self, scene: Scene, is_new: bool, is_asked: bool, now_s: float) -> None:
        """Draw a new or requested picture, and text that is due."""
        panel, scales = self._panel, self._scales
        has_words = is_asked or now_s >= self._words_due_s
        if not (is_new or has_words):
            return
        with self._server.atomic():
            scales.widen(self._newest, panel.quantity)
            scene.draw(self._newest, self._pose, scales, panel.quantity, panel.unit,
                       words=has_words)  # fmt: skip
            if has_words:
                self._words_due_s = now_s + WORDS_S
                faults = () if scene.links is None else scene.links.problems
                panel.refresh(self._newest, self._pose, now_s, scales, faults)
        self._server.flush()  # now, without waiting for the server's own clock

    def _handle_requests(self) -> bool:
        """Handle requests of browsers; True where that changes the picture."""
        panel = self._panel
        is_changed = not panel.requests.empty()
        while not panel.requests.empty():
            request, of = panel.requests.get()
            if request == "close":
                panel.choose(None)
            elif request == "unit":
                panel.choose(of)
            elif request == "fit":
                self._scales.reset()
            elif request == "top" and self._scene is not None:
                self._scene.look_from_top(of.camera)
            elif request == "joints":
                self._asked[2:] = of
                self._asked[1] += 1
            elif request == "tare":
                self._asked[0] += 1
                panel.report_tare("requested: touch nothing for two seconds")
        return is_changed


def view(end: WorkerEnd) -> Viewer:
    """Serve the requested view."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # viser greets
    warnings.filterwarnings("ignore", category=UserWarning, module="viser")  # about unusual values
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # clients that are no browsers
    return Viewer(end)


if __name__ == "__main__":
    run(view)
