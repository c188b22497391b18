"""`skin sim`: simulated units alone, on the buses of a topology."""

from __future__ import annotations

import json as json_text
import sys
from collections import Counter
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from skin.cli import options
from skin.cli.run import note_scene
from skin.cli.table import facts

if TYPE_CHECKING:
    from bus.faults import FaultScript
    from bus.logs import Recording
    from bus.transport import Transport
    from skin.sim.node import Served, SimulatedUnits
    from skin.sim.scene import Scene
    from skin.sim.scenes.play import ScriptedScene
    from topology import Topology

__all__ = ["sim"]


def sim(
    file: options.FileOrNone = None,
    /,
    *,
    seconds: options.Until = None,
    seed: options.Seed = None,
    noise: Annotated[bool, options.quiet("leave the noise out, keep the quantisation")] = True,
    interface: options.Interface = None,
    channel: options.Channel = None,
    faults: Annotated[
        str | None, options.quiet("do to the frames what this script says", metavar="FILE")
    ] = None,
    scene: options.Scene = None,
    truth: Annotated[
        str | None, options.quiet("write down the truth about every cycle", metavar="FILE.npz")
    ] = None,
    fast: Annotated[
        bool, options.quiet("make the frames of the scene as fast as possible, on no bus")
    ] = False,
    log: options.Log = None,
    json: options.Json = False,
    schema: Annotated[
        bool, options.quiet("print the JSON Schema of scene files, for your editor")
    ] = False,
) -> int:
    """Put simulated units on the buses of a topology; they answer the SYNC of any host.

    Listen in another process with `skin run FILE` and the same interface and channel. On Linux
    these can be `--interface socketcan --channel vcan0`, after `ip link add vcan0 type vcan` and
    then `ip link set vcan0 mtu 72 up`. Where there is no vcan, multicast serves as well:
    take `--interface udp_multicast --channel 239.74.163.2`, after `pip install 'f3t-skin[udp]'`.

    Without a scene a sphere presses, slides and lifts. A scene's own faults are done if no others
    are given; it plays as with `--fast` where no bus leaves the process. Exits with 1 without SYNC.
    """
    from bus.faults import load_script
    from skin.compiling import announcer
    from skin.sim.scenes.script import SceneFile
    from topology import load
    from topology.json_schema import json_schema

    if schema:
        print(json_text.dumps(json_schema(SceneFile), indent=2))
        return 0
    file = options.given(file, "sim")
    options.check_seconds(seconds)
    _check_files(scene, truth, log)
    _check_fast(fast, scene, interface, channel)
    filed = load(file)
    loaded = filed.on(interface=interface, channel=channel)
    fast = fast or (scene is not None and _in_process(loaded))
    _check_reachable(fast, file, loaded)
    script = None if faults is None else load_script(faults, loaded)
    announcer()
    from skin.sim.attached import own_faults
    from skin.sim.node import SimulatedUnits
    from skin.sim.scenes.load import open_scene

    with ExitStack() as opened:
        if scene is None:
            nodes = SimulatedUnits(loaded, seed=seed or 0, noise=noise)
        else:
            played = open_scene(scene, loaded, seed=seed, noise=noise)
            script = script or own_faults(played)
            nodes = SimulatedUnits(loaded, _recorded(opened, played, truth), history=0)
        note_scene(nodes.scene)
        recording = None if log is None else _recording(opened, log, filed)
        if fast:
            lasting = played.seconds if seconds is None else seconds
            served, injected = _play(nodes, lasting, script, recording)
        else:
            served, injected = _serve(opened, nodes, seconds, script, recording)
    report = {"topology": loaded.name, "units": loaded.n, **asdict(served)}
    if scene is not None:
        report |= _of_scene(played, served, truth)
    if script is not None:
        report["faults"] = _total(injected)
    print(json_text.dumps(report) if json else _table(report))
    return 0 if served.cycles else 1


def _of_scene(played: ScriptedScene, served: Served, truth: str | None) -> dict[str, Any]:
    """The report of a scene that was played."""
    lasted = served.cycles / played.topology.cycle_rate_hz
    return {
        "scene": played.script.name,
        "truth": truth if served.cycles else None,
        "real_time_factor": lasted / served.seconds if served.seconds else 0.0,
    }


def _check_reachable(fast: bool, file: str, topology: Topology) -> None:
    """Refuse a bus that no other process could be on, unless no bus is used."""
    from skin.errors import SkinError

    if not fast and (why := options.unreachable(file, topology)):
        raise SkinError(why)


