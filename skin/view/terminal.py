"""The live table in a terminal: units from above with their load, and numbers to the right."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections import deque
from typing import TextIO

import numpy as np

from bus.cycle import WRONG_FRAMES
from skin.state import State, if_wanted
from skin.view.colour import is_bad, is_on
from skin.view.drawing import contact_label
from skin.view.health import flagged
from skin.view.picture import plane
from topology import Topology

__all__ = ["LiveTable", "unit_map"]

REFRESH_S = 0.2
"""Interval of updates: readable, and the cycle must not wait for a terminal."""
SHADES = " .:-=+*#%@"
RAMP = (236, 23, 29, 35, 71, 107, 143, 179, 173, 167)
"""Colours of the 256-colour palette for them, from no load to full load."""
FULL_SCALE_N = 6.0
"""Load of the brightest cell."""
CONTACTS = UNITS = 3
"""Number of contacts, and of invalid units, shown."""
CLEAR_DOWN = "\x1b[J"


def unit_map(topology: Topology, width: int = 64) -> tuple[np.ndarray, tuple[int, int]]:
    """Character cell of each unit in a flat map of the skin.

    The skin is seen along the axis in which it extends least; columns run along the longest one.

    Parameters
    ----------
    topology : Topology
    width : int
        Largest number of columns.

    Returns
    -------
    cells : ndarray, shape (2, n), int
        Row and column, row 0 on top.
    shape : tuple of int
        Rows and columns of the map.
    """
    from scipy.spatial import KDTree

    x, y = topology.position[plane(topology)]
    places = topology.position.T
    pitch = KDTree(places).query(places, k=2)[0][:, 1].min() if topology.n > 1 else 1.0
    column = np.rint((x - x.min()) / pitch).astype(int)
    row = np.rint((y.max() - y) / pitch).astype(int)
    if column.max() >= width:
        column = (column * (width - 1)) // column.max()
    return np.stack([row, column]), (int(row.max()) + 1, int(column.max()) + 1)


class LiveTable:
    """Draws states in place at most every 0.2 s; writes nothing to a file that is not a terminal.

    Parameters
    ----------
    topology : Topology
    stream : text file
        Output; standard output if not given.
    """

    def __init__(self, topology: Topology, *, stream: TextIO | None = None) -> None:
        self._topology = topology
        self._stream = sys.stdout if stream is None else stream
        self._cells, self._shape = unit_map(topology)
        self._next = 0.0
        self._lines = 0
        self._work_us: deque[float] = deque(maxlen=1000)
        self._is_live = self._stream.isatty()
        self._has_colour = not os.environ.get("NO_COLOR")  # https://no-color.org

    def show(self, state: State, work_ns: int) -> None:
        """Record a cycle's working time and redraw when due."""
        self._work_us.append(work_ns * 1e-3)
        now = time.monotonic()
        if not self._is_live or now < self._next:
            return
        self._next = now + REFRESH_S
        lines = self.lines(state)
        up = f"\x1b[{self._lines}A" if self._lines else ""
        width = shutil.get_terminal_size().columns
        body = "\n".join(line if "\x1b" in line else line[: width - 1] for line in lines)
        self._stream.write(f"{up}\r{CLEAR_DOWN}{body}\n")
        self._stream.flush()
        self._lines = len(lines)

    def lines(self, state: State) -> list[str]:
        """The table for one state, one string a line."""
        rows, side = self._heat(state), self._numbers(state)
        rows += ["  " * self._shape[1]] * (len(side) - len(rows))
        side += [""] * (len(rows) - len(side))
        title = f"{self._topology.name}: {self._topology.n} units, cycle {state.cycle}"
        if state.overruns:
            title += f", {state.overruns} periods left out"
        return [title, *(f"  {a}   {b}" for a, b in zip(rows, side, strict=True))]

    def _heat(self, state: State) -> list[str]:
        """The map: a shade for a load, `!` for an invalid unit, nothing where no unit is on."""
        cells = np.full(self._shape, "  ", object)
        on, force = is_on(state.units.status), if_wanted(state.units, "force")
        bad = is_bad(state.units.status)
        load = np.zeros(on.size) if force is None else np.where(bad, 0.0, force[2])
        level = np.nan_to_num(load / FULL_SCALE_N).clip(0.0, 1.0)
        shades = np.rint(level * (len(SHADES) - 1)).astype(int).tolist()
        for row, column, i in zip(*self._cells.tolist(), range(on.size), strict=True):
            if bad[i]:
                glyph, style = "!", "41"
            elif force is not None and on[i]:
                glyph, style = SHADES[shades[i]], f"48;5;{RAMP[shades[i]]}"
            else:
                continue
            text = f"\x1b[97;{style}m{glyph} \x1b[0m" if self._has_colour else f"{glyph} "
            cells[row, column] = text
        return ["".join(row) for row in cells]

    def _numbers(self, state: State) -> list[str]:
        units, counters = state.units, state.counters
        lines = []
        if (wrench := if_wanted(state, "wrench")) is not None:
            part = "  not whole" if if_wanted(state, "whole") is False else ""
            lines.append(_row("force", wrench[:3], "7.2f", f"N{part}"))
            lines.append(_row("moment", 1e3 * wrench[3:], "7.1f", "mN·m"))
        if (centroid := if_wanted(state, "centroid")) is not None:
            lines.append(_row("centre", 1e3 * centroid, "7.1f", "mm"))
        if if_wanted(state, "contacts") is not None:
            lines += self._contacts(state)
        if (temperature := if_wanted(units, "temperature")) is not None and units.valid.any():
            warm = temperature[units.valid]
            lines.append(f"warmth    {warm.mean():7.1f} mean, {warm.max():.1f} max  °C")
        lines.append(f"coverage  {100 * state.coverage:7.1f}  %")
        wrong = [f"{name} {count}" for name in WRONG_FRAMES if (count := getattr(counters, name))]
        lines.append(f"frames    {counters.data:7d}, {', '.join(wrong) or 'none wrong'}")
        if self._work_us:
            p50, p99 = np.percentile(self._work_us, [50, 99])
            lines.append(f"cycle     {p50:7.1f} µs p50, {p99:.1f} µs p99")
        found = flagged(units.status, self._topology.unit_names, if_wanted(units, "test_ratio"))
        lines += [f"! {unit}: {why}" for unit, why in found[:UNITS]]
        return lines + [f"! and {len(found) - UNITS} more units"] * (len(found) > UNITS)

    def _contacts(self, state: State) -> list[str]:
        """Heaviest contacts, in a fixed number of lines."""
        heaviest = sorted(state.contacts, key=lambda contact: -contact.load)[:CONTACTS]
        lines = [contact_label(contact.record) for contact in heaviest] or ["contact   –"]
        return lines + [""] * (CONTACTS - len(lines))


def _row(name: str, values: np.ndarray, form: str, unit: str) -> str:
    """A name, three numbers, a unit; dashes where the numbers are unknown."""
    known = not np.isnan(values).any()
    numbers = " ".join(f"{value:+{form}}" if known else "      –" for value in values)
    return f"{name:<9} {numbers}  {unit}"
