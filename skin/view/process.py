"""The process of a view: ``python -m skin.view.process``, started by `skin.view.browser`."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from skin.errors import SkinError
from skin.view.complaints import tell_in_lines
from skin.view.export import EXPORTED_S, as_html
from skin.view.health import Health
from skin.view.history import History, Moment
from skin.view.kinds import PAGE
from skin.view.panel import MOMENT, STRETCH, Panel
from skin.view.scene import Scales, Scene
from skin.view.server import address_of, open_server
from skin.view.snapshot import RATE_HZ
from skin.worker import WorkerEnd
from topology.files import whole_file

LOOK_S = 0.85 / RATE_HZ
"""Between two looks for snapshots, wishes and commands [assumed]: few find two snapshots, of which
one would not be seen, and few find none, as a look costs a tenth of a picture."""
WORDS_S = 0.1
"""Between two changes of the words at contacts: more often nobody reads them [assumed]."""


class Viewer:
    """Draws what the ring brings, and does what browsers ask for."""

    def __init__(self, end: WorkerEnd) -> None:
        self._end, asked = end, end.request
        self._area, self._title = np.array(asked["area"]), asked["title"]
        self._server = open_server(
            asked["host"], asked["port"], self._title, checks_origin=True
        )  # fmt: skip
        self.address = address_of(asked["host"], self._server.get_port())
        self._history = History(end.ring.dtype, asked["kept"])
        self._health = Health(asked["names"], asked["rate_hz"])
        span_s = asked["kept"] / RATE_HZ
        self._panel = Panel(self._server, self._health, span_s, asked["can_tare"])
        self._scales = Scales()
        self._scene: Scene | None = None
        self._newest: Any = np.zeros(1, end.ring.dtype)[0]
        self._owes_words, self._words_due_s = False, 0.0
        self._connect()

    def _connect(self) -> None:
        """Let whoever comes next look from where the last one did. What the threads of the server
        hear is written by `run` alone: it is the one that knows whether there is still a server."""
        server = self._server

        @server.on_client_connect
        def came(client: Any) -> None:
            self._panel.wishes.put(("draw", client))

        @server.on_client_disconnect
        def left(client: Any) -> None:
            camera = client.camera
            pose = camera.position, camera.look_at, camera.up_direction
            self._panel.wishes.put(("left", pose))

    def run(self) -> None:
        """Go on until the loop ends."""
        due_s = time.monotonic()
        while True:
            ended = self._end.ended
            is_new = self._take()
            is_asked = self._grant()
            if self._is_seen():
                self._refresh(is_new, is_asked, time.monotonic())
            due_s = max(due_s + LOOK_S, time.monotonic())
            command = self._end.command(max(0.0, due_s - time.monotonic()))
            if command is not None:
                self._obey(command)
            elif ended:
                self._server.stop()
                return

    def _is_seen(self) -> bool:
        """Whether there is a browser to draw for; one that comes asks for a picture."""
        return bool(self._server.get_clients())

    def _refresh(self, is_new: bool, is_asked: bool, now_s: float) -> None:
        """Draw what is new or asked for; words that are due, also where nothing is."""
        has_words = is_asked or (now_s >= self._words_due_s and (is_new or self._owes_words))
        if self._scene is not None and (is_new or has_words):
            self._owes_words = not has_words
            if has_words:
                self._words_due_s = now_s + WORDS_S
            self._draw(has_words)
        self._panel.refresh(self._newest, self._history, now_s)

    def _take(self) -> bool:
        """Take in what waits in the ring."""
        ring = self._end.ring
        records = ring.unread()
        for record in records:
            self._health.add(record)
            if not self._panel.paused or self._scene is None:
                self._history.add(record)
        if not records.size:
            return False
        self._newest = records[-1].copy()
        ring.release(records.size)
        self._panel.has_new()
        if self._scene is None:
            self._scene = Scene(self._server, self._area, self._history[-1])
        return True

    def _grant(self) -> bool:
        """Do what browsers asked for; True where that changed the picture."""
        panel, is_changed = self._panel, False
        while not panel.wishes.empty():
            wish, of = panel.wishes.get()
            if wish == "left":
                first = self._server.initial_camera
                first.position, first.look_at, first.up = of
                continue
            is_changed = True
            if wish == "pause":
                panel.pause()
                if not panel.paused and self._scene is not None:
                    self._history.add(self._newest)  # what came since is gone, but for the last
            elif wish == "fit":
                self._scales.reset()
            elif wish == "tare":
                self._end.ring.call()
                panel.told("asked for: touch nothing for two seconds")
            elif wish in (MOMENT, STRETCH) and of is not None and self._scene is not None:
                page = self._page(0.0 if wish == MOMENT else EXPORTED_S).encode()
                if of.client_id in self._server.get_clients():  # it may have gone meanwhile
                    of.send_file_download(f"{self._title}.html", page)
        return is_changed

    def _moment(self) -> Moment:
        """What is to be seen now."""
        back_s = self._panel.back_s
        return self._history.back(back_s) if back_s else self._history[-1]

    def _draw(self, has_words: bool) -> None:
        panel, moment = self._panel, self._moment()
        shown = panel.shown
        assert self._scene is not None
        with self._server.atomic():
            self._scales.widen(moment, shown.quantity)
            self._scene.draw(moment, shown, self._scales, words=has_words)
        panel.scales(self._scales)
        self._server.flush()  # at once, and not at the next tick of the server's own clock

    def _page(self, seconds: float) -> str:
        """The moment that is seen, or the seconds up to it, as HTML."""
        moment, shown = self._moment(), self._panel.shown
        moments = self._history.stretch(moment, seconds) if seconds else [moment]
        for one in moments:
            self._scales.widen(one, shown.quantity)
        return as_html(moments, self._area, self._title, shown, self._scales)

    def _obey(self, command: dict[str, Any]) -> None:
        """Do what the loop commands."""
        name = command["command"]
        if name == "address":
            self._end.answer(address=self.address)
        elif name == "zeros":
            self._panel.told(command["text"])
        elif name == "export":
            self._take()
            self._end.answer(**self._save(Path(command["file"]), command["seconds"]))
        else:
            self._end.answer(error=f"command: must be 'address', 'zeros' or 'export'; got {name!r}")

    def _save(self, file: Path, seconds: float) -> dict[str, Any]:
        if self._scene is None:
            return {"error": f"{file}: must be of a skin with a cycle; got none yet"}
        page = self._page(seconds)
        try:
            with whole_file(file, over=PAGE) as out:
                out.write(page.encode())
        except OSError as error:
            return {"error": f"{file}: {error.strerror}"}
        return {"bytes": len(page)}


def main() -> None:
    """Serve one view."""
    end = WorkerEnd()
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # viser greets
    tell_in_lines()
    try:
        viewer = Viewer(end)
    except SkinError as error:
        _refuse(end, str(error))
        return
    viewer.run()


def _refuse(end: WorkerEnd, message: str) -> None:
    """Answer the first command with an error, and wait for the end."""
    until = time.monotonic() + 60.0
    while not end.ended and time.monotonic() < until:
        if end.command(1.0) is not None:
            end.answer(error=message)


if __name__ == "__main__":
    main()
