"""`skin warmup`: compile what a skin needs, before it is used."""

from __future__ import annotations

import json as json_text
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from skin.cli import options

if TYPE_CHECKING:
    from topology import Topology

__all__ = ["warmup"]

Simulate = Annotated[bool, options.quiet("what `skin run --simulate` needs, too")]
Record = Annotated[bool, options.quiet("what `skin run --record` needs, too")]
Learn = Annotated[bool, options.quiet("what `skin run --learn` needs, too")]


def warmup(
    file: options.FileOrNone = None,
    /,
    *,
    interface: options.Interface = None,
    channel: options.Channel = None,
    simulate: Simulate = False,
    scene: options.Scene = None,
    record: Record = False,
    learn: Learn = False,
    json: options.Json = False,
) -> int:
    """Compile the kernels that a skin needs, so that its first start takes seconds.

    For install scripts and images of containers. No bus is opened. Without a topology: what `skin
    demo` needs. Kernels are compiled by as many processes as there are cores, and kept in the
    folder of NUMBA_CACHE_DIR, else of the user's caches; processors with other features compile
    their own. Exits with 1 if they could not be kept.
    """
    from bus.compiled import cache, places
    from topology import load

    loaded = load("palm" if file is None else file).on(interface=interface, channel=channel)
    simulated: Any = scene or (simulate or file is None)
    compiled: list[str] = []
    began = time.monotonic()
    with cache.watch(compiled.append), tempfile.TemporaryDirectory() as folder:
        recorded = Path(folder, "warmup.mcap") if record else None
        _run(loaded, simulated, record=recorded, learn=learn)
    kept = places.written()
    report = {
        "topology": loaded.name,
        "compiled": sorted(compiled),
        "seconds": time.monotonic() - began,
        "folder": None if kept is None else str(kept),
    }
    print(json_text.dumps(report) if json else _line(report))
    return 0 if kept is not None else 1


def _run(topology: Topology, simulated: Any, **how: Any) -> None:
    """Run a skin up to its first state: simulated, or on buses within this process that nobody
    answers on."""
    import skin

    if not simulated:
        _import_transports(topology)
        topology = topology.on(interface="memory")
    with ExitStack() as opened:
        running = opened.enter_context(skin.open(topology, simulate=simulated, pace=False, **how))
        next(iter(running))
        if running.learning is not None:
            running.learning.report()  # its process has compiled then


def _import_transports(topology: Topology) -> None:
    """Compile what reads the buses of a topology, as it is imported."""
    from bus.linux import has_batches

    if has_batches() and any(bus.interface == "socketcan" for bus in topology.buses):
        import bus.socketcan  # noqa: F401


def _line(report: dict[str, Any]) -> str:
    count, folder = len(report["compiled"]), report["folder"]
    where = "nowhere: no folder can be written" if folder is None else folder
    if not count:
        return f"{report['topology']}: all kernels were compiled already, in {where}"
    return (
        f"{report['topology']}: {count} kernels compiled in {report['seconds']:.1f} s, kept in "
        f"{where}"
    )
