"""Health of a skin as text: units that are not valid, losses, rates, times."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

import numpy as np

from bus.cycle import WRONG_FRAMES
from bus.state import BusState
from skin.io.messages.record import BUS_STATES, COUNTERS
from skin.state import INVALID, Status
from skin.view.colour import is_bad, is_on
from topology import Topology

__all__ = ["Health", "flagged", "table_html"]

REASONS = 4
"""Reasons that are named at the top of the panel."""
LISTED = 12
"""Units that are named; if there are more, their number is given."""
RATE_S = 2.0
"""Duration over which rates and losses are evaluated, or more where snapshots come seldom."""
SILENT_S = 1.0
"""Time without a cycle after which a live skin has stopped [assumed: cycles take milliseconds]."""
SLOW, SLOWEST = 0.9, 0.5
"""Shares of the nominal cycle rate below which health is impaired, and poor [assumed]."""
AMBER, RED, GREEN, PALE = "#ffb020", "#e5352b", "#2e7d46", "#78dcf0"


class _Recent(NamedTuple):
    """Counters of a snapshot, for rates."""

    stamp_ns: int
    cycles: int
    frames: int
    wrong: int
    overruns: int
    work_us: float


def flagged(
    status: np.ndarray, names: Sequence[str], test_ratio: np.ndarray | None = None
) -> list[tuple[str, str]]:
    """Units that are not valid, with their flags, and the test ratio if there is one. Disabled
    units are left out.

    Examples
    --------
    >>> flagged(np.array([0, int(Status.LATE | Status.STALE)], np.uint16), ["a", "b"])
    [('b', 'late, stale')]
    """
    found = []
    for i in np.flatnonzero(is_bad(status)).tolist():
        flags = Status(int(status[i])) & INVALID
        why = [str(flag.name).lower() for flag in flags]
        if test_ratio is not None and np.isfinite(test_ratio[i]):
            why.append(f"test ratio {test_ratio[i]:.2f}")
        found.append((names[i], ", ".join(why)))
    return found


class Health:
    """Summary of the snapshots of a skin, whose patches may be blind as a whole."""

    def __init__(self, topology: Topology) -> None:
        self._names, self._nominal_hz = topology.unit_names, topology.cycle_rate_hz
        self._patch, self._patch_names = topology.patch, topology.patch_names
        self._recent: deque[_Recent] = deque()

    def add(self, snapshot: np.void) -> None:
        """Add a snapshot."""
        counters = dict(zip(COUNTERS, snapshot["counters"].tolist(), strict=True))
        recent, stamp_ns = self._recent, int(snapshot["stamp_ns"])
        if not stamp_ns:
            return
        if recent and stamp_ns <= recent[-1].stamp_ns:  # a clock was set
            recent.clear()
        recent.append(_Recent(
            stamp_ns, int(snapshot["cycles"]), counters["data"],
            sum(counters[name] for name in WRONG_FRAMES), int(snapshot["overruns"]),
            float(snapshot["work_us"]),
        ))  # fmt: skip
        while len(recent) > 2 and stamp_ns - recent[0].stamp_ns > 1e9 * RATE_S:
            recent.popleft()

    def rates_hz(self) -> tuple[float, float]:
        """Cycles and data frames a second; NaN before there are two snapshots."""
        if len(self._recent) < 2:
            return np.nan, np.nan
        first, last = self._recent[0], self._recent[-1]
        seconds = 1e-9 * (last.stamp_ns - first.stamp_ns)
        return (last.cycles - first.cycles) / seconds, (last.frames - first.frames) / seconds

    def judged(self, record: np.void, silent_s: float = 0.0) -> tuple[list[str], list[str]]:
        """What is poor (a patch or the whole skin is blind, or far too slow; red), and what is
        impaired (something is missing, the rest is right; amber).

        Parameters
        ----------
        record : void
            The newest snapshot.
        silent_s : float
            Time since it came, of a live skin; 0 otherwise.
        """
        poor: list[str] = []
        impaired: list[str] = []
        if record["cycle"] < 0:
            return poor, ["no cycle yet"]
        if silent_s > SILENT_S:
            poor.append(f"no cycle for {silent_s:.0f} s")
        blind, others = self._bad_units(record["status"])
        poor += [f"{patch}: no unit is valid" for patch in blind]
        if others:
            impaired.append(f"{others} {'more ' * bool(blind)}units not valid")
        for state in (BUS_STATES[state] for state in record["bus_states"] if state >= 0):
            if state != BusState.ACTIVE:
                worst = state in (BusState.BUS_OFF, BusState.DOWN)
                (poor if worst else impaired).append(f"a bus is {state}")
        cycles, _ = self.rates_hz()
        if cycles < SLOW * self._nominal_hz:
            where = poor if cycles < SLOWEST * self._nominal_hz else impaired
            where.append(f"{cycles:.0f} Hz of {self._nominal_hz:.0f}")
        if self._recent:
            first, last = self._recent[0], self._recent[-1]
            within = f"in {1e-9 * (last.stamp_ns - first.stamp_ns):.2g} s"
            if wrong := last.wrong - first.wrong:
                impaired.append(f"{wrong} frames lost or wrong {within}")
            if late := last.overruns - first.overruns:
                impaired.append(f"{late} periods left out {within}")
        if not record["whole"]:
            impaired.append("the wrench is not whole")
        if beyond := int(record["untracked"]):
            impaired.append(f"{beyond} contacts have no identity")
        return poor, impaired

    def _bad_units(self, status: np.ndarray) -> tuple[list[str], int]:
        """Patches without a valid unit, and the number of invalid units of others."""
        on, count = is_on(status), len(self._patch_names)
        of_patch = np.bincount(self._patch[on], minlength=count)
        bad = np.bincount(self._patch[is_bad(status)], minlength=count)
        blind = (of_patch > 0) & (bad == of_patch)
        names = [self._patch_names[at] for at in np.flatnonzero(blind).tolist()]
        return names, int(bad[~blind].sum())

    def banner_html(self, record: np.void, silent_s: float = 0.0) -> str:
        """The worst level in its colour, with the reasons."""
        poor, impaired = self.judged(record, silent_s)
        found = [*poor, *impaired]
        colour, ink = (RED, "#ffffff") if poor else (AMBER, "#14181c")
        if not found:
            colour, ink, found = GREEN, "#ffffff", ["all units valid, nothing lost"]
        if len(found) > REASONS:
            found[REASONS:] = [f"and {len(found) - REASONS} more"]
        return (
            f'<div style="margin:0.2em 0.6em 0.7em;padding:0.35em 0.7em;border-radius:4px;'
            f"background:{colour};color:{ink};font-size:0.82em;line-height:1.35;"
            f'font-weight:600">{escape("; ".join(found))}</div>'
        )

    def rows(self, record: np.void) -> list[tuple[str, str]]:
        """Name and text of each line, for a snapshot."""
        on, bad = is_on(record["status"]), is_bad(record["status"])
        counters = dict(zip(COUNTERS, record["counters"].tolist(), strict=True))
        losses = [f"{name} {counters[name]}" for name in WRONG_FRAMES if counters[name]]
        cycles, frames = self.rates_hz()
        of = f"{cycles:.0f} Hz of {self._nominal_hz:.0f}, {frames:.0f} frames/s"
        longest_us = max((one.work_us for one in self._recent), default=0.0)
        rows = [
            ("units", f"{np.count_nonzero(on & ~bad)} of {np.count_nonzero(on)} valid"),
            ("rate", of if np.isfinite(cycles) else "not known yet"),
            ("losses", ", ".join(losses) or "none"),
            ("left out", f"{record['overruns']} periods"),
        ]
        if longest_us:
            rows.append(("cycle time", f"{longest_us:.0f} µs at most"))
        ratio = np.where(np.isfinite(record["test_ratio"]), record["test_ratio"], -1.0)
        if (worst := float(ratio.max(initial=-1.0))) >= 0.0:
            unit = self._names[int(ratio.argmax())]
            rows.append(("test ratio", f"{worst:.2f} at most ({unit}); 1 is the limit"))
        return rows

    def html(self, record: np.void, faults: Sequence[tuple[str, str]] = ()) -> str:
        """The panel; `faults` are those of links, with their names."""
        found = flagged(record["status"], self._names, record["test_ratio"])
        lines = [(name, text, "") for name, text in self.rows(record)]
        lines += [(name, why, PALE) for name, why in found[:LISTED]]
        if len(found) > LISTED:
            lines.append(("…", f"and {len(found) - LISTED} more units", PALE))
        lines += [(f"link {name}", why, AMBER) for name, why in faults[:LISTED]]
        return table_html(lines)


def table_html(rows: Sequence[tuple[str, str, str]]) -> str:
    """A table of names, texts, and colours of the names."""
    cells = (
        f'<span style="opacity:0.75;color:{colour or "inherit"}">{escape(name)}</span>'
        f"<span>{escape(text)}</span>"
        for name, text, colour in rows
    )
    return (
        '<div style="display:grid;grid-template-columns:auto 1fr;gap:0.15em 0.8em;'
        f'padding:0.4em 0.9em;font-size:0.78em;line-height:1.35">{"".join(cells)}</div>'
    )
