"""`skin sim`: simulated units alone, on the buses of a topology."""

from __future__ import annotations

import json as json_text
import sys
from collections import Counter
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from bus.transport import Transport
    from skin.sim.node import Served
    from topology import Topology

__all__ = ["sim"]


def sim(
    file: Annotated[str, tyro.conf.Positional],
    /,
    *,
    seconds: Annotated[
        float | None, tyro.conf.arg(help="stop after this time; otherwise until Ctrl-C")
    ] = None,
    seed: Annotated[int, tyro.conf.arg(help="seed of the simulated noise")] = 0,
    noise: Annotated[bool, tyro.conf.arg(help="leave the noise out, keep the quantisation")] = True,
    interface: Annotated[
        str | None, tyro.conf.arg(help="use this interface for every bus instead of the file's")
    ] = None,
    channel: Annotated[
        str | None,
        tyro.conf.arg(
            help="use these channels instead of the file's, one for each bus, as vcan0,vcan1"
        ),
    ] = None,
    faults: Annotated[
        str | None, tyro.conf.arg(metavar="FILE", help="do to the frames what this script says")
    ] = None,
    json: Annotated[bool, tyro.conf.arg(help="end with one JSON object")] = False,
) -> int:
    """Put simulated units on the buses of a topology; they answer whoever sends SYNC.

    A sphere presses, slides and lifts all over the skin. Listen in another process with
    `skin run FILE` and the same options. On Linux use `--interface socketcan --channel vcan0`
    (`ip link add vcan0 type vcan; ip link set vcan0 mtu 72 up`); where there is no vcan,
    `--interface udp_multicast --channel 239.74.163.2` (`pip install 'f3t-skin[udp]'`). Exits 1 if
    no SYNC ever came.
    """
    from bus.faults import FaultyTransport, load_script
    from bus.transport import open_transport
    from skin.errors import SkinError
    from skin.sim.node import Nodes
    from topology import load

    if seconds is not None and not seconds > 0.0:
        raise SkinError(f"--seconds: must be above 0; got {seconds:g}")
    loaded = load(file).on(interface=interface, channel=channel)
    _within_reach(file, loaded)
    script = None if faults is None else load_script(faults, loaded)
    nodes = Nodes(loaded, seed=seed, noise=noise)
    with ExitStack() as opened:
        transports: list[Transport] = [
            opened.enter_context(open_transport(bus, i)) for i, bus in enumerate(loaded.buses)
        ]
        faulty = (
            []
            if script is None
            else [
                FaultyTransport(end, script, topology=loaded, direction="send")
                for end in transports
            ]
        )
        names = ", ".join(f"{bus.interface} {bus.channel}".rstrip() for bus in loaded.buses)
        print(f"{loaded.n} units on {names}; Ctrl-C ends it", file=sys.stderr, flush=True)
        try:
            nodes.serve(
                faulty or transports, seconds=seconds, watch=_Progress() if _watched() else None
            )
        except KeyboardInterrupt:
            pass
        finally:
            if _watched():
                print(file=sys.stderr)
    report = {"topology": loaded.name, "units": loaded.n, **asdict(nodes.served)}
    if script is not None:
        report["faults"] = _total(end.injected for end in faulty)
    if json:
        print(json_text.dumps(report))
    else:
        print(_table(report))
    return 0 if nodes.served.cycles else 1


def _within_reach(file: str, topology: Topology) -> None:
    """Refuse a bus that no other process could ever listen to."""
    from skin.errors import SkinError

    for i, bus in enumerate(topology.buses):
        if bus.interface == "memory":
            raise SkinError(
                f"{file}: buses[{i}] {bus.name!r}: interface: must be one that other processes can "
                "reach; got 'memory' (try --interface socketcan --channel vcan0, or --interface "
                "udp_multicast --channel 239.74.163.2)"
            )


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


def _table(report: dict[str, object]) -> str:
    rows = [
        ("units", f"{report['units']}"),
        ("cycles, left out", f"{report['cycles']}, {report['skipped']}"),
        ("frames sent", f"{report['frames']}"),
        ("frames not taken", f"{report['send_failures']}"),
        ("time", f"{report['seconds']:.1f} s"),
    ]
    if "faults" in report:
        struck = ", ".join(f"{kind} {count}" for kind, count in report["faults"].items())
        rows.append(("faults put in", struck or "none"))
    return "\n".join(f"{name:<18} {text}" for name, text in rows)
