"""Findings: where what is heard differs from what is expected, and the likely cause, in words.

Each rule looks at one thing. A cause explains what follows from it: on a bus where nobody is heard
no unit is called missing, and a branch that is silent is one finding, however many units hang on
it. Of many findings of one kind the first few are told and the others counted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from bus.diagnose_boards import same_serials
from bus.diagnose_bus import LONG_SILENCE, BusRules
from bus.discover import Survey
from bus.finding import Finding, some
from bus.state import BusState
from bus.status import Status
from bus.transport import Transport

__all__ = ["TOLD", "Finding", "diagnose", "swapped_buses"]

TOLD = 8
"""Findings of one kind that are told one by one."""


def diagnose(survey: Survey, transports: Sequence[Transport] = ()) -> list[Finding]:
    """What a survey has found, errors first.

    Parameters
    ----------
    survey : Survey
    transports : sequence of Transport
        Those that were listened to, for what they have counted themselves.
    """
    found = list(_of_transports(survey, transports))
    instead = swapped_buses(survey)
    found += _of_swapped(survey, instead)
    for b in range(len(survey.topology.buses)):
        found += BusRules(survey, b, instead.get(b)).findings()
    found += _of_units(survey)
    found += same_serials(survey)
    found = [finding for code in dict.fromkeys(f.code for f in found)
             for finding in _few([f for f in found if f.code == code])]  # fmt: skip
    return sorted(found, key=lambda finding: finding.severity)


def _few(findings: list[Finding]) -> Iterator[Finding]:
    """The first findings of one kind, and how many more there are."""
    if len(findings) <= TOLD:
        yield from findings
        return
    yield from findings[: TOLD - 1]
    rest = findings[TOLD - 1 :]
    count = sum(finding.count for finding in rest)
    yield Finding(rest[0].code, rest[0].severity, f"{len(rest)} more", count,
                  f"the same as above, {count} in all", rest[0].likely_cause)  # fmt: skip


def swapped_buses(survey: Survey) -> dict[int, int]:
    """Buses that hear each other's units, and whose each one hears.

    Identifiers tell: of those that another bus has and this one has not, at least half are heard,
    and none that is this bus's alone. Buses with the same identifiers cannot be told apart.
    """
    skin, frames = survey.topology, survey.topology.frames
    buses = range(len(skin.buses))
    expected = [set(frames.can_id[frames.bus == b].tolist()) for b in buses]
    heard = [{kind.can_id for kind in survey.heard if kind.bus == b} for b in buses]
    instead = {}
    for here in buses:
        for there in buses:
            strange = expected[there] - expected[here]
            if 2 * len(strange & heard[here]) >= len(strange) > 0 and not (
                (expected[here] - expected[there]) & heard[here]
            ):
                instead[here] = there
    # A round of buses in which each one's units are somewhere; not one that hears two others.
    while instead.keys() != set(instead.values()):
        instead = {
            here: there
            for here, there in instead.items()
            if here in instead.values() and there in instead
        }
    return instead


def _of_swapped(survey: Survey, instead: dict[int, int]) -> Iterator[Finding]:
    buses = survey.topology.buses
    left = sorted(instead)
    while left:
        circle = [left[0]]
        while instead[circle[-1]] != circle[0]:
            circle.append(instead[circle[-1]])
        left = [b for b in left if b not in circle]
        names = " and ".join(f"{buses[b].name!r}" for b in circle)
        whose = ", ".join(
            f"{buses[b].name!r} hears the units of {buses[instead[b]].name!r}" for b in circle
        )
        carried = survey.topology.frames.units[np.isin(survey.topology.frames.bus, circle)]
        yield Finding(
            "swapped-buses", "error", f"buses {names}", int((carried >= 0).sum()),
            f"are {'swapped' if len(circle) == 2 else 'mixed up'}: {whose}",
            "their plugs; else `channel` of the buses in the file",
        )  # fmt: skip


def _of_units(survey: Survey) -> Iterator[Finding]:
    """What units are flagged with."""
    names = survey.topology.unit_names
    cases: tuple[tuple[Status, str, str, str], ...] = (
        (Status.DUPLICATE, "duplicate-id", "two senders with one identifier, by their sequence "
         "numbers and bytes", "two units set to the same address"),
        (Status.FROZEN, "frozen", "counts stand still, bit by bit, though noise is due",
         "a stuck converter or sensor chip behind a live controller"),
        (Status.FAULT, "unit-fault", "the unit reports a fault of its own",
         "see the unit's manual for the code"),
    )  # fmt: skip
    for flag, code, text, cause in cases:
        cycles = survey.flagged[flag]
        for unit in np.flatnonzero(cycles):
            told = f" (code {survey.fault_code[unit]})" if flag is Status.FAULT else ""
            yield Finding(code, "error", names[unit], int(cycles[unit]),
                          f"{text}{told}, in {cycles[unit]} of {survey.cycles} cycles",
                          cause)  # fmt: skip
    for unit in np.flatnonzero(survey.longest_age >= LONG_SILENCE):
        silent_s = survey.longest_age[unit] / survey.topology.cycle_rate_hz
        yield Finding(
            "intermittent", "error", names[unit], int(survey.longest_age[unit]),
            f"was silent for up to {silent_s:.1f} s and came back",
            "a loose plug, or a supply that breaks down and resets the unit",
        )  # fmt: skip


def _of_transports(survey: Survey, transports: Iterable[Transport]) -> Iterator[Finding]:
    """What the transports know of themselves."""
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
        frames = getattr(transport, "queue_frames", None)
        a_cycle = int(np.count_nonzero(survey.topology.frames.bus == transport.index)) + 1
        if frames is not None and frames < 2 * a_cycle:
            yield Finding(
                "small-buffer", "warning", name, frames,
                f"the receive buffer holds {frames} frames; a cycle has {a_cycle}",
                "a limit of this host: sysctl net.core.rmem_max",
            )  # fmt: skip
    if overflows:
        yield Finding(
            "controller-overflow", "error", "host", overflows,
            f"the CAN controller's own receive queue was full {some(overflows, 'time')}",
            "interrupts served too late: a busy CPU, a slow SPI or USB adapter, or one without "
            "enough buffers",
        )  # fmt: skip
