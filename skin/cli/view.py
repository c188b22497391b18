"""`skin view`: the live view in a browser."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack, suppress
from typing import Annotated, Any

import tyro

from skin.cli import options
from skin.cli.table import end
from skin.cli.tally import Tally

__all__ = ["view"]

LOOK_S = 0.1
"""Between two looks at the process of the view after the last state."""


def view(
    file: Annotated[str, tyro.conf.Positional, options.arg("FILE")],
    log: options.Log = None,
    /,
    *,
    map: options.Map = (),
    seconds: options.Until = None,
    bus: options.Bus = None,
    sync: options.Sync = "host",
    simulate: options.Simulate = None,
    host: str = "127.0.0.1",
    json: options.Json = False,
) -> int:
    """Show what the skin feels in a browser: loads, forces, contacts, slip, health.

    Prints the address, with the first free port from 8080, and serves it until Ctrl-C, or for a
    time. With `--simulate` a sphere
    presses, slides and lifts all over simulated units, or a scene is played. What `skin run
    --record` has recorded, or a log, is played as fast as it was. Exits with 1 if the process of
    the view ends, or a recording holds no cycle or is damaged.

    Parameters
    ----------
    file
        topology file, or the name of a ready-made one; or a recording
    host
        address of this machine; others let others in
    """
    import skin
    from skin.io.record import is_recording
    from skin.view import show

    options.check_seconds(seconds)
    is_recorded = log is not None or is_recording(file)
    if is_recorded:
        options.refuse_both("a recording or log", "--simulate", simulate)
        options.refuse_both("a recording or log", "--bus", bus)
    mapped = options.mapped(map, log)
    faults: list[str] = []
    with ExitStack() as ended:
        if is_recorded:
            given = (file,) if log is None else (log, file)
            source: Any = skin.replay(*given, speed=1.0, **mapped)
        else:
            source = ended.enter_context(
                options.open_skin(file, bus=bus, sync=sync, simulate=simulate)
            )
        tally = Tally(source.topology)
        shown = ended.enter_context(show(source, host=host))
        print(f"{source.topology.name}: open {shown.address} in a browser; Ctrl-C ends",
              file=sys.stderr, flush=True)  # fmt: skip
        with suppress(KeyboardInterrupt):
            tally.follow(source, seconds, goes_on=lambda: shown.alive)
            faults += getattr(source, "faults", ())
            if is_recorded and not tally.cycles and not faults:
                faults.append(f"{log or file}: must hold cycles of {source.topology.name!r}; got "
                              "none")  # fmt: skip
            for fault in faults:
                print(fault, file=sys.stderr)
            while not tally.is_over(seconds) and shown.alive:
                time.sleep(LOOK_S)
        if not shown.alive:
            if shown.failure is None:
                shown.fail()
            faults.append(str(shown.failure))
        taken, missed = shown.snapshots.taken, shown.snapshots.missed
    report = tally.report() | {
        "address": shown.address, "snapshots": taken, "snapshots_missed": missed, "faults": faults,
    }  # fmt: skip
    end(report, json)
    return 1 if faults else 0
