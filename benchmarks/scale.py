"""Live skins from 64 to 1600 units: SYNC to contacts, late periods, and what made the tail.

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
independent, but late ones come in spells, and so it is too narrow where `spells` are fewer. `lost`:
frames whose temperatures no state shows (neither counters nor flags of the receiver are asked);
those of a period that was left out are lost as well. `cpu_share`: user and system time of the
receiving process for a cycle, over the period: cycles left out make it no smaller. `undisturbed`
has the times of those judged cycles in which the loop's thread neither waited for its processor nor
was switched off it, by the kernel's count: on a busy machine these alone are the host's own, if a
little too short, since a long cycle is more easily disturbed.

**Tail.** Of the cycles beyond p99 and p99.9 and of all others, how many had in them, from one state
to the next: a run of the garbage collector, a page fault, a log record, a switch to another process
in the midst of work (all of the loop's thread, as the kernel counts them); and how many waited for
their processor, or worked, for half or more of what they took longer than the median. `none` had
none of these: the host slept longer than it had asked for, or the hypervisor held the machine.

What is left in the product: the cycle in which zeros are applied (7 ms of processor time at 1600
units, once in the first seconds, of which the wire hides up to 3; and again when a pressed unit is
let go), and in those seconds a page fault in one of sixteen cycles and a young collection in one of
170. Afterwards there are no faults, collections and log records (`tests/skin/test_quiet.py`), but
for what the user's own code makes.

Beside it what is published of another skin of 1260 cells; that machine and work are not these.
"""

from __future__ import annotations

import gc
import logging
import multiprocessing
import os
import resource
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import skin as product
from benchmarks.scale_units import (
    LAP,
    Units,
    frame_ns,
    most_rows,
    on_fewest_buses,
    play,
    simulate,
)
from benchmarks.slip_intervals import rate
from bus.cycle import ClosedBy
from bus.datagram import DatagramTransport
from bus.transport import Transport
from skin.decode.decoder import Decoder
from topology import Topology

