"""`skin view`: the live view in a browser."""

from __future__ import annotations

import json as json_text
import sys
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from skin.cli import options
from skin.cli.run import check_simulated, note_scene
from skin.cli.table import facts
from skin.io.record import is_recording

if TYPE_CHECKING:
    from skin.state import State
    from skin.view.browser import View

__all__ = ["view"]

LOOK_S = 0.1
"""Between two looks at the process of the view, and at the time, while nothing happens."""
LONGEST_GAP_S = 2.0
"""That a log without cycles is waited for: its time goes on behind a longer gap [assumed]."""
KEPT = 100_000
"""Cycle times of which percentiles are taken."""

LookAt = Annotated[
    str,
    tyro.conf.Positional,
    tyro.conf.arg(
        metavar="FILE", help=f"{options.FILE_HELP}; or a recording; or a log, with --topology"
    ),
]
Of = Annotated[str | None, options.quiet("topology of the log that FILE is", metavar="FILE")]
Simulate = Annotated[bool, options.quiet("show simulated units, on no bus of the file")]
Host = Annotated[
    str, tyro.conf.arg(metavar="HOST", help="address of this machine; others let others in")
]
Port = Annotated[
    int | None,
    options.quiet("port; otherwise the first free one from 8080", metavar="INT", constructor=int),
]


def view(
    file: LookAt,
    /,
    *,
    topology: Of = None,
    map: options.Map = (),
    seconds: options.Until = None,
    interface: options.Interface = None,
    channel: options.Channel = None,
    sync: options.Sync = "host",
    simulate: Simulate = False,
    scene: options.Scene = None,
    seed: options.Seed = None,
    host: Host = "127.0.0.1",
    port: Port = None,
    json: options.Json = False,
) -> int:
    """Show what the skin feels in a browser: loads, forces, contacts, slip, health.

    Prints the address, and serves it until Ctrl-C, or for a time. With `--simulate` a sphere
    presses, slides and lifts all over simulated units, or a scene is played. What `skin record` has
    recorded, or a log, is played as fast as it was.
    Exits with 1 if the process of the view ends, or a recording holds no cycle or is damaged.
    """
    import skin
    from skin.errors import SkinError
    from skin.view import show
    from topology import load

    options.check_seconds(seconds)
    check_simulated(simulate, scene, seed, sync, interface, channel)
    is_recorded = topology is not None or is_recording(file)
    if is_recorded and simulate:
        raise SkinError("--simulate: must be without --topology, and without a recording; got both")
    if is_recorded:
        options.refuse_both("a recording or log", "--interface", interface)
        options.refuse_both("a recording or log", "--channel", channel)
    mapped = options.mapped(map, file if is_recorded else None)
    tally, faults = _Tally(), []
    with ExitStack() as ended:
        if is_recorded:
            source: Any = skin.replay(file, topology, **mapped)
        else:
            loaded = load(file).on(interface=interface, channel=channel)
            source = ended.enter_context(
                skin.open(loaded, sync=sync, simulate=scene or simulate, seed=seed)
            )
            note_scene(source.nodes and source.nodes.scene)
        shown = ended.enter_context(show(source, host=host, port=port))
        print(f"{source.topology.name}: open {shown.address} in a browser; Ctrl-C ends",
              file=sys.stderr, flush=True)  # fmt: skip
        try:
            states = _as_recorded(source, shown, tally, seconds) if is_recorded else iter(source)
            _go_on(states, tally, source, seconds, shown)
            if is_recorded:
                faults = _faults(file, source, tally)
                for fault in faults:
                    print(fault, file=sys.stderr)
            _wait(tally, seconds, shown)
        except KeyboardInterrupt:
            pass
        if not shown.alive:
            if shown.failure is None:
                shown.fail()
            faults.append(str(shown.failure))
        report = tally.report() | {
            "topology": source.topology.name,
            "address": shown.address,
            "snapshots": shown.snapshots.taken,
            "snapshots_missed": shown.snapshots.missed,
            "faults": faults,
        }
    print(json_text.dumps(report) if json else _table(report))
    return 1 if faults else 0


def _faults(file: str, source: Any, tally: _Tally) -> list[str]:
    """What is wrong with what was played."""
    found = list(source.faults)
    if not tally.cycles and not found:
        found.append(f"{file}: must hold cycles of {source.topology.name!r}; got none")
    return found


def _go_on(
    states: Iterator[State], tally: _Tally, source: Any, seconds: float | None, shown: View
) -> None:
    """Let cycle after cycle be seen, from the first one on for `seconds`."""
    timing = getattr(source, "timing", None)
    for _ in states:
        tally.add(0 if timing is None else timing.work_ns)
        if tally.is_over(seconds) or (tally.is_time_to_look() and not shown.alive):
            return


def _wait(tally: _Tally, seconds: float | None, shown: View) -> None:
    """Keep serving what was played, or the end of a scene."""
    while not tally.is_over(seconds) and shown.alive:
        time.sleep(LOOK_S)


def _as_recorded(source: Any, shown: View, tally: _Tally, seconds: float | None) -> Iterator[State]:
    """States, each not before its time, which leaps over long gaps."""
    due_s = before_ns = None
    for state in source:
        now_s = time.monotonic()
        if due_s is None or before_ns is None:
            due_s = now_s
        else:
            due_s += min(max(1e-9 * (state.stamp_ns - before_ns), 0.0), LONGEST_GAP_S)
            due_s = max(due_s, now_s - LONGEST_GAP_S)
        before_ns = state.stamp_ns
        while (left_s := due_s - time.monotonic()) > 0.0:
            if tally.is_over(seconds) or not shown.alive:
                return
            time.sleep(min(left_s, LOOK_S))
        yield state


class _Tally:
    """What is reported at the end."""

    def __init__(self) -> None:
        self._work_us: deque[float] = deque(maxlen=KEPT)
        self._began = self._looked = 0.0
        self.cycles = 0

    def is_over(self, seconds: float | None) -> bool:
        """Whether so long was shown, from the first cycle on, or from when it was first asked."""
        self._began = self._began or time.monotonic()
        return seconds is not None and time.monotonic() - self._began >= seconds

    def is_time_to_look(self) -> bool:
        """Whether `LOOK_S` has passed since it last was."""
        now = time.monotonic()
        if now - self._looked < LOOK_S:
            return False
        self._looked = now
        return True

    def add(self, work_ns: int) -> None:
        """Note a cycle."""
        self._began = self._began or time.monotonic()
        self.cycles += 1
        self._work_us.append(1e-3 * work_ns)

    def report(self) -> dict[str, Any]:
        p50, p99 = np.percentile(self._work_us, [50, 99]) if self._work_us else (0.0, 0.0)
        return {"cycles": self.cycles, "cycle_us_p50": float(p50), "cycle_us_p99": float(p99)}


def _table(report: dict[str, Any]) -> str:
    rows = {
        "cycles": "{cycles}",
        "snapshots": "{snapshots}, {snapshots_missed} missed",
        "frames to contacts": "{cycle_us_p50:.1f} µs p50, {cycle_us_p99:.1f} µs p99",
    }
    return facts(rows, report)
