"""What a person looks at more closely: a unit, a contact, the map of a patch."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from skin.contact.record import CONTACT, SlipState
from skin.io.messages.record import contacts_of
from skin.state import Status
from skin.view.colour import QUANTITIES, valid
from skin.view.health import STYLE, row_html
from skin.view.history import History, Moment
from skin.view.layout import Layout
from skin.view.patch_map import PatchMap
from skin.view.scene import Scales, described_force

__all__ = ["ContactFolder", "MapFolder", "UnitFolder", "known", "plot_of"]

PLOTTED_S = 20.0
"""Time span of the plots."""
NONE, LARGEST = "none", "the largest"
LOAD_INK, SHEAR_INK, WARM_INK, MARGIN_INK = "#fee838", "#56b4e9", "#e69f00", "#7fd6b0"
"""Colours for colour-blind readers, light on the dark panel."""
BAND = "rgba(254,232,56,0.25)"


def plot_of(gui: Any, title: str, *series: tuple[str, str], **more: Any) -> Any:
    """A plot over the last seconds, of series with a label and a colour."""
    empty = np.array([-PLOTTED_S, 0.0])
    axis = {"stroke": "#c1c7cf", "grid": {"stroke": "rgba(193,199,207,0.15)"}}
    lines = tuple({"label": label, "stroke": ink, "width": 2} for label, ink in series)
    return gui.add_uplot(
        (empty, *(0.0 * empty for _ in series)), ({"label": "s"}, *lines), title=title,
        height=125, legend={"show": False}, padding=(10, 14, 0, 0),
        scales={"x": {"time": False, "range": (-PLOTTED_S, 0.0)}},
        axes=(axis, axis | {"size": 46}), **more,
    )  # fmt: skip


def times(history: History) -> tuple[np.ndarray, int]:
    """Seconds before the newest snapshot of those that are plotted, and their number."""
    last = round(30 * PLOTTED_S)
    stamps = history.values("stamp_ns", last)
    keep = stamps > stamps[-1] - round(1e9 * PLOTTED_S)
    return 1e-9 * (stamps[keep] - stamps[-1]), int(np.count_nonzero(keep))


def known(*series: np.ndarray) -> tuple[np.ndarray, ...]:
    """Points of which all values are known: a plot with NaN has no scale."""
    finite = np.logical_and.reduce([np.isfinite(values) for values in series])
    return tuple(values[finite] for values in series)


class UnitFolder:
    """The chosen unit: name, force ± sigma, temperature, flags, and plots of the last seconds.

    Parameters
    ----------
    gui : viser.GuiApi
    layout : Layout
    """

    def __init__(self, gui: Any, layout: Layout) -> None:
        self._layout = layout
        self.unit: int | None = None
        self._folder = gui.add_folder("Unit", visible=False)
        with self._folder:
            self._words = gui.add_html("")
            self._force = plot_of(
                gui, "normal force ± sigma, and shear, N", ("normal", LOAD_INK),
                ("shear", SHEAR_INK), ("", "rgba(0,0,0,0)"), ("", "rgba(0,0,0,0)"),
                bands=({"series": (3, 4), "fill": BAND},),
            )  # fmt: skip
            self._warm = plot_of(gui, "temperature, °C", ("temperature", WARM_INK))
            self.close = gui.add_button("Close")

    def choose(self, unit: int | None) -> None:
        """Show a unit, or none."""
        self.unit = unit
        self._folder.visible = unit is not None

    def show(self, moment: Moment) -> None:
        """Update the text."""
        if self.unit is not None:
            self._words.content = unit_html(moment.record, self.unit, self._layout.names[self.unit])

    def plot(self, history: History) -> None:
        """Update the plots."""
        if self.unit is None:
            return
        time_s, count = times(history)
        force, sigma, temperature = (
            history.of_unit(name, self.unit, count).astype(float)
            for name in ("force", "force_sigma", "temperature")
        )
        normal, error = force[:, 2], np.nan_to_num(sigma[:, 2])
        shear = np.hypot(force[:, 0], force[:, 1])
        self._force.data = known(time_s, normal, shear, normal + error, normal - error)
        self._warm.data = known(time_s, temperature)


def unit_html(record: np.void, unit: int, name: str) -> str:
    """A unit as text.

    Force and its parts are in the unit's frame: z, the normal force, points into the skin.
    """
    force, sigma = record["force"][:, unit], record["force_sigma"][:, unit]
    status = Status(int(record["status"][unit]))
    flags = ", ".join(str(flag.name).lower() for flag in status) or "none"
    warmth = float(record["temperature"][unit])
    ratio, contact = float(record["test_ratio"][unit]), int(record["contact"][unit])
    rows = [
        ("unit", name, "#ff9ade"),
        ("force", described_force(record, unit), ""),
        *((f"f{axis}", _with_sigma(float(value), float(error), "N"), "")
          for axis, value, error in zip("xyz", force, sigma, strict=True)),
        ("temperature", f"{warmth:.1f} °C" if np.isfinite(warmth) else "unknown", ""),
        ("flags", flags, "" if valid(record)[unit] else "#78dcf0"),
    ]  # fmt: skip
    if np.isfinite(ratio):
        rows.append(("test ratio", f"{ratio:.2f}; 1 is the limit", ""))
    if 0 <= contact < int(record["contact_count"]):
        rows.append(("contact", f"{contacts_of(record)['id'][contact]}", ""))
    return f'<div style="{STYLE}">{"".join(row_html(*row) for row in rows)}</div>'


def _with_sigma(value: float, sigma: float, unit: str) -> str:
    if not np.isfinite(value):
        return "unknown"
    return f"{value:.3f} {unit}" if np.isnan(sigma) else f"{value:.3f} ± {sigma:.3f} {unit}"


class ContactFolder:
    """A chosen contact: load, shear and margin over the last seconds, also after it has ended.

    Parameters
    ----------
    gui : viser.GuiApi
    """

    def __init__(self, gui: Any) -> None:
        with gui.add_folder("Contact", expand_by_default=False):
            self.choice = gui.add_dropdown("plotted", (NONE, LARGEST), initial_value=NONE)
            self._words = gui.add_html("", visible=False)
            self._load = plot_of(gui, "load and shear, N", ("load", LOAD_INK),
                                 ("shear", SHEAR_INK), visible=False)  # fmt: skip
            self._margin = plot_of(gui, "slip margin, %", ("margin", MARGIN_INK), visible=False)

    def plot(self, history: History) -> None:
        """Update text, plots and the contacts that may be chosen."""
        is_on = self.choice.value != NONE
        for handle in (self._words, self._load, self._margin):
            if handle.visible is not is_on:
                handle.visible = is_on
        time_s, count = times(history)
        seen = seen_contacts(history, count)
        options = (NONE, LARGEST, *(f"contact {one}" for one in found_ids(seen)))
        if self.choice.value not in options:
            self.choice.value = LARGEST  # it ended before the time that is plotted
        if options != self.choice.options:
            self.choice.options = options
        if not is_on:
            return
        number = chosen_id(self.choice.value, seen)
        load, shear, margin = contact_series(seen, number)
        self._load.data = known(time_s, load, shear)
        self._margin.data = known(time_s, 100.0 * margin)
        self._words.content = contact_html(number, time_s, load, seen)


def seen_contacts(history: History, count: int) -> np.ndarray:
    """The CONTACT records of the last snapshots, shape (t, k); those beyond its number are 0 in
    `id`, which none has."""
    seen = history.values("contacts", count).view(CONTACT)[..., 0]
    beyond = np.arange(seen.shape[1]) >= history.values("contact_count", count)[:, np.newaxis]
    seen["id"] = np.where(beyond, -1, seen["id"])
    return seen


def found_ids(seen: np.ndarray) -> list[int]:
    """Identities of all contacts seen, newest first."""
    return sorted({int(one) for one in np.unique(seen["id"]) if one >= 0}, reverse=True)


def chosen_id(choice: str, seen: np.ndarray) -> int | None:
    """Identity of the chosen contact: for "the largest", that with the largest load in the newest
    snapshot; None without one."""
    if choice != LARGEST:
        return int(choice.removeprefix("contact "))
    if not seen.size:
        return None
    newest = seen[-1][seen[-1]["id"] >= 0]
    return int(newest["id"][newest["load"].argmax()]) if newest.size else None


def contact_series(seen: np.ndarray, number: int | None) -> tuple[np.ndarray, ...]:
    """Load and shear in newton, and margin, of a contact over time, each of shape (t,); NaN before
    its first and after its last snapshot. A contact that pauses in between bears nothing there."""
    found = np.full((3, len(seen)), np.nan)
    at, slot = np.nonzero(seen["id"] == (-2 if number is None else number))
    one = seen[at, slot]
    along = np.einsum("ta,ta->t", one["wrench"][:, :3], one["normal"])
    across = one["wrench"][:, :3] - along[:, np.newaxis] * one["normal"]
    found[0, at], found[2, at] = one["load"], one["margin"]
    found[1, at] = np.sqrt(np.einsum("ta,ta->t", across, across))
    if at.size:
        paused = np.setdiff1d(np.arange(at[0], at[-1]), at)
        found[:2, paused] = 0.0
    return tuple(found)


def contact_html(number: int | None, time_s: np.ndarray, load: np.ndarray, seen: np.ndarray) -> str:
    """A contact as text: its state now, or how long ago it ended."""
    there = np.flatnonzero(np.isfinite(load))
    if number is None or not there.size:
        rows = [("contact", "none now")]
    elif there[-1] < load.size - 1:
        rows = [("contact", f"{number}, ended {-time_s[there[-1]]:.1f} s ago")]
    else:
        one = seen[-1][seen[-1]["id"] == number][0]
        slip = SlipState(int(one["slip"])).name.lower()
        margin = float(one["margin"])
        rows = [
            ("contact", f"{number}"), ("load", f"{one['load']:.2f} N"), ("slip", slip),
            ("margin", f"{100 * margin:.0f} %" if np.isfinite(margin) else "unknown"),
        ]  # fmt: skip
    return f'<div style="{STYLE}">{"".join(row_html(*row) for row in rows)}</div>'


class MapFolder:
    """A chosen patch as a flat map, in the colours of the picture.

    Parameters
    ----------
    gui : viser.GuiApi
    layout : Layout
    """

    def __init__(self, gui: Any, layout: Layout) -> None:
        self._layout, self._maps = layout, dict[str, PatchMap]()
        with gui.add_folder("Map", expand_by_default=False):
            names = dict.fromkeys(layout.patch_names)
            self.choice = gui.add_dropdown("patch", (NONE, *names), initial_value=NONE)
            empty = np.zeros((8, 8, 3), np.uint8)
            self._image = gui.add_image(empty, format="png", visible=False)
            self._text = gui.add_html("", visible=False)

    def show(self, moment: Moment, quantity: str, scales: Scales, chosen: int | None) -> None:
        """Update the image."""
        name = self.choice.value
        for handle in (self._image, self._text):
            if handle.visible is not (name != NONE):
                handle.visible = name != NONE
        if name == NONE:
            return
        if name not in self._maps:
            units = np.flatnonzero(self._layout.patch == self._layout.patch_names.index(name))
            position, rotation = moment.pose.position, moment.pose.rotation
            self._maps[name] = PatchMap(units, position, rotation, self._layout.area)
            self._text.content = (
                '<div style="padding:0 0.9em 0.4em;font-size:0.78em;opacity:0.75">'
                f"{escape(name)}: {units.size} units, seen from outside</div>"
            )
        scale, values = scales.of[quantity], QUANTITIES[quantity].values(moment.record)
        image = self._maps[name].image(moment.record, values, (scale.low, scale.high), chosen)
        self._image.image = image
