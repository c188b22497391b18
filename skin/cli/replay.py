"""`skin replay`: a recording, or a log, as it was live."""

from __future__ import annotations

import sys
from contextlib import suppress
from dataclasses import asdict
from typing import Annotated

import tyro

from skin.cli import options
from skin.cli.table import end
from skin.cli.tally import Tally

__all__ = ["replay"]

SLOWEST = 1e-6
"""Least speed of a replay, and what the greatest is the inverse of."""


def replay(
    file: Annotated[str, tyro.conf.Positional, options.arg("FILE")],
    log: options.Log = None,
    /,
    *,
    speed: float = 1.0,
    map: options.Map = (),
    json: options.Json = False,
) -> int:
    """Play what `skin run --record` has recorded, or any log that `skin decode` reads.

    Shows the table of `skin run`. The states of a recording are those of the live run, to the bit,
    and `same` is how many are: exits with 1 if any differ, if something was left out, or if
    the file is damaged; what is whole is played.

    Parameters
    ----------
    file
        recording (.mcap); or topology file of a log, or the name of a ready-made one
    speed
        1 is real time, 10 ten times as fast, 0 as fast as it goes
    """
    import skin
    from skin.errors import OptionError
    from skin.view.terminal import LiveTable

    if speed != 0.0 and not SLOWEST <= speed <= 1.0 / SLOWEST:
        raise OptionError(
            f"--speed: must be 0, or from {SLOWEST:g} to {1.0 / SLOWEST:g}; got {speed:g}"
        )
    given = (file,) if log is None else (log, file)
    played = skin.replay(*given, speed=speed or None, **options.mapped(map, log))
    table, tally = LiveTable(played.topology), Tally(played.topology)
    with suppress(KeyboardInterrupt):
        tally.follow(played, show=table.show)
    report = tally.report() | {
        "counters": asdict(played.counters),
        "same": getattr(played, "same", None),
        "faults": played.faults,
    }
    end(report, json)
    for note in getattr(played, "notes", []):
        print(f"note: {note}", file=sys.stderr)
    for fault in played.faults:
        print(fault, file=sys.stderr)
    return 0 if tally.cycles and not played.faults else 1
