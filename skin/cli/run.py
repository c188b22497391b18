"""`skin run`: listen to the buses of a topology."""

from __future__ import annotations

import json as json_text
import sys
import time
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from skin.cli import options
from skin.cli.table import counted, facts
from skin.cli.tally import Tally

if TYPE_CHECKING:
    from skin.calibrate.background import Learning
    from skin.io.record.recorder import Recorder
    from skin.live import Skin
    from topology import Topology

__all__ = ["check_simulated", "note", "note_scene", "run"]

SHOWN = 8
"""Patches that a line names."""

Wait = Annotated[
    Literal["event", "deadline"],
    tyro.conf.arg(
        help="wake as a cycle becomes complete (least latency), or once a cycle (least work)"
    ),
]
Simulate = Annotated[
    bool, options.quiet("listen to simulated units, in this process, on no bus of the file")
]
AutoTare = Annotated[
    bool,
    options.quiet(
        "do not take the zeros of units that were never tared from the first second in which "
        "nothing touches them"
    ),
]
Zeros = Annotated[
    Path | None,
    options.quiet(
        "take up the zeros of the run before, and save them for the next", metavar="FILE"
    ),
]
Learn = Annotated[
    Path | None,
    options.quiet(
        "learn the stray fields of neighbours while the skin is used, and save them", metavar="FILE"
    ),
]
Faults = Annotated[
    Path | None,
    options.quiet(
        "put the faults of this script into the frames (docs/guides/faults.md), in place of those "
        "of the scene: a test of what uses the skin",
        metavar="FILE",
    ),
]
Record = Annotated[
    Path | None,
    options.quiet("record frames and states as MCAP, as `skin record` does", metavar="FILE"),
]


def run(
    file: options.File,
    /,
    *,
    seconds: options.Until = None,
    interface: options.Interface = None,
    channel: options.Channel = None,
    sync: options.Sync = "host",
    wait: Wait = "event",
    simulate: Simulate = False,
    scene: options.Scene = None,
    seed: options.Seed = None,
    log: options.Log = None,
    auto_tare: AutoTare = True,
    zeros: Zeros = None,
    learn: Learn = None,
    record: Record = None,
    faults: Faults = None,
    json: options.Json = False,
) -> int:
    """Listen to the buses of a topology, send SYNC, and show what the skin feels.

    With `--simulate` a sphere presses, slides and lifts all over simulated units, or a scene is
    played to its end, with its own faults. `skin decode` takes the log as it is. Exits with 1 if no
    unit ever answered, or no reading was valid.
    """
    from skin.physics.stencil import STENCIL_FILE
    from skin.view.terminal import LiveTable
    from topology import load
    from topology.files import NO_KIND

    options.check_seconds(seconds)
    options.check_folder("--log", log, NO_KIND)
    options.check_folder("--zeros", zeros)
    options.check_folder("--learn", learn, STENCIL_FILE)
    check_simulated(simulate, scene, seed, sync, interface, channel)
    filed = load(file)
    loaded = filed.on(interface=interface, channel=channel)
    if not simulate:
        note(file, loaded, auto_tare)
    table, tally = LiveTable(loaded), Tally(loaded)
    if faults is not None:
        print(f"note: {faults} puts faults into what the buses carry", file=sys.stderr)
    end = None
    with _opened(
        log, filed, loaded, sync=sync, wait=wait, simulate=scene or simulate, seed=seed,
        faults=faults, auto_tare=auto_tare, zeros=zeros, learn=learn is not None, record=record,
    ) as opened:  # fmt: skip
        note_scene(opened.nodes and opened.nodes.scene)
        with suppress(KeyboardInterrupt):
            for state in opened:
                table.show(state, opened.timing.work_ns)
                tally.add(state, opened.timing.work_ns)
                if end is None and seconds is not None:
                    end = time.monotonic() + seconds  # from the first cycle on
                if end is not None and time.monotonic() >= end:
                    break
        report = tally.report() | {
            "unsent": opened.timing.unsent,
            "counters": asdict(opened.counters),
            "buses": {
                bus.name: asdict(end.counters)
                for bus, end in zip(loaded.buses, opened.transports, strict=True)
            },
            "never_tared": [] if simulate else options.never_tared(loaded),
            "uncalibrated": [] if simulate else options.uncalibrated(loaded),
            "zeros": opened.zeros,
            "learned": _learned(opened.learning, learn),
            "recorded": _recorded(opened.recorder),
            "bus_changes": [f"{name}: {change}" for name, change in opened.bus_changes],
        }
    print(json_text.dumps(report) if json else _table(report))
    return 0 if report["units_heard"] and report["valid_share"] != 0.0 else 1


def _recorded(recorder: Recorder | None) -> dict[str, Any] | None:
    """End the recording, where there is one, and return what is in it."""
    if recorder is None:
        return None
    recorder.stop()
    return recorder.report()


def note(file: str, topology: Topology, auto_tare: bool) -> None:
    """Say what is worth knowing before the first cycle."""
    for text in options.hints(file, topology, will_tare=auto_tare):
        print(f"note: {text}", file=sys.stderr)


