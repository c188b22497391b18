"""The panel next to the picture: choices, buttons, plots, health."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from queue import SimpleQueue
from typing import Any

import numpy as np

from skin.view.cameras import VIEWS
from skin.view.colour import QUANTITIES
from skin.view.health import Health, plotted
from skin.view.history import History, Moment
from skin.view.inspection import ContactFolder, MapFolder, UnitFolder, known, plot_of
from skin.view.layout import Layout
from skin.view.legend import arrows_html, legend_html
from skin.view.scene import Scales, Shown

__all__ = ["MOMENT", "STRETCH", "Panel"]

PLOTTED_S = 20.0
"""Time span of the plots."""
WORDS_S, PLOTS_S = 0.5, 0.2
"""Intervals of updates of the text, and of the plots: more often is not readable [assumed]."""
PAUSE, FOLLOW, FIT = "Pause", "Follow live", "Fit the scale"
MOMENT, STRETCH = "this moment", "last 10 s"
FORCE_INK, CONTACTS_INK = "#fee838", "#56b4e9"


class Panel:
    """The panel of a view. Requests of browsers wait in `wishes` for the view's own loop.

    Parameters
    ----------
    server : viser.ViserServer
    layout : Layout
    health : Health
    span_s : float
        Longest time to go back.
    is_live : bool
        Whether it is a live skin, whose zeros can be taken.
    """

    def __init__(
        self, server: Any, layout: Layout, health: Health, span_s: float, is_live: bool
    ) -> None:
        self.wishes: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._health = health
        self._ends: tuple[object, ...] = ()
        self._has_new_words = self._has_new_plots = False
        self._words_due_s = self._plots_due_s = 0.0
        self._is_live, self._came_s, self._links = is_live, 0.0, layout.links
        self.paused = False
        gui = server.gui
        self._banner = gui.add_html("")
        self._unit = UnitFolder(gui, layout)
        with gui.add_folder("Colour"):
            self._quantity = gui.add_dropdown("quantity", tuple(QUANTITIES), initial_value="load")
            self._legend = gui.add_html("")
            self._fit = gui.add_button(FIT, hint="to the values shown now")
            self._forces = gui.add_checkbox("force arrows", initial_value=True)
            self._contacts = gui.add_checkbox("contacts", initial_value=True)
            self._shows_links = gui.add_checkbox(
                "links", initial_value=True, visible=layout.links is not None
            )
            self._names = gui.add_checkbox("names", initial_value=True)
            self._camera = gui.add_button_group("camera", VIEWS)
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
                "Tare", hint="take the zeros of all untouched units again", visible=is_live
            )
            self._tare_text = gui.add_html("", visible=False)
        self._map = MapFolder(gui, layout)
        self._contact = ContactFolder(gui)
        with gui.add_folder("Last 20 s"):
            self._force = plot_of(gui, "total force, N", ("total force, N", FORCE_INK))
            self._count = plot_of(gui, "contacts", ("contacts", CONTACTS_INK))
        self._connect()

    def _connect(self) -> None:
        """Turn every change into a request: callbacks run in threads of the server."""
        for handle, wish in (
            (self._quantity, "draw"), (self._forces, "draw"), (self._contacts, "draw"),
            (self._back, "draw"), (self._shows_links, "draw"), (self._names, "draw"),
            (self._map.choice, "draw"), (self._contact.choice, "look"),
        ):  # fmt: skip
            handle.on_update(self._asks(wish))
        for handle, wish in (
            (self._pause, "pause"), (self._fit, "fit"), (self._tare, "tare"),
            (self._unit.close, "close"),
        ):  # fmt: skip
            handle.on_click(self._asks(wish))
        self._save.on_click(lambda event: self.wishes.put((event.target.value, event.client)))
        self._camera.on_click(
            lambda event: self.wishes.put(("turn", (event.target.value, event.client)))
        )

    def _asks(self, wish: str) -> Callable[[Any], None]:
        return lambda event: self.wishes.put((wish, event.client))

    @property
    def shown(self) -> Shown:
        """The selected display options."""
        return Shown(
            self._quantity.value, self._forces.value, self._contacts.value,
            self._shows_links.value, self._names.value, self._unit.unit,
        )  # fmt: skip

    @property
    def back_s(self) -> float:
        """Time to go back from the newest stored snapshot."""
        return float(self._back.value) if self.paused else 0.0

    def pause(self) -> None:
        """Pause or continue."""
        self.paused = not self.paused
        self._pause.label = FOLLOW if self.paused else PAUSE
        self._back.disabled = not self.paused
        if not self.paused:
            self._back.value = 0.0

    def report_tare(self, text: str) -> None:
        """Show the result of a tare."""
        self._tare_text.visible = True
        self._tare_text.content = (
            f'<div style="padding:0.2em 0.9em;font-size:0.78em">{escape(text)}</div>'
        )

    def choose(self, unit: int | None) -> None:
        """Show a unit, or none."""
        self._unit.choose(unit)
        self.look_again()

    def look_again(self) -> None:
        """Update text and plots at the next opportunity."""
        self._has_new_words = self._has_new_plots = True
        self._words_due_s = self._plots_due_s = 0.0

    def refresh(self, newest: np.void, history: History, now_s: float) -> None:
        """Update the text and the plots, where there is something new and they are due."""
        silent_s = now_s - self._came_s if self._is_live and self._came_s else 0.0
        if now_s >= self._words_due_s:
            self._words_due_s = now_s + WORDS_S
            self._banner.content = self._health.banner_html(newest, silent_s)
            if self._has_new_words:
                self._has_new_words = False
                faults = () if self._links is None else self._links.problems
                self._words.content = self._health.html(newest, faults)
        if self._has_new_plots and now_s >= self._plots_due_s and len(history):
            self._has_new_plots, self._plots_due_s = False, now_s + PLOTS_S
            self._unit.plot(history)
            self._contact.plot(history)
            time_s, force, contacts = plotted(history, PLOTTED_S)
            self._force.data = known(time_s, force)
            self._count.data = (time_s, contacts)

    def describe(self, moment: Moment, scales: Scales) -> None:
        """Show the chosen unit and the map of a moment."""
        self._unit.show(moment)
        self._map.show(moment, self._quantity.value, scales, self._unit.unit)

    def has_new(self, now_s: float) -> None:
        """Request an update of text and plots, once they are due: a snapshot has come."""
        self._has_new_words, self._came_s = True, now_s
        self._has_new_plots = self._has_new_plots or not self.paused

    def scales(self, scales: Scales) -> None:
        """Show the scales; no cost if they are unchanged."""
        ends = scales.ends(self._quantity.value)
        if ends == self._ends:
            return
        self._ends = ends
        self._legend.content = legend_html(self._quantity.value, scales) + arrows_html(scales)
