"""The panel next to the picture: choices, buttons, plots, health."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from queue import SimpleQueue
from typing import Any

import numpy as np

from skin.cividis import CIVIDIS
from skin.view.colour import INVALID_COLOUR, OFF_COLOUR, QUANTITIES
from skin.view.health import Health
from skin.view.layout import Layout
from skin.view.scene import Scales, Shown
from skin.view.unit_folder import History, UnitFolder, known, plot_of

__all__ = ["Panel", "legend_html"]

WORDS_S, PLOTS_S = 0.5, 0.2
"""Intervals of updates of the text, and of the plots: more often is not readable [assumed]."""
FORCE_INK, CONTACTS_INK = "#fee838", "#56b4e9"


class Panel:
    """The panel of a view. Requests of browsers wait in `requests` for the view's own loop.

    Parameters
    ----------
    server : viser.ViserServer
    layout : Layout
    health : Health
    is_live : bool
        Whether it is a live skin, whose zeros can be taken.
    """

    def __init__(self, server: Any, layout: Layout, health: Health, is_live: bool) -> None:
        self.requests: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._health, self._history = health, History()
        self._ends: tuple[object, ...] = ()
        self._has_new_words = self._has_new_plots = False
        self._words_due_s = self._plots_due_s = 0.0
        self._is_live, self._came_s, self._links = is_live, 0.0, layout.links
        gui = server.gui
        self._banner = gui.add_html("")
        self._unit = UnitFolder(gui, layout)
        with gui.add_folder("Colour"):
            self._quantity = gui.add_dropdown("quantity", tuple(QUANTITIES), initial_value="load")
            self._legend = gui.add_html("")
            self._fit = gui.add_button("Fit the scale", hint="to the values shown now")
            self._forces = gui.add_checkbox("force arrows", initial_value=True)
            self._contacts = gui.add_checkbox("contacts", initial_value=True)
            self._shows_links = gui.add_checkbox(
                "links", initial_value=True, visible=layout.links is not None
            )
            self._names = gui.add_checkbox("names", initial_value=True)
            self._camera = gui.add_button("Reset the camera")
        with gui.add_folder("Health"):
            self._words = gui.add_html("")
            self._tare = gui.add_button(
                "Tare", hint="take the zeros of all untouched units again", visible=is_live
            )
            self._tare_text = gui.add_html("", visible=False)
        with gui.add_folder("Last 20 s"):
            self._force = plot_of(gui, "total force, N", ("total force, N", FORCE_INK))
            self._count = plot_of(gui, "contacts", ("contacts", CONTACTS_INK))
        for shown in (self._quantity, self._forces, self._contacts, self._shows_links, self._names):
            shown.on_update(self._requests("draw"))
        for button, request in (
            (self._fit, "fit"), (self._tare, "tare"), (self._camera, "camera"),
            (self._unit.close, "close"),
        ):  # fmt: skip
            button.on_click(self._requests(request))

    def _requests(self, request: str) -> Callable[[Any], None]:
        """A callback that leaves a request: it runs in a thread of the server."""
        return lambda event: self.requests.put((request, event.client))

    @property
    def shown(self) -> Shown:
        """The selected display options."""
        return Shown(
            self._quantity.value, self._forces.value, self._contacts.value,
            self._shows_links.value, self._names.value, self._unit.unit,
        )  # fmt: skip

    def report_tare(self, text: str) -> None:
        """Show the result of a tare."""
        self._tare_text.visible = True
        self._tare_text.content = (
            f'<div style="padding:0.2em 0.9em;font-size:0.78em">{escape(text)}</div>'
        )

    def choose(self, unit: int | None) -> None:
        """Show a unit, or none."""
        self._unit.choose(unit)
        self._has_new_words = self._has_new_plots = True
        self._words_due_s = self._plots_due_s = 0.0

    def add(self, record: np.void, now_s: float) -> None:
        """A snapshot has come."""
        self._health.add(record)
        self._history.add(record)
        self._has_new_words = self._has_new_plots = True
        self._came_s = now_s

    def refresh(self, newest: np.void, now_s: float) -> None:
        """Update the text and the plots, where there is something new and they are due."""
        silent_s = now_s - self._came_s if self._is_live and self._came_s else 0.0
        if now_s >= self._words_due_s:
            self._words_due_s = now_s + WORDS_S
            self._banner.content = self._health.banner_html(newest, silent_s)
            if self._has_new_words:
                self._has_new_words = False
                faults = () if self._links is None else self._links.problems
                self._words.content = self._health.html(newest, faults)
        if self._has_new_plots and now_s >= self._plots_due_s:
            self._has_new_plots, self._plots_due_s = False, now_s + PLOTS_S
            self._unit.plot(self._history)
            time_s, force, contacts = self._history.skin()
            self._force.data = known(time_s, force)
            self._count.data = (time_s, contacts)

    def describe(self, record: np.void) -> None:
        """Show the chosen unit."""
        self._unit.show(record)

    def scales(self, scales: Scales) -> None:
        """Show the scales; no cost if they are unchanged."""
        ends = scales.ends(self._quantity.value)
        if ends != self._ends:
            self._ends = ends
            self._legend.content = legend_html(self._quantity.value, scales)


def legend_html(quantity: str, scales: Scales) -> str:
    """A bar with the ends, the middle and the unit of its scale, the colours of units that are not
    valid or switched off, and the scale of the arrows."""
    chosen, scale = QUANTITIES[quantity], scales.of[quantity]
    stops = ",".join(_css(colour) for colour in CIVIDIS[::4])
    if quantity == "validity":
        ticks = ["flagged, if it has no cross", "", "valid"]
    else:
        middle = 0.5 * (scale.low + scale.high)
        ticks = [f"{value:g}" for value in (scale.low, middle, scale.high)]
        ticks[2] += f" {chosen.unit}"
    labels = "".join(f"<span>{escape(tick)}</span>" for tick in ticks)
    disc = "display:inline-block;width:1.1em;height:1.1em;border-radius:50%"
    invalid = (
        f'<span style="{disc};background:{_css(INVALID_COLOUR)};color:#14181c;text-align:center;'
        'line-height:1.1em;font-weight:700">×</span>'
    )
    off = f'<span style="{disc};vertical-align:text-bottom;background:{_css(OFF_COLOUR)}"></span>'
    return (
        '<div style="padding:0.3em 0.9em;font-size:0.78em">'
        f'<div style="height:0.9em;border-radius:3px;background:linear-gradient(90deg,{stops})">'
        f'</div><div style="display:flex;justify-content:space-between">{labels}</div>'
        f"<div>{invalid} not valid: no reading, or flagged &ensp; "
        f'<span style="white-space:nowrap">{off} switched off</span></div>'
        f'<div style="opacity:0.75">longest arrow of a unit {scales.unit.high:g} N, of a contact '
        f"{scales.contact.high:g} N</div></div>"
    )


def _css(colour: Any) -> str:
    red, green, blue = (int(part) for part in colour)
    return f"rgb({red},{green},{blue})"
