"""Health of a skin as text: units that are not valid, losses, rates, times."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from enum import IntEnum
from html import escape
from typing import NamedTuple

import numpy as np

from bus.cycle import WRONG_FRAMES
from bus.state import BusState
from skin.io.messages.record import BUS_STATES, COUNTERS
from skin.state import INVALID, Status
from skin.view.colour import is_on

__all__ = ["STYLE", "Health", "Level", "flagged", "row_html"]

REASONS = 4
"""Reasons that are named at the top of the panel."""
LISTED = 12
"""Units that are named; if there are more, their number is given."""
WORKS = 5000
"""Cycles over which working times are evaluated."""
NOTHING = (np.nan, np.nan, np.nan)
RATE_S = 2.0
"""Duration over which rates and losses are evaluated, or more where snapshots come seldom."""
SILENT_S = 1.0
"""Time without a cycle after which a live skin has stopped [assumed: cycles take milliseconds]."""
SLOW, SLOWEST = 0.9, 0.5
"""Shares of the nominal cycle rate below which health is impaired, and poor [assumed]."""
AMBER, RED, GREEN = "#ffb020", "#e5352b", "#2e7d46"


class Level(IntEnum):
    """How healthy a skin is."""

    GOOD = 0
    IMPAIRED = 1
    """Something is missing; the rest is right. Amber."""
    POOR = 2
    """A patch or the whole skin is blind, or far too slow. Red."""


class _Recent(NamedTuple):
    """Counters of a snapshot, for rates."""

    stamp_ns: int
    cycles: int
    frames: int
    wrong: int
    overruns: int


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
    for i in np.flatnonzero((status & int(INVALID) != 0) & is_on(status)).tolist():
        flags = Status(int(status[i])) & INVALID
        why = [str(flag.name).lower() for flag in flags]
        if test_ratio is not None and np.isfinite(test_ratio[i]):
            why.append(f"test ratio {test_ratio[i]:.2f}")
        found.append((names[i], ", ".join(why)))
    return found


class Health:
    """Summary of snapshots.

    Parameters
    ----------
    names : sequence of str
        Of the units.
    nominal_hz : float
        Nominal cycle rate, by the topology.
    patch : ndarray, shape (n,), int, optional
        Patch of each unit, for patches that are blind as a whole; one patch if not given.
    patch_names : sequence of str
    """

    def __init__(
        self,
        names: Sequence[str],
        nominal_hz: float,
        patch: np.ndarray | None = None,
        patch_names: Sequence[str] = ("the skin",),
    ) -> None:
        self._names, self._nominal_hz = names, nominal_hz
        self._patch = np.zeros(len(names), np.intp) if patch is None else patch
        self._patch_names = patch_names
        self._work_us: deque[float] = deque(maxlen=WORKS)
        self._recent: deque[_Recent] = deque()

    def add(self, snapshot: np.void) -> None:
        """Add a snapshot."""
        self._work_us.extend(snapshot["work_us"][: int(snapshot["works"])].tolist())
        counters = dict(zip(COUNTERS, snapshot["counters"].tolist(), strict=True))
        recent, stamp_ns = self._recent, int(snapshot["stamp_ns"])
        if not stamp_ns:
            return
        if recent and stamp_ns <= recent[-1].stamp_ns:  # a clock was set
            recent.clear()
        recent.append(_Recent(
            stamp_ns, int(snapshot["cycles"]), counters["data"],
            sum(counters[name] for name in WRONG_FRAMES), int(snapshot["overruns"]),
        ))  # fmt: skip
        while len(recent) > 2 and stamp_ns - recent[0].stamp_ns > 1e9 * RATE_S:
            recent.popleft()

    def work_us(self) -> tuple[float, float] | None:
        """Median and 99th percentile of a cycle's working time, µs; None where unknown."""
        if not self._work_us:
            return None
        p50, p99 = np.percentile(self._work_us, [50, 99])
        return float(p50), float(p99)

    def rates_hz(self) -> tuple[float, float, float]:
        """Cycles, data frames and snapshots a second; NaN before there are two snapshots."""
        recent = self._recent
        if len(recent) < 2:
            return NOTHING
        first, last = recent[0], recent[-1]
        seconds = 1e-9 * (last.stamp_ns - first.stamp_ns)
        cycles, frames = last.cycles - first.cycles, last.frames - first.frames
        return cycles / seconds, frames / seconds, (len(recent) - 1) / seconds

    def judged(
        self, record: np.void, silent_s: float = 0.0
    ) -> tuple[Level, list[tuple[Level, str]]]:
        """Level of a snapshot, the worst of its reasons, and these.

        Parameters
        ----------
        record : void
            The newest snapshot.
        silent_s : float
            Time since it came, of a live skin; 0 otherwise.
        """
        if record["cycle"] < 0:
            return Level.IMPAIRED, [(Level.IMPAIRED, "no cycle yet")]
        found = []
        if silent_s > SILENT_S:
            found.append((Level.POOR, f"no cycle for {silent_s:.0f} s"))
        found += self._units_judged(record["status"])
        for state in record["bus_states"]:
            if state >= 0 and BUS_STATES[state] != BusState.ACTIVE:
                worst = BUS_STATES[state] in (BusState.BUS_OFF, BusState.DOWN)
                level = Level.POOR if worst else Level.IMPAIRED
                found.append((level, f"a bus is {BUS_STATES[state]}"))
        cycles = self.rates_hz()[0]
        if cycles < SLOW * self._nominal_hz:
            level = Level.POOR if cycles < SLOWEST * self._nominal_hz else Level.IMPAIRED
            found.append((level, f"{cycles:.0f} Hz of {self._nominal_hz:.0f}"))
        if len(self._recent) > 1:
            first, last = self._recent[0], self._recent[-1]
            within = f"in {1e-9 * (last.stamp_ns - first.stamp_ns):.2g} s"
            if wrong := last.wrong - first.wrong:
                found.append((Level.IMPAIRED, f"{wrong} frames lost or wrong {within}"))
            if late := last.overruns - first.overruns:
                found.append((Level.IMPAIRED, f"{late} periods left out {within}"))
        if not record["whole"]:
            found.append((Level.IMPAIRED, "the wrench is not whole"))
        if beyond := int(record["untracked"]):
            found.append((Level.IMPAIRED, f"{beyond} contacts have no identity"))
        return max((level for level, _ in found), default=Level.GOOD), found

    def _units_judged(self, status: np.ndarray) -> list[tuple[Level, str]]:
        """Patches without a valid unit, and the number of invalid units of others."""
        on = is_on(status)
        bad = (status & int(INVALID) != 0) & on
        count = len(self._patch_names)
        of_patch = np.bincount(self._patch[on], minlength=count)
        bad_of_patch = np.bincount(self._patch[bad], minlength=count)
        blind = (of_patch > 0) & (bad_of_patch == of_patch)
        found = [
            (Level.POOR, f"{self._patch_names[at]}: no unit is valid")
            for at in np.flatnonzero(blind).tolist()
        ]
        if rest := int(bad_of_patch[~blind].sum()):
            of = "more" if blind.any() else f"of {np.count_nonzero(on)}"
            found.append((Level.IMPAIRED, f"{rest} {of} units not valid"))
        return found

    def banner_html(self, record: np.void, silent_s: float = 0.0) -> str:
        """The level in its colour, with the reasons."""
        level, found = self.judged(record, silent_s)
        colour, ink = {
            Level.GOOD: (GREEN, "#ffffff"), Level.IMPAIRED: (AMBER, "#14181c"),
            Level.POOR: (RED, "#ffffff"),
        }[level]  # fmt: skip
        order = sorted(found, key=lambda one: -one[0])
        shown = [text for _, text in order[:REASONS]]
        shown += [f"and {len(order) - REASONS} more"] * (len(order) > REASONS)
        text = "; ".join(shown) or "all units valid, nothing lost"
        return (
            f'<div style="margin:0.2em 0.6em 0.7em;padding:0.35em 0.7em;border-radius:4px;'
            f"background:{colour};color:{ink};font-size:0.82em;line-height:1.35;"
            f'font-weight:600">{escape(text)}</div>'
        )

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
            rows.append(("wrench", "not whole: a silent unit may be in contact"))
        if beyond := int(record["untracked"]):
            rows.append(("contacts", f"{beyond} beyond the capacity have no identity"))
        if work is not None:
            rows.append(("cycle time", f"{work[0]:.0f} µs p50, {work[1]:.0f} µs p99"))
        return rows

    def html(self, record: np.void, faults: Sequence[tuple[str, str]] = ()) -> str:
        """The panel; `faults` are those of links, with their names."""
        found = flagged(record["status"], self._names, record["test_ratio"])
        lines = [row_html(name, text) for name, text in self.rows(record)]
        lines += [row_html(name, why, "#78dcf0") for name, why in found[:LISTED]]
        if len(found) > LISTED:
            lines.append(row_html("…", f"and {len(found) - LISTED} more units", "#78dcf0"))
        lines += [row_html(f"link {name}", why, AMBER) for name, why in faults[:LISTED]]
        return f'<div style="{STYLE}">{"".join(lines)}</div>'


STYLE = (
    "display:grid;grid-template-columns:auto 1fr;gap:0.15em 0.8em;padding:0.4em 0.9em;"
    "font-size:0.78em;line-height:1.35"
)


def row_html(name: str, text: str, colour: str = "") -> str:
    """A line of a table: a name, in a colour, and text."""
    colour = colour or "inherit"
    return (
        f'<span style="opacity:0.75;color:{colour}">{escape(name)}</span>'
        f"<span>{escape(text)}</span>"
    )


def _rate(value: float, unit: str) -> str:
    return f", {value:.0f}{unit}" if np.isfinite(value) else ""