def note_scene(scene: object) -> None:
    """Say what a simulated scene touches."""
    for body, places in getattr(scene, "touches", {}).items():
        shown = ", then ".join(places[:SHOWN]) + (", …" if len(places) > SHOWN else "")
        print(f"scene: {body} on {shown}", file=sys.stderr)


def check_simulated(
    simulate: bool,
    scene: str | None,
    seed: int | None,
    sync: str,
    interface: str | None,
    channel: str | None,
) -> None:
    """Refuse what means nothing together."""
    from skin.errors import SkinError

    for option, value in (("--scene", scene), ("--seed", seed)):
        if value is not None and not simulate:
            raise SkinError(f"{option}: must be given with --simulate; got none")
    if not simulate:
        return
    if sync != "host":
        raise SkinError(f"--sync: must be 'host' with --simulate; got {sync!r}")
    options.refuse_both("--simulate", "--interface", interface)
    options.refuse_both("--simulate", "--channel", channel)


def _opened(log: Path | None, filed: Topology, loaded: Topology, **how: Any) -> Skin:
    """An open skin that writes a log of the buses as the file names them; where it cannot be
    opened, no log is left behind."""
    import skin
    from bus.logs import Recording

    if log is None:
        return skin.open(loaded, **how)
    recording = Recording(log, filed)
    try:
        return skin.open(loaded, log=recording, **how)
    except BaseException:
        recording.close()
        log.unlink(missing_ok=True)
        raise


def _table(report: dict[str, Any]) -> str:
    silent = report["silent_units"]
    shown = ", ".join(silent[:8]) + (f" and {len(silent) - 8} more" if len(silent) > 8 else "")
    rows = {
        "units heard": "{units_heard} of {units_enabled}",
        "silent": "{shown}",
        "cycles, complete": "{cycles}, {complete_cycles}",
        "left out": "{overruns} periods without a cycle",
        "valid readings": "{valid_percent}",
        "frames": "{frames}",
        "lost on this host": "{losses}",
        "SYNC not taken": "{unsent}",
        "bus changes": "{changes}",
        "zeros": "{taken}",
        "recorded": "{recorded_text}",
        "peak force": "{peak_force_n:.2f} N",
        "contacts, slipped": "{contacts}, {contacts_slipped}",
        "frames to contacts": "{cycle_us_p50:.1f} µs p50, {cycle_us_p99:.1f} µs p99",
    }
    texts = {
        "valid_percent": options.percent(report["valid_share"]),
        "shown": shown or "none",
        "frames": counted(report["counters"]),
        "losses": _host_losses(report["buses"]),
        "changes": "; ".join(report["bus_changes"][-4:]) or "none",
        "taken": _zeros(report["zeros"]),
    }
    recorded = report["recorded"]
    if recorded is None:
        del rows["recorded"]
    else:
        texts["recorded_text"] = _recording(recorded)
    return facts(rows, report | texts)


def _recording(recorded: dict[str, Any]) -> str:
    """What stands in a recording, and what does not."""
    text = f"{recorded.get('cycles', 0)} cycles, {recorded.get('bytes', 0) / 1e6:.1f} MB"
    if recorded["lost_cycles"] or recorded["lost_frames"]:
        lost = f"{recorded['lost_cycles']} cycles and {recorded['lost_frames']} frames left out"
        text += f", {lost}"
    return text + (", ended early" if recorded["failure"] else "")


def _learned(learning: Learning | None, file: Path | None) -> dict[str, Any] | None:
    """Save what was learned of the neighbours' fields, and return how much it is."""
    from skin.errors import SkinError

    if learning is None or file is None:
        return None
    try:
        learning.save(file)
    except SkinError as error:
        print(f"nothing learned: {error}", file=sys.stderr)
        try:
            return learning.report() | {"file": None}
        except SkinError:  # what learns is gone
            nothing = {"pressed": {}, "sigma_ut": None}
            return nothing | {"left_out": learning.lost, "file": None}
    report = learning.report()
    print(f"{file}: stray fields within {report['sigma_ut']:.1f} µT, from the touch of "
          f"{len(report['pressed'])} units", file=sys.stderr)  # fmt: skip
    return report | {"file": str(file.resolve())}


def _zeros(zeros: dict[str, Any]) -> str:
    """Whose zeros were taken in this run, and the first that was refused."""
    parts = [
        f"{len(zeros[key])} {text}"
        for key, text in (("tared", "tared in this run"), ("taken_up", "of the run before"))
        if zeros[key]
    ]
    if zeros["refused"]:
        unit, why = next(iter(zeros["refused"].items()))
        parts.append(f"{len(zeros['refused'])} refused ({unit}: {why})")
    return ", ".join(parts) or "those of the files"


def _host_losses(buses: dict[str, dict[str, int]]) -> str:
    """Frames that reached this machine and not the caller, by place, where there are any."""
    places = {
        "controller_overflows": "in the controller",
        "queue_drops": "in the socket",
        "ring_overflows": "in our own ring",
    }
    parts = [
        f"{counts[key]} {place} of {name}"
        for name, counts in buses.items()
        for key, place in places.items()
        if counts[key]
    ]
    return ", ".join(parts) or "none"