SKINS = {"64": (8, 8), "256": (32, 8), "1260": (126, 10), "1600": (160, 10)}
"""Rows and columns."""
RATE_HZ = 250.0
FAST = "4 buses, 1 kHz"
FAST_RATE_HZ, FAST_BUSES, FAST_COLUMNS = 1000.0, 4, 5
CYCLES = {False: (256, 3000), True: (64, 150)}
"""Cycles before those that are measured, and these; by `quick`."""
SAME_C = 1e-3
"""°C within which a temperature is the one that was sent; the noise is 0.05 °C."""
TARGET_SHARE = 0.5
WAYS = ("sockets",)
CAUSES = ("collector", "page fault", "log", "switch", "wait", "work")
PUBLISHED = (
    "TUM H1, 1260 cells at 250 Hz (315 000 packets/s): 2.7 cores and a quarter of the packets "
    "lost, clock-driven; 40 000 packets/s and 1.0 core, event-driven "
    "(Bergner, Dean-Leon, Guadarrama-Olvera, Cheng: Evaluation of a large scale event driven "
    "robot skin, IEEE Robotics and Automation Letters 4 (2019))"
)
WAIT_NS = 50_000
"""Time that a wake-up may take of an idle processor [derived: the kernel's timer slack]."""
SEEN = np.dtype(
    [
        ("cycle", np.int64),
        ("at_ns", np.int64),  # when the user had the state, by the system's clock
        ("work_ns", np.int64),  # time of the host's own work on the frames that closed the cycle
        ("shown", np.int64),  # frames whose values the state shows
        ("contacts", np.int64),
        ("complete", np.int64),
        # running totals of the loop's thread
        ("collector", np.int64),
        ("page fault", np.int64),
        ("log", np.int64),
        ("switch", np.int64),
        ("wait", np.int64),  # nanoseconds in which it was ready to run and had no processor
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
    skins = {name: on_fewest_buses(*shape, RATE_HZ) for name, shape in SKINS.items()}
    if not quick:
        skins[FAST] = most_rows(FAST_COLUMNS, FAST_BUSES, FAST_RATE_HZ)
    with _apart() as processors:
        for name, units_of in skins.items():
            units = simulate(units_of)
            cases[name] = {
                "units": units_of.n,
                "buses": len(units_of.buses),
                "rate_hz": units_of.cycle_rate_hz,
                "frames_per_s": len(units_of.frames) * units_of.cycle_rate_hz,
                "ways": {
                    way: measure(units_of, units, way, *CYCLES[quick], processors) for way in WAYS
                },
            }
    rows = [cases[name]["ways"]["sockets"] for name in SKINS]
    periods, judged = (sum(row[key] for row in rows) for key in ("periods", "judged"))
    return {
        "pinned": processors is not None,
        "lost_frames": sum(row["lost"] for row in rows),
        "not_judged_share": 1.0 - judged / periods,
        "late": _rate(sum(row["late_periods"] for row in rows), judged),
        "target_cpu_share": TARGET_SHARE,
        "published": PUBLISHED,
        "cases": cases,
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [
        "host and units have a processor each"
        if figures["pinned"]
        else "host and units share a processor: they delay each other, and these figures do not "
        "tell what the host does alone",
        f"{'units':>6}{'buses':>6}{'Hz':>6}{'frames/s':>9} {'way':<9}{'judged':>7}{'of':>7}"
        f"{'lost':>6}{'late':>6}{'95 % interval':>18}{'cpu %':>6}"
        f"{'SYNC to contact ms p50':>23}{'p99':>7}{'p99.9':>7}{'max':>7}"
        f"{'after last frame ms p50':>24}{'p99':>7}{'p99.9':>7}{'max':>7}{'work us p50':>12}",
    ]
    named, quiet = (*CAUSES, "none"), []
    tails = [f"{'units':>6} {'way':<9}{'cycles':<16}" + "".join(f"{c:>11}" for c in named)]
    for case in figures["cases"].values():
        for way, row in case["ways"].items():
            late = row["late"]
            ends = f"{_text(late['lower'], '.2%')} to {_text(late['upper'], '.2%')}"
            lines.append(
                f"{case['units']:>6}{case['buses']:>6}{case['rate_hz']:>6.0f}"
                f"{case['frames_per_s']:>9.0f} {way:<9}{row['judged']:>7}{row['periods']:>7}"
                f"{row['lost']:>6}{row['late_periods']:>6}{ends:>18}{100 * row['cpu_share']:>6.1f}"
                + _texts(row["latency_ms"], 23)
                + _texts(row["after_last_ms"], 24)
                + f"{_text(row['work_us']['p50'], '.0f'):>12}"
            )
            alone = row["undisturbed"]
            quiet.append(
                f"{case['units']:>6} {way:<9}{alone['cycles']:>6} of {row['judged']:<6}"
                + _texts(alone["latency_ms"], 23)
                + _texts(alone["after_last_ms"], 24)
            )
            tails += [
                f"{case['units']:>6} {way:<9}{name:<9}{tail['cycles']:>6} "
                + "".join(f"{tail[cause]:>11}" for cause in named)
                for name, tail in row["tail"].items()
            ]
    late = figures["late"]
    share = figures["cases"]["1260"]["ways"]["sockets"]["cpu_share"]
    return "\n".join([
        *lines,
        "the same times of the judged cycles in which no other process had the host's processor:",
        *quiet,
        "what was in the cycles beyond p99, beyond p99.9, and in all others:",
        *tails,
        f"sockets at {RATE_HZ:g} Hz: {figures['lost_frames']} frames lost (target 0); late: "
        f"{_text(late['rate'], '.2%')} ({_text(late['lower'], '.2%')} to "
        f"{_text(late['upper'], '.2%')}) of judged periods; not judged, as units sent late: "
        f"{figures['not_judged_share']:.1%}; 1260 units: {share:.0%} of a core (target "
        f"{figures['target_cpu_share']:.0%})",
        f"published: {figures['published']}",
    ])  # fmt: skip


def _texts(spread: dict[str, float | None], width: int) -> str:
    p50, *others = (_text(spread[key], ".2f") for key in ("p50", "p99", "p999", "max"))
    return f"{p50:>{width}}" + "".join(f"{other:>7}" for other in others)


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def measure(
    skin: Topology, units: Units, way: str, warm: int, cycles: int,
    processors: tuple[int, int] | None,
) -> dict[str, Any]:  # fmt: skip
    """Run the live loop.

    Parameters
    ----------
    skin : Topology
    units : Units
    way : str
        Of `WAYS`.
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
    alone = found.states & undisturbed(seen)
    spells = np.diff(found.late.astype(int), prepend=0) > 0
    return {
        "cycles": cycles,
        "periods": found.judged.size,
        "judged": int(found.judged.sum()),
        "not_judged_share": 1.0 - float(found.judged.mean()),
        "late_periods": int(found.late.sum()),
        "late": _rate(int(found.late.sum()), int(found.judged.sum())),
        "spells": int(spells.sum()),
        "left_out": rate(found.judged.size - cycles, found.judged.size),
        "lost": int(found.lost.sum()),
        "contacts": int(np.median(seen["contacts"])),
        "cpu_share": cpu_ns / (cycles * period_ns),
        "latency_ms": _spread(1e-6 * found.latency_ns[found.states]),
        "after_last_ms": _spread(1e-6 * found.after_last_ns[found.states]),
        "work_us": _spread(1e-3 * seen["work_ns"][found.states]),
        "undisturbed": {
            "cycles": int(alone.sum()),
            "latency_ms": _spread(1e-6 * found.latency_ns[alone]),
            "after_last_ms": _spread(1e-6 * found.after_last_ns[alone]),
        },
        "tail": tail(seen, found),
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


def undisturbed(seen: np.ndarray) -> np.ndarray:
    """Cycles in which no other process had the host's processor, shape (k,), bool."""
    waited, switched = (np.diff(seen[name]) for name in ("wait", "switch"))
    return np.append(False, (waited < WAIT_NS) & (switched == 0))


def tail(seen: np.ndarray, found: Judged) -> dict[str, dict[str, int]]:
    """How many of the cycles beyond p99, beyond p99.9 and of all others had what in them."""
    judged = np.flatnonzero(found.states[1:]) + 1  # the first has no totals before it
    took = found.latency_ns[judged]
    if not took.size:
        return {}
    longer = took - np.median(took)
    had = {cause: np.diff(seen[cause])[judged - 1] for cause in CAUSES[:-1]}
    work_ns = seen["work_ns"][judged]
    had["work"] = work_ns - np.median(work_ns)
    met = {
        cause: 2 * value >= np.maximum(longer, 1) if cause in ("wait", "work") else value > 0
        for cause, value in had.items()
    }
    met["none"] = ~np.any(list(met.values()), axis=0)
    p99, p999 = (np.percentile(took, share) for share in (99.0, 99.9))
    groups = {"p99": took > p99, "p99.9": took > p999, "others": took <= p99}
    return {
        name: {"cycles": int(group.sum()), **{c: int(v[group].sum()) for c, v in met.items()}}
        for name, group in groups.items()
    }


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
    with _Totals() as totals:
        cpu_ns = time.process_time_ns()
        for i in range(cycles):
            state = next(states)
            at_ns = time.time_ns()
            seen[i] = (
                state.cycle, at_ns, live.timing.work_ns, 0, len(state.contacts),
                state.closed_by is ClosedBy.COMPLETE, *totals(),
            )  # fmt: skip
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


class _Totals(logging.Handler):
    """Running totals of what may hold up this thread, as in `SEEN`."""

    def __init__(self) -> None:
        super().__init__()
        self._collected = self._logged = 0
        self._waits = os.open("/proc/thread-self/schedstat", os.O_RDONLY)

    def __call__(self) -> tuple[int, int, int, int, int]:
        """Collections, page faults, log records, switches, and nanoseconds of waiting."""
        used = resource.getrusage(resource.RUSAGE_THREAD)
        waited_ns = int(os.pread(self._waits, 64, 0).split()[1])
        faults = used.ru_minflt + used.ru_majflt
        return self._collected, faults, self._logged, used.ru_nivcsw, waited_ns

    def emit(self, record: logging.LogRecord) -> None:
        """Count a log record that a user would see."""
        self._logged += 1

    def _collects(self, phase: str, _: dict[str, int]) -> None:
        self._collected += phase == "start"

    def __enter__(self) -> _Totals:
        gc.callbacks.append(self._collects)
        logging.getLogger().addHandler(self)
        return self

    def __exit__(self, *exc: object) -> None:
        logging.getLogger().removeHandler(self)
        gc.callbacks.remove(self._collects)
        os.close(self._waits)


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
