"""`skin sim`: simulated units alone, on the buses of a topology."""

from __future__ import annotations

import sys
from collections import Counter
from contextlib import ExitStack, closing, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from skin.cli import options
from skin.cli.table import end

if TYPE_CHECKING:
    from bus.faults import FaultScript
    from bus.transport import Transport
    from skin.sim.node import Served, SimulatedUnits
    from topology import Topology

__all__ = ["sim"]


def sim(
    file: options.File,
    scene: Annotated[str | None, tyro.conf.Positional, options.arg("[SCENE]")] = None,
    /,
    *,
    seconds: options.Until = None,
    bus: options.Bus = None,
    truth: Annotated[Path | None, options.arg("FILE.npz")] = None,
    record: Annotated[Path | None, options.arg("FILE")] = None,
    json: options.Json = False,
) -> int:
    """Put simulated units on the buses of a topology; they answer the SYNC of any host.

    Listen in another process with `skin run FILE` and the same `--bus`. On Linux this can be `--bus
    socketcan:vcan0`, after `ip link add vcan0 type vcan` and then `ip link set vcan0 mtu 72 up`.
    Where there is no vcan, multicast serves as well: take `--bus udp_multicast:239.74.163.2`, after
    `pip install 'f3t-skin[udp]'`.

    On `--bus memory`, which no other process can reach, a scene is played as fast as possible: for
    its log and its truth. The scene has the seed of the noise, and faults. Exits with 1 without
    SYNC.

    Parameters
    ----------
    scene
        scene to play, ready-made or from a file; otherwise units are pressed all over
    truth
        write down the truth about every cycle
    record
        write a new log of a scene that is played in memory (.log, .log.gz)
    """
    from bus.logs import Recording
    from skin.compiling import announce
    from skin.errors import OptionError
    from skin.sim.node import SimulatedUnits
    from skin.sim.scenes.load import open_scene
    from skin.sim.scenes.record import TRUTH, Recorder
    from topology.files import NO_KIND

    options.check_seconds(seconds)
    options.check_folder("--truth", truth, TRUTH)
    options.check_folder("--record", record, NO_KIND)
    if scene is None and truth is not None:
        raise OptionError("--truth: must be given with a scene; got none")
    loaded = options.load(file, bus)
    is_fast = _is_inside(file, loaded, scene)
    if record is not None and not is_fast:
        raise OptionError("--record: must be absent on a bus that others reach, where `skin run` "
                          f"or candump records it; got {record}")  # fmt: skip
    announce()
    with ExitStack() as opened:
        script = None
        if scene is None:
            nodes = SimulatedUnits(loaded)
        else:
            played = open_scene(scene, loaded)
            script = played.faults
            watched = played if truth is None else opened.enter_context(Recorder(played, truth))
            nodes = SimulatedUnits(loaded, watched)
        options.note_scene(nodes.scene)
        if is_fast:
            from skin.sim.scenes.fast import play

            log = None
            if record is not None:  # whose buses are named as in the file, wherever they are
                log = opened.enter_context(closing(Recording(record, options.load(file))))
            lasts_s = played.seconds if seconds is None else seconds
            print(f"{loaded.n} units on no bus, {lasts_s:g} s", file=sys.stderr, flush=True)
            served, injected = play(nodes, lasts_s, script, log)
        else:
            served, injected = _serve(opened, nodes, seconds, script)
    report = {
        "topology": loaded.name, "units": loaded.n, **asdict(served), "scene": scene,
        "truth": str(truth) if truth is not None and served.cycles else None,
        "faults": dict(sum(map(Counter, injected), Counter())),
    }  # fmt: skip
    end(report, json)
    return 0 if served.cycles else 1


def _is_inside(file: str, loaded: Topology, scene: str | None) -> bool:
    """Whether a scene is played on buses within this process alone; refuses these without one."""
    from skin.errors import OptionError

    inside = [i for i, one in enumerate(loaded.buses) if one.interface == "memory"]
    if scene is not None and len(inside) == len(loaded.buses):
        return True
    if inside:
        raise OptionError(
            f"{file}: buses[{inside[0]}] {loaded.buses[inside[0]].name!r}: interface: must be one "
            "that other processes can reach; got 'memory' (try --bus socketcan:vcan0, or --bus "
            "udp_multicast:239.74.163.2)"
        )
    return False


def _serve(
    opened: ExitStack,
    nodes: SimulatedUnits,
    seconds: float | None,
    script: FaultScript | None,
) -> tuple[Served, list[dict[str, int]]]:
    """On real buses, for any host."""
    from bus.faults import FaultyTransport
    from bus.open import open_transport

    topology = nodes.topology
    ends: list[Transport] = [
        opened.enter_context(open_transport(bus, i)) for i, bus in enumerate(topology.buses)
    ]
    faulty = [] if script is None else [
        FaultyTransport(
            end, script, topology=topology, direction="send", clock=partial(nodes.time_ns, i)
        ) for i, end in enumerate(ends)
    ]  # fmt: skip
    names = ", ".join(f"{bus.interface} {bus.channel}".rstrip() for bus in topology.buses)
    print(f"{topology.n} units on {names}; Ctrl-C ends it", file=sys.stderr, flush=True)
    with suppress(KeyboardInterrupt):
        nodes.serve(faulty or ends, seconds=seconds, watch=_show if sys.stderr.isatty() else None)
    return nodes.served, [end.injected for end in faulty]


def _show(served: Served) -> None:
    """One line that is written over once a second."""
    text = f"{served.cycles} cycles, {served.frames} frames sent, {served.send_failures} not taken"
    print(f"\r{text}", end="", file=sys.stderr, flush=True)