def _check_files(scene: str | None, truth: str | None, log: Path | None) -> None:
    """Refuse files that cannot be written, and a truth without a scene."""
    from skin.errors import SkinError
    from skin.sim.scenes.record import TRUTH
    from topology.files import NO_KIND

    options.check_folder("--log", log, NO_KIND)
    options.check_folder("--truth", None if truth is None else Path(truth), TRUTH)
    if scene is None and truth is not None:
        raise SkinError("--truth: must be given with --scene; got none")


def _check_fast(fast: bool, scene: str | None, interface: str | None, channel: str | None) -> None:
    """Refuse what means nothing on no bus."""
    from skin.errors import SkinError

    if not fast:
        return
    if scene is None:
        raise SkinError("--fast: must be given with --scene; got none")
    options.refuse_both("--fast", "--interface", interface)
    options.refuse_both("--fast", "--channel", channel)


def _recording(opened: ExitStack, log: Path, topology: Topology) -> Recording:
    from bus.logs import Recording

    recording = Recording(log, topology)
    opened.callback(recording.close)
    return recording


def _recorded(opened: ExitStack, played: ScriptedScene, path: str | None) -> Scene:
    """The scene, whose truth is written where a file is given."""
    if path is None:
        return played
    from skin.sim.scenes.record import Recorder

    return opened.enter_context(Recorder(played, path))


def _play(
    nodes: SimulatedUnits, seconds: float, script: FaultScript | None, recording: Recording | None
) -> tuple[Served, list[dict[str, int]]]:
    """Without any bus, as fast as this machine can."""
    from skin.sim.scenes.fast import play

    print(f"{nodes.topology.n} units on no bus, {seconds:g} s", file=sys.stderr, flush=True)
    return play(nodes, seconds, script, recording)


def _serve(
    opened: ExitStack,
    nodes: SimulatedUnits,
    seconds: float | None,
    script: FaultScript | None,
    recording: Recording | None,
) -> tuple[Served, list[dict[str, int]]]:
    """On real buses, for any host."""
    from bus.faults import FaultyTransport
    from bus.logs import LoggedTransport
    from bus.open import open_transport

    topology = nodes.topology
    transports: list[Transport] = [
        opened.enter_context(open_transport(bus, i)) for i, bus in enumerate(topology.buses)
    ]
    if recording is not None:
        transports = [LoggedTransport(end, recording) for end in transports]
    faulty = [] if script is None else [
        FaultyTransport(
            end, script, topology=topology, direction="send", clock=partial(nodes.time_ns, i)
        ) for i, end in enumerate(transports)
    ]  # fmt: skip
    names = ", ".join(f"{bus.interface} {bus.channel}".rstrip() for bus in topology.buses)
    print(f"{topology.n} units on {names}; Ctrl-C ends it", file=sys.stderr, flush=True)
    try:
        nodes.serve(
            faulty or transports, seconds=seconds, watch=_Progress() if _watched() else None
        )
    except KeyboardInterrupt:
        pass
    finally:
        if _watched():
            print(file=sys.stderr)
    return nodes.served, [end.injected for end in faulty]


def _in_process(topology: Topology) -> bool:
    return all(bus.interface == "memory" for bus in topology.buses)


def _watched() -> bool:
    return sys.stderr.isatty()


class _Progress:
    """One line that is written over once a second."""

    def __init__(self) -> None:
        self._cycles = 0

    def __call__(self, served: Served) -> None:
        rate = served.cycles - self._cycles
        self._cycles = served.cycles
        state = f"{rate} cycles/s" if rate else "no SYNC"
        print(
            f"\r{state:>16}, {served.frames} frames sent, {served.send_failures} not taken",
            end="", file=sys.stderr, flush=True,
        )  # fmt: skip


def _total(parts: Iterable[dict[str, int]]) -> dict[str, int]:
    """Faults by kind, over all buses."""
    total: Counter[str] = Counter()
    for part in parts:
        total.update(part)
    return dict(total)


def _table(report: dict[str, Any]) -> str:
    rows = {
        "units": "{units}",
        "cycles, left out": "{cycles}, {skipped}",
        "frames sent": "{frames}",
        "frames not taken": "{send_failures}",
        "time": "{seconds:.1f} s",
    }
    if "scene" in report:
        rows |= {
            "scene": "{scene}",
            "truth": "{truth}" if report["truth"] else "not written",
            "times real time": "{real_time_factor:.1f}",
        }
    if "faults" in report:
        rows["faults put in"] = "{struck}"
    struck = ", ".join(f"{kind} {count}" for kind, count in report.get("faults", {}).items())
    return facts(rows, report | {"struck": struck or "none"})
