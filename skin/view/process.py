"""The process of a view: ``python -m skin.view.process``, started by `skin.view.browser`."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from skin.view.cameras import set_camera
from skin.view.client_errors import log_in_lines
from skin.view.export import EXPORTED_S, as_html
from skin.view.health import Health
from skin.view.history import History, Moment
from skin.view.kinds import PAGE
from skin.view.layout import layout_of
from skin.view.panel import MOMENT, STRETCH, Panel
from skin.view.scene import Scales, Scene
from skin.view.server import address_of, open_server
from skin.view.snapshot import RATE_HZ
from skin.worker import Service, WorkerEnd, run
from topology.files import whole_file

LOOK_S = 0.85 / RATE_HZ
"""Interval of polling for snapshots, requests and commands [assumed]: rarely two snapshots are
waiting, of which one would be skipped, and rarely none, since polling costs a tenth of a
picture."""
WORDS_S = 0.1
"""Interval of updates of the labels of contacts: more often is not readable [assumed]."""


class Viewer(Service):
    """Draws the snapshots of the ring, and executes requests of browsers."""

    batch = 64
    reads_to_end = False

    def __init__(self, end: WorkerEnd) -> None:
        self._end, asked = end, end.request
        self._layout = layout_of(asked["layout"])
        title = self._layout.title
        self._server = open_server(asked["host"], asked["port"], title, checks_origin=True)
        self.address = address_of(asked["host"], self._server.get_port())
        self._history = History(end.ring.dtype, asked["kept"])
        layout = self._layout
        self._health = Health(layout.names, asked["rate_hz"], layout.patch, layout.patch_names)
        span_s = asked["kept"] / RATE_HZ
        self._panel = Panel(self._server, layout, self._health, span_s, asked["is_live"])
        self._scales = Scales()
        self._scene: Scene | None = None
        self._newest: Any = np.zeros(1, end.ring.dtype)[0]
        self._owes_words, self._words_due_s = False, 0.0
        self._is_new, self._due_s = False, time.monotonic()
        self.commands = {
            "address": lambda: {"address": self.address},
            "zeros": self._panel.report_tare,
            "export": self._save,
        }
        self._connect()

    def _connect(self) -> None:
        """Start a new client from the camera of the last one. Values set by threads of the server
        are written only by `look`, which knows whether the server still runs."""
        server = self._server

        server.scene.on_click()(
            lambda event: self._panel.wishes.put(("point", (event.ray_origin, event.ray_direction)))
        )

        @server.on_client_connect
        def came(client: Any) -> None:
            self._panel.wishes.put(("draw", client))

        @server.on_client_disconnect
        def left(client: Any) -> None:
            camera = client.camera
            pose = camera.position, camera.look_at, camera.up_direction
            self._panel.wishes.put(("left", pose))

    def take(self, records: np.ndarray) -> None:
        """Store the snapshots of the ring."""
        for record in records:
            self._health.add(record)
            if not self._panel.paused or self._scene is None:
                self._history.add(record)
        self._newest = records[-1].copy()
        self._is_new = True
        self._panel.has_new(time.monotonic())
        if self._scene is None:
            self._scene = Scene(self._server, self._layout, self._history[-1])

    def look(self) -> None:
        """Execute requests of browsers, and draw new snapshots."""
        is_new, self._is_new = self._is_new, False
        is_asked = self._grant()
        if self._is_seen():
            self._refresh(is_new, is_asked, time.monotonic())
        self._due_s = max(self._due_s + LOOK_S, time.monotonic())

    def rests_s(self, waiting: int) -> float:
        """Time until the next poll is due, for any backlog."""
        return max(0.0, self._due_s - time.monotonic())

    def stop(self) -> None:
        """Stop serving."""
        self._server.stop()

    def _is_seen(self) -> bool:
        """Whether a browser is connected; a new one requests a picture."""
        return bool(self._server.get_clients())

    def _refresh(self, is_new: bool, is_asked: bool, now_s: float) -> None:
        """Draw a new or requested picture; update labels that are due in any case."""
        has_words = is_asked or (now_s >= self._words_due_s and (is_new or self._owes_words))
        if self._scene is not None and (is_new or has_words):
            self._owes_words = not has_words
            if has_words:
                self._words_due_s = now_s + WORDS_S
            self._draw(has_words)
        self._panel.refresh(self._newest, self._history, now_s)

    def _grant(self) -> bool:
        """Execute requests of browsers; True where that changes the picture."""
        panel, is_changed = self._panel, False
        while not panel.wishes.empty():
            wish, of = panel.wishes.get()
            if wish == "left":
                first = self._server.initial_camera
                first.position, first.look_at, first.up = of
                continue
            is_changed = True
            if wish in ("point", "close"):
                if self._scene is not None:
                    panel.choose(None if wish == "close" else self._scene.pick(*of))
            elif wish == "look":
                panel.look_again()
            elif wish == "turn":
                self._turn(*of)
            elif wish == "pause":
                panel.pause()
                if not panel.paused and self._scene is not None:
                    self._history.add(self._newest)  # earlier ones of the pause are lost
            elif wish == "fit":
                self._scales.reset()
            elif wish == "tare":
                self._end.ring.call()
                panel.report_tare("requested: touch nothing for two seconds")
            elif wish in (MOMENT, STRETCH) and of is not None and self._scene is not None:
                page = self._page(0.0 if wish == MOMENT else EXPORTED_S).encode()
                if of.client_id in self._server.get_clients():  # it may have left meanwhile
                    of.send_file_download(f"{self._layout.title}.html", page)
        return is_changed

    def _turn(self, view: str, client: Any) -> None:
        """Set the camera of a browser, which may have left meanwhile."""
        if self._scene is not None and client.client_id in self._server.get_clients():
            with client.atomic():
                set_camera(client.camera, view, self._scene.extent, self._scene.pose)

    def _moment(self) -> Moment:
        """The snapshot to draw."""
        back_s = self._panel.back_s
        return self._history.back(back_s) if back_s else self._history[-1]

    def _draw(self, has_words: bool) -> None:
        panel, moment = self._panel, self._moment()
        shown = panel.shown
        assert self._scene is not None
        with self._server.atomic():
            self._scales.widen(moment, shown.quantity)
            self._scene.draw(moment, shown, self._scales, words=has_words)
            if has_words:
                panel.describe(moment, self._scales)
        panel.scales(self._scales)
        self._server.flush()  # now, without waiting for the server's own clock

    def _page(self, seconds: float) -> str:
        """The current snapshot, or the seconds up to it, as HTML."""
        moment, shown = self._moment(), self._panel.shown
        moments = self._history.stretch(moment, seconds) if seconds else [moment]
        for one in moments:
            self._scales.widen(one, shown.quantity)
        return as_html(moments, self._layout, shown, self._scales)

    def _save(self, file: str, seconds: float) -> dict[str, Any]:
        if self._scene is None:
            return {"error": f"{file}: must be of a skin with a cycle; got none yet"}
        page = self._page(seconds)
        try:
            with whole_file(Path(file), over=PAGE) as out:
                out.write(page.encode())
        except OSError as error:
            return {"error": f"{file}: {error.strerror}"}
        return {"bytes": len(page)}


def view(end: WorkerEnd) -> Viewer:
    """Serve the requested view."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # viser greets
    log_in_lines()
    return Viewer(end)


if __name__ == "__main__":
    run(view)
