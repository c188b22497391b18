"""`skin run`: listen to the buses of a topology."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from skin.cli import options
from skin.cli.table import end
from skin.cli.tally import Tally

__all__ = ["run"]


def run(
    file: options.File,
    /,
    *,
    seconds: options.Until = None,
    bus: options.Bus = None,
    sync: options.Sync = "host",
    simulate: options.Simulate = None,
    record: Annotated[Path | None, options.arg("FILE")] = None,
    json: options.Json = False,
) -> int:
    """Listen to the buses of a topology, send SYNC, and show what the skin feels.

    With `--simulate` a sphere presses, slides and lifts all over simulated units, or a scene is
    played to its end, with its own faults. Foxglove, PlotJuggler and the tools for ROS 2 bags read
    a recording as it is; `skin replay` plays it to the same states, and `skin decode` takes it, or
    a log. Exits with 1 if no unit ever answered, or no reading was valid.

    Parameters
    ----------
    record
        write a new recording of frames and states (.mcap), or a log of what the buses carry (.log,
        .log.gz)
    """
    from skin.view.terminal import LiveTable
    from topology.files import NO_KIND

    options.check_seconds(seconds)
    options.check_folder("--record", record, NO_KIND)
    given = {"bus": bus, "sync": sync, "simulate": simulate}
    with options.open_skin(file, **given, record=record) as opened:
        topology = opened.topology
        table, tally = LiveTable(topology), Tally(topology)
        with suppress(KeyboardInterrupt):
            tally.follow(opened, seconds, show=table.show)
        report = tally.report() | {
            "unsent": opened.timing.unsent,
            "counters": asdict(opened.counters),
            "buses": {
                bus.name: asdict(end.counters)
                for bus, end in zip(topology.buses, opened.transports, strict=True)
            },
            **options.without(topology),
            "zeros": opened.zeros,
            "recorded": None,
            "bus_changes": [f"{name}: {change}" for name, change in opened.bus_changes],
        }
        if (recorder := opened.recorder) is not None:
            recorder.stop()
            report["recorded"] = recorder.report()
    end(report, json)
    return 0 if report["units_heard"] and report["valid_share"] != 0.0 else 1
