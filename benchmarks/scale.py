"""Live skins from 64 to 1600 units: SYNC to contacts, late periods, lost frames.

The product's own live loop, `skin.open` with what it does if not told otherwise (contacts, slip,
ambient field, one sweep of cross-talk), on as many buses as the check of a topology asks for, while
three contacts press and drag. A process of its own plays the units, each frame when the wire would
bring it, over datagram sockets of the loopback interface, read by the same system calls as those of
CAN. Host and units have a processor each, where this process may use two; `pinned` says whether.

**Judged.** The units' process stamps each system call by which frames leave. A cycle is judged if
all of its frames had left within a frame's time on the wire after they were due (a frame of another
board delays them as much), and those of the cycle asked for before it as well, since a host treats
units that were late otherwise. A period whose SYNC the host left out is judged as the cycle after
it. So no figure has anything in it that the units' process failed to send; `not_judged_share` is
the rest, in which the host may be late or not.

**Figures** of judged periods. `latency_ms`: from the first SYNC, as the kernel stamped its arrival
at the units, until `next(states)` had returned the state with its contacts. `after_last_ms`: the
same from the moment at which the last frames left. `late`: share of periods left out, closed
without all units, or whose state came after the next SYNC was due; the interval takes periods as
independent, but late ones come in spells, and so it is too narrow. `lost`: frames whose
temperatures no state shows (neither counters nor flags of the receiver are asked); those of a
period that was left out are lost as well. `cpu_share`: user and system time of the receiving
process for a cycle, over the period: cycles left out make it no smaller.
"""

from __future__ import annotations

import multiprocessing
import os
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import skin as product
from benchmarks.intervals import rate
from benchmarks.scale_units import (
    LAP,
    Units,
    frame_ns,
    on_fewest_buses,
    play,
    simulate,
)
from bus.cycle import ClosedBy
from bus.datagram import DatagramTransport
from bus.transport import Transport
from skin.decode.decoder import Decoder
from topology import Topology

SKINS = {"64": (8, 8), "256": (32, 8), "1260": (126, 10), "1600": (160, 10)}
"""Rows and columns."""
RATE_HZ = 250.0
CYCLES = {False: (256, 3000), True: (64, 150)}
"""Cycles before those that are measured, and these; by `quick`."""
SAME_C = 1e-3
"""°C within which a temperature is the one that was sent; the noise is 0.05 °C."""
SEEN = np.dtype(
    [
        ("cycle", np.int64),
        ("at_ns", np.int64),  # when the user had the state, by the system's clock
        ("shown", np.int64),  # frames whose values the state shows
        ("contacts", np.int64),
        ("complete", np.int64),
    ]
)
"""What was seen of a cycle."""


class Judged(NamedTuple):
    """Periods from the first state to the last.

    Attributes
    ----------
    judged, late : ndarray, shape (p,), bool
    lost : ndarray, shape (p,), int
        Frames that no state shows.
    latency_ns, after_last_ns : ndarray, shape (k,), int
        Of the k states.
    states : ndarray, shape (k,), bool
        Whether their cycles are judged.
    """

    judged: np.ndarray
    late: np.ndarray
    lost: np.ndarray
    latency_ns: np.ndarray
    after_last_ns: np.ndarray
    states: np.ndarray


