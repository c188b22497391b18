"""`skin run`: listen to the buses of a topology."""

from __future__ import annotations

import json as json_text
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from skin.cli import options
from skin.cli.table import counted, facts
from skin.cli.tally import Tally

if TYPE_CHECKING:
    from bus.logs import Recording

__all__ = ["run"]

LOSSES = {
    "controller_overflows": "in the controller",
    "queue_drops": "in the socket",
    "ring_overflows": "in our own ring",
}
"""Where frames may be lost on this host."""

Record = Annotated[
    Path | None,
    options.quiet(
        "write a new recording of frames and states (.mcap), or a log of what the buses carry "
        "(.log, .log.gz, .blf)",
        metavar="FILE",
    ),
]


def run(
    file: options.File,
    /,
    *,
    seconds: options.Until = None,
    bus: options.Bus = None,
    sync: options.Sync = "host",
    simulate: options.Simulate = None,
    record: Record = None,
    auto_tare: Annotated[
        bool,
        options.quiet(
            "do not take the zeros of units that were never tared from the first second in which "
            "nothing touches them"
        ),
    ] = True,
    json: options.Json = False,
) -> int:
    """Listen to the buses of a topology, send SYNC, and show what the skin feels.

    With `--simulate` a sphere presses, slides and lifts all over simulated units, or a scene is
    played to its end, with its own faults. Foxglove, PlotJuggler and the tools for ROS 2 bags read
    a recording as it is; `skin replay` plays it to the same states, and `skin decode` takes it, or
    a log. Exits with 1 if no unit ever answered, or no reading was valid.
    """
    import skin
    from skin.view.terminal import LiveTable

    options.check_seconds(seconds)
    scene = options.played_scene(simulate, sync, bus)
    loaded = options.load(file, bus)
    is_log = record is not None and record.suffix != ".mcap"
    if not scene:
        for hint in options.hints(file, loaded, will_tare=auto_tare):
            print(f"note: {hint}", file=sys.stderr)
    table, tally = LiveTable(loaded), Tally(loaded)
    log = options.frame_log(record if is_log else None, file)
    with ExitStack() as ended:
        with _gone_if_refused(log, record):
            opened = ended.enter_context(skin.open(
                loaded, sync=sync, simulate=scene, auto_tare=auto_tare, log=log,
                record=None if is_log else record,
            ))  # fmt: skip
        options.note_scene(opened.nodes and opened.nodes.scene)
        with suppress(KeyboardInterrupt):
            tally.follow(opened, seconds, show=table.show)
        report = tally.report() | {
            "unsent": opened.timing.unsent,
            "counters": asdict(opened.counters),
            "buses": {
                bus.name: asdict(end.counters)
                for bus, end in zip(loaded.buses, opened.transports, strict=True)
            },
            "never_tared": [] if scene else options.never_tared(loaded),
            "uncalibrated": [] if scene else options.uncalibrated(loaded),
            "zeros": opened.zeros,
            "recorded": None,
            "bus_changes": [f"{name}: {change}" for name, change in opened.bus_changes],
        }
        if (recorder := opened.recorder) is not None:
            recorder.stop()
            report["recorded"] = recorder.report()
    print(json_text.dumps(report) if json else facts(tally.facts() | _more(report)))
    return 0 if report["units_heard"] and report["valid_share"] != 0.0 else 1


@contextmanager
def _gone_if_refused(log: Recording | None, path: Path | None) -> Iterator[None]:
    """Leave no log of a skin that cannot be opened."""
    try:
        yield
    except BaseException:
        if log is not None and path is not None:
            log.close()
            path.unlink()
        raise


def _more(report: dict[str, Any]) -> dict[str, str]:
    """What a live run tells people beside what was counted."""
    lost = ", ".join(
        f"{counts[key]} {place} of {name}"
        for name, counts in report["buses"].items()
        for key, place in LOSSES.items()
        if counts[key]
    )
    rows = {
        "frames": counted(report["counters"]),
        "lost on this host": lost or "none",
        "SYNC not taken": str(report["unsent"]),
        "bus changes": "; ".join(report["bus_changes"][-4:]) or "none",
        "zeros": _zeros(report["zeros"]),
    }
    if (recorded := report["recorded"]) is not None:
        text = f"{recorded.get('cycles', 0)} cycles, {recorded.get('bytes', 0) / 1e6:.1f} MB"
        if recorded["lost_cycles"] or recorded["lost_frames"]:
            text += f", {recorded['lost_cycles']} cycles and {recorded['lost_frames']} frames"
            text += " left out"
        rows["recorded"] = text + (", ended early" if recorded["failure"] else "")
    return rows


def _zeros(zeros: dict[str, Any]) -> str:
    """Whose zeros were taken in this run, and the first that was refused."""
    parts = [f"{len(zeros['tared'])} tared in this run"] if zeros["tared"] else []
    if zeros["refused"]:
        unit, why = next(iter(zeros["refused"].items()))
        parts.append(f"{len(zeros['refused'])} refused ({unit}: {why})")
    return ", ".join(parts) or "those of the files"
