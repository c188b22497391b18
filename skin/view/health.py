"""The health of a skin, in words: units that must not be trusted, losses, rates, times."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from html import escape

import numpy as np

from bus.cycle import WRONG_FRAMES
from skin.state import INVALID, Status
from skin.view.history import History
from skin.view.snapshot import COUNTERS

__all__ = ["Health", "flagged", "is_on", "plotted"]

LISTED = 12
"""Units that are named; of more, the number."""
WORKS = 5000
"""Cycles over which working times are taken."""
NOTHING = (np.nan, np.nan, np.nan)
RATE_S = 2.0
"""Over which rates are taken."""


def flagged(
    status: np.ndarray, names: Sequence[str], test_ratio: np.ndarray | None = None
) -> list[tuple[str, str]]:
    """Units that must not be trusted, and why: their flags, and the test ratio where there is one.
    Those that the topology switches off are left out.

    Examples
    --------
    >>> flagged(np.array([0, int(Status.LATE | Status.STALE)], np.uint16), ["a", "b"])
    [('b', 'late, stale')]
    """
    found = []
    for i in np.flatnonzero((status & int(INVALID) != 0) & is_on(status)).tolist():
        flags = Status(int(status[i])) & INVALID
        why = [str(flag.name).lower() for flag in flags]
        if test_ratio is not None and np.isfinite(test_ratio[i]):
            why.append(f"test ratio {test_ratio[i]:.2f}")
        found.append((names[i], ", ".join(why)))
    return found


def is_on(status: np.ndarray) -> np.ndarray:
    """Units that the topology does not switch off, shape (n,), bool."""
    on: np.ndarray = status & int(Status.DISABLED) == 0
    return on


class Health:
    """Takes snapshots, and tells of them.

    Parameters
    ----------
    names : sequence of str
        Of the units.
    nominal_hz : float
        Cycles a second, as the topology wants them.
    """

    def __init__(self, names: Sequence[str], nominal_hz: float) -> None:
        self._names, self._nominal_hz = names, nominal_hz
        self._work_us: deque[float] = deque(maxlen=WORKS)
        self._recent: deque[tuple[int, int, int]] = deque(maxlen=round(30 * RATE_S))

    def add(self, snapshot: np.void) -> None:
        """Note a snapshot."""
        self._work_us.extend(snapshot["work_us"][: int(snapshot["works"])].tolist())
        frames = int(snapshot["counters"][COUNTERS.index("data")])
        self._recent.append((int(snapshot["stamp_ns"]), int(snapshot["cycles"]), frames))

    def work_us(self) -> tuple[float, float] | None:
        """Median and 99th percentile of a cycle's working time, µs; None where none is known."""
        if not self._work_us:
            return None
        p50, p99 = np.percentile(self._work_us, [50, 99])
        return float(p50), float(p99)

    def rates_hz(self) -> tuple[float, float, float]:
        """Cycles, data frames and snapshots a second; NaN before there are two snapshots."""
        recent = [one for one in self._recent if one[0]]
        if len(recent) < 2 or recent[-1][0] <= recent[0][0]:
            return NOTHING
        seconds = 1e-9 * (recent[-1][0] - recent[0][0])
        cycles, frames = (recent[-1][k] - recent[0][k] for k in (1, 2))
        return cycles / seconds, frames / seconds, (len(recent) - 1) / seconds

    def rows(self, record: np.void) -> list[tuple[str, str]]:
        """Name and text of each line, for a snapshot."""
        status = record["status"]
        on = np.count_nonzero(is_on(status))
        bad = np.count_nonzero((status & int(INVALID) != 0) & is_on(status))
        cycles, frames, shown = self.rates_hz()
        counters = dict(zip(COUNTERS, record["counters"].tolist(), strict=True))
        losses = [f"{name} {counters[name]}" for name in WRONG_FRAMES if counters[name]]
        work = self.work_us()
        rows = [
            ("units", f"{on - bad} of {on} valid"),
            ("frames", f"{counters['data']}" + _rate(frames, "/s")),
            ("losses", ", ".join(losses) or "none"),
            ("cycles", f"{record['cycle'] + 1}"
             + _rate(cycles, f" Hz of {self._nominal_hz:.0f}") + _rate(shown, " Hz shown")),
            ("left out", f"{record['overruns']} periods, {record['unsent']} SYNC not taken"),
        ]  # fmt: skip
        ratio = np.where(np.isfinite(record["test_ratio"]), record["test_ratio"], -1.0)
        if (worst := float(ratio.max(initial=-1.0))) >= 0.0:
            unit = self._names[int(ratio.argmax())]
            rows.append(("test ratio", f"{worst:.2f} at most ({unit}); 1 is the limit"))
        if not record["whole"]:
            rows.append(("wrench", "not whole: a silent unit may touch"))
        if work is not None:
            rows.append(("cycle time", f"{work[0]:.0f} µs p50, {work[1]:.0f} µs p99"))
        return rows

    def html(self, record: np.void) -> str:
        """The panel."""
        found = flagged(record["status"], self._names, record["test_ratio"])
        lines = [_line(name, text) for name, text in self.rows(record)]
        lines += [_line(name, why, "#78dcf0") for name, why in found[:LISTED]]
        if len(found) > LISTED:
            lines.append(_line("…", f"and {len(found) - LISTED} more units", "#78dcf0"))
        return f'<div style="{STYLE}">{"".join(lines)}</div>'


STYLE = (
    "display:grid;grid-template-columns:auto 1fr;gap:0.15em 0.8em;padding:0.4em 0.9em;"
    "font-size:0.78em;line-height:1.35"
)


def _line(name: str, text: str, colour: str = "inherit") -> str:
    return (
        f'<span style="opacity:0.75;color:{colour}">{escape(name)}</span>'
        f"<span>{escape(text)}</span>"
    )


def _rate(value: float, unit: str) -> str:
    return f", {value:.0f}{unit}" if np.isfinite(value) else ""


def plotted(history: History, seconds: float) -> tuple[np.ndarray, ...]:
    """For the plots: seconds before the newest snapshot, total force in newton, number of contacts;
    each of shape (m,)."""
    last = round(30 * seconds)
    stamps = history.values("stamp_ns", last)
    keep = stamps > stamps[-1] - round(1e9 * seconds)
    wrench = history.values("wrench", last)[keep]
    force = np.sqrt((wrench[:, :3] ** 2).sum(axis=1))
    contacts = history.values("contacts", last)[keep].astype(float)
    return 1e-9 * (stamps[keep] - stamps[-1]), force, contacts
