"""What stands beside the picture: choices, buttons, plots, health."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from queue import SimpleQueue
from typing import Any

import numpy as np

from skin.view.colour import QUANTITIES
from skin.view.health import Health, plotted
from skin.view.history import History
from skin.view.legend import arrows_html, legend_html
from skin.view.scene import Scales, Shown

__all__ = ["MOMENT", "STRETCH", "Panel"]

PLOTTED_S = 20.0
"""Seconds that the plots show."""
WORDS_S, PLOTS_S = 0.5, 0.2
"""Between two changes of the words, and of the plots: more often nobody reads them [assumed]."""
PAUSE, FOLLOW, FIT = "Pause", "Follow live", "Fit the scale"
MOMENT, STRETCH = "this moment", "last 10 s"
FORCE_INK, CONTACTS_INK = "#fee838", "#56b4e9"


class Panel:
    """The panel of a view. What a browser asks for waits in `wishes` for the view's own loop.

    Parameters
    ----------
    server : viser.ViserServer
    health : Health
    span_s : float
        Seconds that can be gone back, at most.
    can_tare : bool
    """

    def __init__(self, server: Any, health: Health, span_s: float, can_tare: bool) -> None:
        self.wishes: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._health = health
        self._ends: tuple[object, ...] = ()
        self._has_new_words = self._has_new_plots = False
        self._words_due_s = self._plots_due_s = 0.0
        self.paused = False
        gui = server.gui
        with gui.add_folder("Colour"):
            self._quantity = gui.add_dropdown("quantity", tuple(QUANTITIES), initial_value="load")
            self._legend = gui.add_html("")
            self._fit = gui.add_button(FIT, hint="to what is shown now")
            self._forces = gui.add_checkbox("force arrows", initial_value=True)
            self._contacts = gui.add_checkbox("contacts", initial_value=True)
        with gui.add_folder("Time"):
            self._pause = gui.add_button(PAUSE)
            self._back = gui.add_slider(
                "seconds back", min=0.0, max=span_s, step=0.05, initial_value=0.0, disabled=True,
                hint="while paused: the minute before",
            )  # fmt: skip
            self._save = gui.add_button_group("save as a page", (MOMENT, STRETCH))
        with gui.add_folder("Health"):
            self._words = gui.add_html("")
            self._tare = gui.add_button(
                "Tare", hint="take the zeros of all untouched units anew", visible=can_tare
            )
            self._told = gui.add_html("", visible=False)
        with gui.add_folder("Last 20 s"):
            self._force = self._plot(gui, "total force, N", FORCE_INK)
            self._count = self._plot(gui, "contacts", CONTACTS_INK)
        self._connect()

    def _connect(self) -> None:
        """Let every change be a wish: callbacks run in threads of the server."""
        for handle, wish in (
            (self._quantity, "draw"), (self._forces, "draw"), (self._contacts, "draw"),
            (self._back, "draw"),
        ):  # fmt: skip
            handle.on_update(self._asks(wish))
        for handle, wish in (
            (self._pause, "pause"), (self._fit, "fit"), (self._tare, "tare"),
        ):  # fmt: skip
            handle.on_click(self._asks(wish))
        self._save.on_click(lambda event: self.wishes.put((event.target.value, event.client)))

    def _asks(self, wish: str) -> Callable[[Any], None]:
        return lambda event: self.wishes.put((wish, event.client))

    def _plot(self, gui: Any, label: str, ink: str) -> Any:
        empty = np.array([-PLOTTED_S, 0.0])
        axis = {"stroke": "#c1c7cf", "grid": {"stroke": "rgba(193,199,207,0.15)"}}
        return gui.add_uplot(
            (empty, 0.0 * empty),
            ({"label": "s"}, {"label": label, "stroke": ink, "width": 2}),
            title=label, height=125, legend={"show": False}, padding=(10, 14, 0, 0),
            scales={"x": {"time": False, "range": (-PLOTTED_S, 0.0)}},
            axes=(axis, axis | {"size": 46}),
        )  # fmt: skip

    @property
    def shown(self) -> Shown:
        """What is to be seen."""
        return Shown(self._quantity.value, self._forces.value, self._contacts.value)

    @property
    def back_s(self) -> float:
        """How far to go back from the newest snapshot that is kept."""
        return float(self._back.value) if self.paused else 0.0

    def pause(self) -> None:
        """Stop, or go on."""
        self.paused = not self.paused
        self._pause.label = FOLLOW if self.paused else PAUSE
        self._back.disabled = not self.paused
        if not self.paused:
            self._back.value = 0.0

    def told(self, text: str) -> None:
        """Show what became of a tare."""
        self._told.visible = True
        self._told.content = (
            f'<div style="padding:0.2em 0.9em;font-size:0.78em">{escape(text)}</div>'
        )

    def refresh(self, newest: np.void, history: History, now_s: float) -> None:
        """Renew the words and the plots, where there is something new and it is time to."""
        if self._has_new_words and now_s >= self._words_due_s:
            self._has_new_words, self._words_due_s = False, now_s + WORDS_S
            self._words.content = self._health.html(newest)
        if self._has_new_plots and now_s >= self._plots_due_s and not self.paused:
            self._has_new_plots, self._plots_due_s = False, now_s + PLOTS_S
            time_s, force, contacts = plotted(history, PLOTTED_S)
            self._force.data = (time_s, force)
            self._count.data = (time_s, contacts)

    def has_new(self) -> None:
        """Let words and plots be renewed, once they are due."""
        self._has_new_words = self._has_new_plots = True

    def scales(self, scales: Scales) -> None:
        """Show the scales as they are; the same again costs nothing."""
        ends = scales.ends(self._quantity.value)
        if ends == self._ends:
            return
        self._ends = ends
        self._legend.content = legend_html(self._quantity.value, scales) + arrows_html(scales)
