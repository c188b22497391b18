"""Findings: differences between received and expected traffic, with the likely cause, as text.

Each rule checks one thing. A cause explains its consequences: on a silent bus no unit is reported
as missing, and a silent branch is one finding for all of its units. Of many findings of one kind
the first few are reported and the others counted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from bus.diagnose_bus import LONG_SILENCE, BusRules, Finding, other_serials, some
from bus.discover import Survey
from bus.state import BusState
from bus.status import Status
from bus.transport import Transport

__all__ = ["MOST_REPORTED", "Finding", "diagnose", "swapped_buses"]

MOST_REPORTED = 8
"""Findings of one kind that are reported one by one."""


def diagnose(survey: Survey, transports: Sequence[Transport] = ()) -> list[Finding]:
    """Findings of a survey, errors first.

    Parameters
    ----------
    survey : Survey
    transports : sequence of Transport
        Those of the survey, for their own counters.
    """
    found = list(_of_transports(survey, transports))
    instead = swapped_buses(survey)
    found += _of_swapped(survey, instead)
    for b in range(len(survey.topology.buses)):
        found += BusRules(survey, b, instead.get(b)).findings()
    found += _of_units(survey)
    found += other_serials(survey)
    found = [finding for code in dict.fromkeys(f.code for f in found)
             for finding in _few([f for f in found if f.code == code])]  # fmt: skip
    return sorted(found, key=lambda finding: finding.severity)


def _few(findings: list[Finding]) -> Iterator[Finding]:
    """The first findings of one kind, and the number of further ones."""
    if len(findings) <= MOST_REPORTED:
        yield from findings
        return
    yield from findings[: MOST_REPORTED - 1]
    rest = findings[MOST_REPORTED - 1 :]
    count = sum(finding.count for finding in rest)
    yield Finding(rest[0].code, rest[0].severity, f"{len(rest)} more", count,
                  f"the same as above, {count} in all", rest[0].likely_cause)  # fmt: skip


def swapped_buses(survey: Survey) -> dict[int, int]:
    """Buses that receive each other's units, each with the other one.

    By identifiers: at least half of those that only the other bus has are received, and none that
    only this bus has. Buses with the same identifiers cannot be distinguished.
    """
    frames, buses = survey.topology.frames, range(len(survey.topology.buses))
    expected = [set(frames.can_id[frames.bus == b].tolist()) for b in buses]
    heard = [{kind.can_id for kind in survey.heard if kind.bus == b} for b in buses]

    def hears(here: int, there: int) -> bool:
        strange, own = expected[there] - expected[here], expected[here] - expected[there]
        return 2 * len(strange & heard[here]) >= len(strange) > 0 and not own & heard[here]

    return {a: b for a in buses for b in buses if hears(a, b) and hears(b, a)}


def _of_swapped(survey: Survey, instead: dict[int, int]) -> Iterator[Finding]:
    frames = survey.topology.frames
    for here, there in instead.items():
        if here < there:
            one, other = (f"{survey.topology.buses[b].name!r}" for b in (here, there))
            carried = frames.units[np.isin(frames.bus, (here, there))]
            yield Finding(
                "swapped-buses", "error", f"buses {one} and {other}", int((carried >= 0).sum()),
                "are swapped: each hears the units of the other",
                "their plugs; else `channel` of the buses in the file",
            )  # fmt: skip


def _of_units(survey: Survey) -> Iterator[Finding]:
    """Flags of units."""
    names = survey.topology.unit_names
    cases: tuple[tuple[Status, str, str, str], ...] = (
        (Status.DUPLICATE, "duplicate-id", "two senders with one identifier, by their sequence "
         "numbers and bytes", "two units set to the same address"),
        (Status.FROZEN, "frozen", "counts are constant, although noise is expected",
         "a stuck converter or sensor chip behind a live controller"),
        (Status.FAULT, "unit-fault", "the unit reports a fault of its own",
         "see the unit's manual for the code"),
    )  # fmt: skip
    for flag, code, text, cause in cases:
        cycles = survey.flagged[flag]
        for unit in np.flatnonzero(cycles):
            fault = f" (code {survey.fault_code[unit]})" if flag is Status.FAULT else ""
            yield Finding(code, "error", names[unit], int(cycles[unit]),
                          f"{text}{fault}, in {cycles[unit]} of {survey.cycles} cycles",
                          cause)  # fmt: skip
    for unit in np.flatnonzero(survey.longest_age >= LONG_SILENCE):
        silent_s = survey.longest_age[unit] / survey.topology.cycle_rate_hz
        yield Finding(
            "intermittent", "error", names[unit], int(survey.longest_age[unit]),
            f"was silent for up to {silent_s:.1f} s and came back",
            "a loose plug, or a supply that breaks down and resets the unit",
        )  # fmt: skip


def _of_transports(survey: Survey, transports: Iterable[Transport]) -> Iterator[Finding]:
    """Findings of the transports themselves."""
    if survey.closed:
        yield Finding(
            "closed", "error", "host", 1, f"listening ended early: {survey.closed}",
            "an adapter that was unplugged, or an interface that was taken down",
        )  # fmt: skip
    overflows = survey.counters.controller_overflow
    for transport in transports:
        name = f"bus {survey.topology.buses[transport.index].name!r}"
        counters = transport.counters
        if counters.queue_drops or counters.ring_overflows:
            count = counters.queue_drops + counters.ring_overflows
            yield Finding(
                "host-overflow", "error", name, count,
                f"this host lost {counters.queue_drops} frames in the interface's receive queue "
                f"and {counters.ring_overflows} in its own",
                "another program keeps this host busy, or the receive buffer is too small "
                "(sysctl net.core.rmem_max)",
            )  # fmt: skip
        if transport.state is not BusState.ACTIVE:
            reason = f" ({transport.changes[-1].reason})" if transport.changes else ""
            yield Finding(
                "bus-state", "error", name, counters.state_changes,
                f"the interface ends in the state {transport.state}{reason}",
                "wiring, termination or bit rate; after bus-off: ip link set CHANNEL type can "
                "restart-ms 100",
            )  # fmt: skip
    if overflows:
        yield Finding(
            "controller-overflow", "error", "host", overflows,
            f"the CAN controller's own receive queue was full {some(overflows, 'time')}",
            "interrupts served too late: a busy CPU, a slow SPI or USB adapter, or one without "
            "enough buffers",
        )  # fmt: skip
