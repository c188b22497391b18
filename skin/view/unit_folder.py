"""The last seconds of a skin as plots, and the unit that a person has chosen."""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np

from skin.io.messages.record import contacts_of
from skin.state import Status
from skin.view.colour import valid
from skin.view.health import STYLE, row_html
from skin.view.layout import Layout
from skin.view.scene import described_force
from skin.view.snapshot import RATE_HZ

__all__ = ["PLOTTED_S", "History", "UnitFolder", "known", "plot_of"]

PLOTTED_S = 20.0
"""Time span of the plots."""
LOAD_INK, SHEAR_INK, WARM_INK = "#fee838", "#56b4e9", "#e69f00"
"""Colours for colour-blind readers, light on the dark panel."""
BAND = "rgba(254,232,56,0.25)"


class _Kept(NamedTuple):
    """What plots show of a snapshot."""

    stamp_ns: int
    wrench: np.ndarray
    contacts: int
    force: np.ndarray
    force_sigma: np.ndarray
    temperature: np.ndarray


class History:
    """What is plotted of the snapshots of the last seconds."""

    def __init__(self) -> None:
        self._kept: deque[_Kept] = deque(maxlen=round(PLOTTED_S * RATE_HZ))

    def add(self, record: np.void) -> None:
        """Add a snapshot."""
        arrays = (record[name].copy() for name in ("force", "force_sigma", "temperature"))
        stamp, count = int(record["stamp_ns"]), int(record["contact_count"])
        self._kept.append(_Kept(stamp, record["wrench"].copy(), count, *arrays))

    def _recent(self) -> tuple[np.ndarray, list[_Kept]]:
        """Seconds before the newest snapshot, and these."""
        newest = self._kept[-1].stamp_ns
        kept = [one for one in self._kept if newest - one.stamp_ns < round(1e9 * PLOTTED_S)]
        return 1e-9 * np.array([one.stamp_ns - newest for one in kept]), kept

    def skin(self) -> tuple[np.ndarray, ...]:
        """Seconds, total force in newton, number of contacts, each of shape (m,)."""
        time_s, kept = self._recent()
        force = np.linalg.norm([one.wrench[:3] for one in kept], axis=1)
        return time_s, force, np.array([one.contacts for one in kept], float)

    def unit(self, i: int) -> tuple[np.ndarray, ...]:
        """Seconds; normal force, its sigma, shear in newton; temperature: each of shape (m,)."""
        time_s, kept = self._recent()
        force = np.array([one.force[:, i] for one in kept], float)
        sigma = np.array([one.force_sigma[2, i] for one in kept], float)
        warm = np.array([one.temperature[i] for one in kept], float)
        return time_s, force[:, 2], np.nan_to_num(sigma), np.hypot(force[:, 0], force[:, 1]), warm


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

    def show(self, record: np.void) -> None:
        """Update the text."""
        if self.unit is not None:
            self._words.content = unit_html(record, self.unit, self._layout.names[self.unit])

    def plot(self, history: History) -> None:
        """Update the plots."""
        if self.unit is None:
            return
        time_s, normal, error, shear, warm = history.unit(self.unit)
        self._force.data = known(time_s, normal, shear, normal + error, normal - error)
        self._warm.data = known(time_s, warm)


def unit_html(record: np.void, unit: int, name: str) -> str:
    """A unit as text.

    Force and its parts are in the unit's frame: z, the normal force, points into the skin.
    """
    force, sigma = record["force"][:, unit], record["force_sigma"][:, unit]
    status = Status(int(record["status"][unit]))
    flags = ", ".join(str(flag.name).lower() for flag in status) or "none"
    temperature = float(record["temperature"][unit])
    ratio, contact = float(record["test_ratio"][unit]), int(record["contact"][unit])
    rows = [
        ("unit", name, "#ff9ade"),
        ("force", described_force(record, unit), ""),
        *((f"f{axis}", _with_sigma(float(value), float(error)), "")
          for axis, value, error in zip("xyz", force, sigma, strict=True)),
        ("temperature", f"{temperature:.1f} °C" if np.isfinite(temperature) else "unknown", ""),
        ("flags", flags, "" if valid(record)[unit] else "#78dcf0"),
    ]  # fmt: skip
    if np.isfinite(ratio):
        rows.append(("test ratio", f"{ratio:.2f}; 1 is the limit", ""))
    if 0 <= contact < int(record["contact_count"]):
        rows.append(("contact", f"{contacts_of(record)['id'][contact]}", ""))
    return f'<div style="{STYLE}">{"".join(row_html(*row) for row in rows)}</div>'


def _with_sigma(value: float, sigma: float) -> str:
    if not np.isfinite(value):
        return "unknown"
    return f"{value:.3f} N" if np.isnan(sigma) else f"{value:.3f} ± {sigma:.3f} N"