def run(quick: bool) -> dict[str, Any]:
    """Measure; see the head of this file for what the figures are."""
    cases: dict[str, Any] = {}
    with _apart() as processors:
        for name, shape in SKINS.items():
            skin = on_fewest_buses(*shape, RATE_HZ)
            row = measure(skin, simulate(skin), *CYCLES[quick], processors)
            cases[name] = {"units": skin.n, "buses": len(skin.buses), "ways": {"sockets": row}}
    rows = [case["ways"]["sockets"] for case in cases.values()]
    periods, judged = (sum(row[key] for row in rows) for key in ("periods", "judged"))
    return {
        "pinned": processors is not None,
        "lost_frames": sum(row["lost"] for row in rows),
        "not_judged_share": 1.0 - judged / periods,
        "cases": cases,
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [
        "host and units have a processor each"
        if figures["pinned"]
        else "host and units share a processor: they delay each other, and these figures do not "
        "tell what the host does alone",
        f"{'units':>6}{'buses':>6}{'judged':>8}{'of':>7}{'lost':>6}{'late':>6}{'95 % interval':>18}"
        f"{'cpu %':>6}{'SYNC to contact ms p50':>23}{'p99':>7}{'p99.9':>7}{'max':>7}"
        f"{'after last frame ms p50':>24}{'p99':>7}{'p99.9':>7}{'max':>7}",
    ]
    for case in figures["cases"].values():
        row = case["ways"]["sockets"]
        late = row["late"]
        ends = f"{_text(late['lower'], '.2%')} to {_text(late['upper'], '.2%')}"
        lines.append(
            f"{case['units']:>6}{case['buses']:>6}{row['judged']:>8}{row['periods']:>7}"
            f"{row['lost']:>6}{row['late_periods']:>6}{ends:>18}{100 * row['cpu_share']:>6.1f}"
            + _texts(row["latency_ms"], 23)
            + _texts(row["after_last_ms"], 24)
        )
    lines.append(f"not judged, as units sent late: {figures['not_judged_share']:.1%}")
    return "\n".join(lines)


def _texts(spread: dict[str, float | None], width: int) -> str:
    p50, *others = (_text(spread[key], ".2f") for key in ("p50", "p99", "p999", "max"))
    return f"{p50:>{width}}" + "".join(f"{other:>7}" for other in others)


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def measure(
    skin: Topology, units: Units, warm: int, cycles: int,
    processors: tuple[int, int] | None,
) -> dict[str, Any]:  # fmt: skip
    """Run the live loop.

    Parameters
    ----------
    skin : Topology
    units : Units
    warm, cycles : int
        States before those that are measured, and these.
    processors : (int, int) or None
        Of the host and of the units.
    """
    with _over_sockets(skin, units, processors) as (ends, told):
        with product.Skin(product.Pipeline(skin), ends) as live:
            if not told.poll(60.0):
                raise RuntimeError("the units' process must be ready within 60 s; it was not")
            told.recv()
            seen, cpu_ns = watch(live, units, warm, cycles)
            told.send(None)
            played = told.recv()
    period_ns = 1e9 / skin.cycle_rate_hz
    found = judge(seen, played, len(skin.frames), period_ns, frame_ns(skin))
    return {
        "periods": found.judged.size,
        "judged": int(found.judged.sum()),
        "late_periods": int(found.late.sum()),
        "late": _rate(int(found.late.sum()), int(found.judged.sum())),
        "left_out": rate(found.judged.size - cycles, found.judged.size),
        "lost": int(found.lost.sum()),
        "cpu_share": cpu_ns / (cycles * period_ns),
        "latency_ms": _spread(1e-6 * found.latency_ns[found.states]),
        "after_last_ms": _spread(1e-6 * found.after_last_ns[found.states]),
    }


def judge(
    seen: np.ndarray, played: np.ndarray, frames: int, period_ns: float, tolerance_ns: int
) -> Judged:
    """Which periods are judged, and what became of them; see the head of this file.

    Parameters
    ----------
    seen : ndarray, shape (k,), SEEN
    played : ndarray, shape (m,), PLAYED
        By cycle, from the first SYNC on.
    frames : int
        Of a cycle.
    period_ns : float
    tolerance_ns : int
        Time after it is due in which a frame may leave.
    """
    number = seen["cycle"]
    asked = np.flatnonzero(played["sync_ns"])
    punctual = played["late_ns"][asked] <= tolerance_ns
    punctual[1:] &= punctual[:-1].copy()
    periods = np.arange(number[0], number[-1] + 1)
    judged = punctual[np.searchsorted(asked, periods)]
    of_state = number - number[0]
    shown, in_time = np.zeros(periods.size, np.int64), np.zeros(periods.size, bool)
    latency_ns = seen["at_ns"] - played["sync_ns"][number]
    shown[of_state] = seen["shown"]
    in_time[of_state] = (seen["complete"] > 0) & (latency_ns <= period_ns)
    return Judged(
        judged,
        judged & ~in_time,
        np.where(judged, frames - shown, 0),
        latency_ns,
        seen["at_ns"] - played["left_ns"][number],
        judged[of_state],
    )


def watch(live: product.Skin, units: Units, warm: int, cycles: int) -> tuple[np.ndarray, int]:
    """Go through the cycles of a live skin.

    Returns
    -------
    ndarray, shape (cycles,), SEEN
    int
        Processor time of this process for them, ns.
    """
    skin, states = live.topology, iter(live)
    for _ in range(warm):
        next(states)
    seen = np.full(cycles, 0, SEEN)
    temperature = np.full((cycles, skin.n), np.nan, np.float32)  # written now: no page faults later
    cpu_ns = time.process_time_ns()
    for i in range(cycles):
        state = next(states)
        complete = state.closed_by is ClosedBy.COMPLETE
        seen[i] = state.cycle, time.time_ns(), 0, len(state.contacts), complete
        temperature[i] = state.units.temperature
    cpu_ns = time.process_time_ns() - cpu_ns
    seen["shown"] = shown(skin, units, seen["cycle"], temperature)
    return seen, cpu_ns


def shown(skin: Topology, units: Units, cycle: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    """Frames whose values stand in temperatures of shape (k, n); shape (k,)."""
    expected = Decoder(skin, {"temperature"})(units.counts).temperature
    same = np.abs(temperature - expected[cycle % LAP]) < SAME_C  # not where NaN
    # a frame's places without a unit, -1, count as shown
    padded = np.concatenate([same, np.ones((same.shape[0], 1), bool)], axis=1)
    return padded[:, skin.frames.units].all(axis=-1).sum(axis=-1)


def _rate(hits: int, trials: int) -> dict[str, Any]:
    return rate(hits, trials) or dict.fromkeys(("rate", "lower", "upper")) | {"trials": 0}


def _spread(values: np.ndarray) -> dict[str, float | None]:
    if not values.size:
        return dict.fromkeys(("p50", "p99", "p999", "max"))
    p50, p99, p999 = (float(np.percentile(values, share)) for share in (50.0, 99.0, 99.9))
    return {"p50": p50, "p99": p99, "p999": p999, "max": float(values.max())}


@contextmanager
def _apart() -> Iterator[tuple[int, int] | None]:
    """A processor for this thread and one for the units, not of one core where there are others;
    None where this process may use only one. Interrupts go to the first by default."""
    may = os.sched_getaffinity(0)
    host = max(may)
    sides = Path(f"/sys/devices/system/cpu/cpu{host}/topology/thread_siblings_list")
    beside = sides.read_text("ascii").strip() if sides.exists() else ""
    same = {int(end) for part in beside.split(",") for end in part.split("-") if end}
    others = (may - same) or (may - {host})
    if not others:
        yield None
        return
    os.sched_setaffinity(0, {host})
    try:
        yield host, max(others)
    finally:
        os.sched_setaffinity(0, may)


@contextmanager
def _over_sockets(
    skin: Topology, units: Units, processors: tuple[int, int] | None
) -> Iterator[tuple[list[Transport], Any]]:
    """The host's ends of the buses, and the pipe to the units' process."""
    far, *socks = (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(1 + len(units.frames))
    )
    for sock in (far, *socks):
        sock.bind(("127.0.0.1", 0))
    for sock in socks:
        sock.connect(far.getsockname())
    context = multiprocessing.get_context("spawn")
    told, teller = context.Pipe()
    ports = [sock.getsockname()[1] for sock in socks]
    given = skin, units.frames, ports, far, processors and processors[1], teller
    player = context.Process(target=play, args=given, daemon=True)
    with ExitStack() as stack:
        ends: list[Transport] = [
            stack.enter_context(DatagramTransport(sock, f"bus{i}", i))
            for i, sock in enumerate(socks)
        ]
        player.start()
        teller.close()
        far.close()
        stack.callback(player.join, 10.0)
        stack.callback(player.terminate)
        yield ends, told
