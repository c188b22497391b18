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
from skin.view.health import Health
from skin.view.layout import layout_of
from skin.view.panel import Panel
from skin.view.scene import Scales, Scene
from skin.view.server import address_of, open_server
from skin.view.snapshot import RATE_HZ
from skin.worker import Service, WorkerEnd, run

LOOK_S = 0.85 / RATE_HZ
"""Interval of polling for snapshots, requests and commands [assumed]: rarely two snapshots are
waiting, of which one would be skipped, and rarely none, since polling costs a tenth of a
picture."""
WORDS_S = 0.1
"""Interval of updates of the labels of contacts: more often is not readable [assumed]."""


class Viewer(Service):
    """Draws the snapshots of the ring, and handles requests of browsers."""

    batch = 64
    reads_to_end = False

    def __init__(self, end: WorkerEnd) -> None:
        self._end, asked = end, end.request
        self._layout = layout = layout_of(asked["layout"])
        self._server = open_server(asked["host"], asked["port"], layout.title, checks_origin=True)
        self.address = address_of(asked["host"], self._server.get_port())
        health = Health(layout.names, asked["rate_hz"], layout.patch, layout.patch_names)
        self._panel = Panel(self._server, layout, health, asked["is_live"])
        self._scales = Scales()
        self._scene: Scene | None = None
        self._pose, self._moved = Pose(np.zeros((3, 0)), np.zeros((3, 3, 0))), -1
        self._newest: Any = np.zeros(1, end.ring.dtype)[0]
        self._words_due_s, self._due_s = 0.0, time.monotonic()
        self._is_new = self._owes_words = False
        self.commands = {
            "address": lambda: {"address": self.address},
            "zeros": self._panel.report_tare,
        }
        self._connect()

    def _connect(self) -> None:
        """Leave requests for `look`: callbacks run in threads of the server, and a new client
        starts from the camera of the last one."""
        server, requests = self._server, self._panel.requests
        server.scene.on_click()(
            lambda event: requests.put(("point", (event.ray_origin, event.ray_direction)))
        )
        server.on_client_connect(lambda client: requests.put(("draw", client)))

        @server.on_client_disconnect
        def left(client: Any) -> None:
            camera = client.camera
            requests.put(("left", (camera.position, camera.look_at, camera.up_direction)))

    def take(self, records: np.ndarray) -> None:
        """Store the snapshots of the ring."""
        for record in records:
            if record["moved"] != self._moved:
                self._moved = int(record["moved"])
                pose = record["pose"].astype(np.float32)
                self._pose = Pose(pose[:3], pose[3:].reshape(3, 3, -1), record["q"].copy())
            self._panel.add(record, time.monotonic())
        self._newest, self._is_new = records[-1].copy(), True
        if self._scene is None:
            self._scene = Scene(self._server, self._layout, self._pose)

    def look(self) -> None:
        """Handle requests of browsers, and draw new snapshots while a browser is connected."""
        is_new, self._is_new = self._is_new, False
        is_asked = self._handle_requests()
        if self._server.get_clients():
            self._refresh(is_new, is_asked, time.monotonic())
        self._due_s = max(self._due_s + LOOK_S, time.monotonic())

    def rests_s(self, waiting: int) -> float:
        """Time until the next poll is due, for any backlog."""
        return max(0.0, self._due_s - time.monotonic())

    def stop(self) -> None:
        """Stop serving."""
        self._server.stop()

    def _refresh(self, is_new: bool, is_asked: bool, now_s: float) -> None:
        """Draw a new or requested picture; update labels that are due in any case."""
        has_words = is_asked or (now_s >= self._words_due_s and (is_new or self._owes_words))
        if self._scene is None:
            return
        if is_new or has_words:
            self._owes_words = not has_words
            if has_words:
                self._words_due_s = now_s + WORDS_S
            self._draw(self._scene, has_words)
        self._panel.refresh(self._newest, now_s)

    def _handle_requests(self) -> bool:
        """Handle requests of browsers; True where that changes the picture."""
        panel, is_changed = self._panel, False
        while not panel.requests.empty():
            request, of = panel.requests.get()
            is_changed = is_changed or request != "left"
            if request == "left":
                first = self._server.initial_camera
                first.position, first.look_at, first.up = of
            elif request == "close":
                panel.choose(None)
            elif request == "point" and self._scene is not None:
                panel.choose(self._scene.pick(*of))
            elif request == "camera" and self._scene is not None:
                if of.client_id in self._server.get_clients():  # it may have left meanwhile
                    self._scene.reset_camera(of.camera)
            elif request == "fit":
                self._scales.reset()
            elif request == "tare":
                self._end.ring.call()
                panel.report_tare("requested: touch nothing for two seconds")
        return is_changed

    def _draw(self, scene: Scene, has_words: bool) -> None:
        panel, newest, shown = self._panel, self._newest, self._panel.shown
        with self._server.atomic():
            self._scales.widen(newest, shown.quantity)
            scene.draw(newest, self._pose, shown, self._scales, words=has_words)
            if has_words:
                panel.describe(newest)
        panel.scales(self._scales)
        self._server.flush()  # now, without waiting for the server's own clock


def view(end: WorkerEnd) -> Viewer:
    """Serve the requested view."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # viser greets
    warnings.filterwarnings("ignore", category=UserWarning, module="viser")  # about unusual values
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # clients that are no browsers
    return Viewer(end)


if __name__ == "__main__":
    run(view)
