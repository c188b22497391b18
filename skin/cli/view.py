"""`skin view`: the live view in a browser."""

from __future__ import annotations

import json as json_text
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from skin.cli import options
from skin.cli.run import check_simulated, simulated
from skin.cli.table import facts

if TYPE_CHECKING:
    from skin.state import State
    from topology import Topology

__all__ = ["view"]

LookAt = Annotated[
    str,
    tyro.conf.Positional,
    tyro.conf.arg(metavar="FILE", help=f"{options.FILE_HELP}; or a log, with --topology"),
]
Of = Annotated[str | None, options.quiet("topology of the log that FILE is", metavar="FILE")]
Simulate = Annotated[bool, options.quiet("show simulated units, on no bus of the file")]
Export = Annotated[
    Path | None, options.quiet("at the end, write the last 10 s as one page", metavar="FILE.html")
]
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
    seconds: options.Until = None,
    interface: options.Interface = None,
    channel: options.Channel = None,
    sync: options.Sync = "host",
    simulate: Simulate = False,
    scene: options.Scene = None,
    seed: options.Seed = None,
    host: Host = "127.0.0.1",
    port: Port = None,
    export: Export = None,
    json: options.Json = False,
) -> int:
    """Show what the skin feels in a browser: loads, forces, contacts, slip, health.

    Prints the address, and serves it until Ctrl-C, or for a time. With `--simulate` a sphere
    presses, slides and lifts all over simulated units, or a scene is played. A log is played as
    fast as it was recorded; its last minute can be gone through then.
    """
    from skin.errors import SkinError
    from skin.view import show
    from topology import load

    options.check_seconds(seconds)
    options.check_folder("--export", export)
    check_simulated(simulate, scene, seed, sync, interface, channel)
    if topology is not None and simulate:
        raise SkinError("--topology: must be given with a log; got --simulate")
    tally = _Tally()
    with ExitStack() as ended:
        if topology is not None:
            source: Any = replayed(topology, file)
            states: Iterator[State] = _as_recorded(source)
        else:
            loaded = load(file).on(interface=interface, channel=channel)
            source = _live(ended, loaded, simulate, scene, seed, sync)
            states = iter(source)
        shown = ended.enter_context(show(source, host=host, port=port))
        print(f"{source.topology.name}: open {shown.address} in a browser; Ctrl-C ends",
              file=sys.stderr, flush=True)  # fmt: skip
        try:
            _go_on(states, tally, source, seconds)
            if topology is not None:
                _wait(tally, seconds)
        except KeyboardInterrupt:
            pass
        if export is not None:
            shown.export(export)
        report = tally.report() | {
            "topology": source.topology.name,
            "address": shown.address,
            "snapshots": shown.snapshots.taken,
            "snapshots_missed": shown.snapshots.missed,
            "page": None if export is None else str(export.resolve()),
        }
    print(json_text.dumps(report) if json else _table(report))
    return 0


def replayed(topology: str, log: str) -> Any:
    """What yields the states of a recording: has `topology`, `pipeline`, and can be iterated."""
    from skin.offline import decode_log

    return decode_log(topology, log)


def _live(
    ended: ExitStack,
    loaded: Topology,
    is_simulated: bool,
    scene: str | None,
    seed: int | None,
    sync: Any,
) -> Any:
    """An open skin, on its buses or on simulated units."""
    import skin

    transports = None
    if is_simulated:
        transports, _, are_exact = simulated(ended, loaded, scene, seed)
        loaded = loaded.exact() if are_exact else loaded
    return ended.enter_context(skin.open(loaded, sync=sync, transports=transports))


def _go_on(states: Iterator[State], tally: _Tally, source: Any, seconds: float | None) -> None:
    """Let cycle after cycle be seen, from the first one on for `seconds`."""
    timing = getattr(source, "timing", None)
    for _ in states:
        tally.add(0 if timing is None else timing.work_ns)
        if seconds is not None and tally.elapsed_s >= seconds:
            return


def _wait(tally: _Tally, seconds: float | None) -> None:
    """Keep serving what was played."""
    while seconds is None or tally.elapsed_s < seconds:
        time.sleep(0.1)


def _as_recorded(source: Any) -> Iterator[State]:
    """States, each not before its time."""
    first_ns = began_ns = None
    for state in source:
        now_ns = time.monotonic_ns()
        if first_ns is None or began_ns is None:
            first_ns, began_ns = state.stamp_ns, now_ns
        late_ns = now_ns - began_ns - (state.stamp_ns - first_ns)
        if late_ns < 0:
            time.sleep(-1e-9 * late_ns)
        yield state


class _Tally:
    """What is worth telling at the end."""

    def __init__(self) -> None:
        self._work_us: list[float] = []
        self._began = 0.0
        self._cycles = 0

    @property
    def elapsed_s(self) -> float:
        """Since the first cycle."""
        return time.monotonic() - self._began

    def add(self, work_ns: int) -> None:
        """Note a cycle."""
        self._began = self._began or time.monotonic()
        self._cycles += 1
        self._work_us.append(1e-3 * work_ns)

    def report(self) -> dict[str, Any]:
        p50, p99 = np.percentile(self._work_us, [50, 99]) if self._work_us else (0.0, 0.0)
        return {"cycles": self._cycles, "cycle_us_p50": float(p50), "cycle_us_p99": float(p99)}


def _table(report: dict[str, Any]) -> str:
    rows = {
        "cycles": "{cycles}",
        "snapshots": "{snapshots}, {snapshots_missed} missed",
        "frames to contacts": "{cycle_us_p50:.1f} µs p50, {cycle_us_p99:.1f} µs p99",
        "page": "{page}",
    }
    return facts(rows, report | {"page": report["page"] or "none"})
