"""`skin replay`: a recording, or a log, as it was live."""

from __future__ import annotations

import json as json_text
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import tyro

from skin.cli import options
from skin.cli.table import counted, facts
from skin.cli.tally import Tally

__all__ = ["replay"]

SLOWEST = 1e-6
"""Least speed of a replay, and what the greatest is the inverse of."""


def replay(
    file: Annotated[
        Path,
        tyro.conf.Positional,
        tyro.conf.arg(metavar="FILE", help="recording (.mcap), or recorded CAN log"),
    ],
    /,
    *,
    topology: Annotated[
        str | None,
        options.quiet(
            "topology file or the name of a ready-made one: needed for a log; a recording has "
            "its own, which then has to be the same",
            metavar="FILE",
        ),
    ] = None,
    speed: Annotated[
        float, tyro.conf.arg(help="1 is real time, 10 ten times as fast, 0 as fast as it goes")
    ] = 1.0,
    step: Annotated[
        bool, options.quiet("wait for Enter before every cycle; a number goes on by as many")
    ] = False,
    map: options.Map = (),
    json: options.Json = False,
) -> int:
    """Play what `skin record` has recorded, or any log that `skin decode` reads.

    Shows the table of `skin run`. The states of a recording are those of the live run, to the bit,
    and this is checked: exits with 1 if any differ, if something was left out, or if the file is
    damaged; what is whole is played.
    """
    import skin
    from skin.errors import SkinError
    from skin.view.terminal import LiveTable

    if speed != 0.0 and not SLOWEST <= speed <= 1.0 / SLOWEST:
        raise SkinError(
            f"--speed: must be 0, or from {SLOWEST:g} to {1.0 / SLOWEST:g}; got {speed:g}"
        )
    pace = None if step or not speed else speed
    played = skin.replay(file, topology, speed=pace, **options.mapped(map, file))
    table, tally = LiveTable(played.topology), Tally(played.topology)
    wait = _Steps() if step else None
    try:
        for state in played:
            table.show(state, played.work_ns)
            tally.add(state, played.work_ns)
            if wait is not None and not wait(tally.cycles, state):
                break
    except KeyboardInterrupt:
        pass
    counters = asdict(played.counters)
    report: dict[str, Any] = tally.report() | {
        "counters": counters,
        "same": getattr(played, "same", None),
        "faults": played.faults,
    }
    print(json_text.dumps(report) if json else _table(report))
    for note in getattr(played, "notes", []):
        print(f"note: {note}", file=sys.stderr)
    for fault in played.faults:
        print(fault, file=sys.stderr)
    return 0 if tally.cycles and not played.faults else 1


class _Steps:
    """Asks before cycles, until the input ends."""

    def __init__(self) -> None:
        self._free = 0

    def __call__(self, cycle: int, state: Any) -> bool:
        if self._free > 0:
            self._free -= 1
            return True
        from skin.state import if_wanted

        loads = ", ".join(f"{c.id}: {c.load:.2f} N" for c in if_wanted(state, "contacts") or ())
        print(f"cycle {state.cycle} at {state.time_s:.6f} s: {loads or 'no contact'}", flush=True)
        line = sys.stdin.readline()
        number = line.strip()
        self._free = int(number) - 1 if number.isdigit() and int(number) > 0 else 0
        return bool(line)


def _table(report: dict[str, Any]) -> str:
    rows = {
        "units heard": "{units_heard} of {units_enabled}",
        "cycles, complete": "{cycles}, {complete_cycles}",
        "left out": "{overruns} periods without a cycle",
        "the same as live": "{same_text}",
        "valid readings": "{valid_percent}",
        "frames": "{frames}",
        "peak force": "{peak_force_n:.2f} N",
        "contacts, slipped": "{contacts}, {contacts_slipped}",
        "frames to contacts": "{cycle_us_p50:.1f} µs p50, {cycle_us_p99:.1f} µs p99",
    }
    same = report["same"]
    texts = {
        "valid_percent": options.percent(report["valid_share"]),
        "frames": counted(report["counters"]),
        "same_text": "not known of a log" if same is None else f"{same} of {report['cycles']}",
    }
    return facts(rows, report | texts)
