"""From a topology to an open skin: its buses, or simulated units in their place."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import topology as topology_package
from bus.logs import Recording
from bus.open import open_transport
from bus.transport import Transport
from skin.errors import (
    MOST_SEED,
    OptionError,
    check_choice,
    check_flag,
    check_kind,
    check_number,
    shown,
)
from skin.live import Skin, Sync
from skin.options import Options
from skin.pipeline import Pipeline
from topology import Topology

if TYPE_CHECKING:
    from bus.faults import FaultScript
    from skin.contact.slip import SlipSettings
    from skin.io.record.recorder import Recorder
    from skin.sim.node import SimulatedUnits
    from skin.sim.scenes.script import SceneFile
    from skin.sim.truth import Scene

__all__ = ["open"]

FRAMES_ALONE = (".log", ".log.gz")
"""Ends of the names of files that hold frames without states."""


def open(
    source: Topology | str | Path,
    *,
    want: Collection[str] | None = None,
    slip: SlipSettings | None = None,
    options: Options | None = None,
    sync: Sync = "host",
    pace: bool = True,
    simulate: bool | str | Path | SceneFile | Scene | None = False,
    seed: int | None = None,
    faults: FaultScript | str | os.PathLike[str] | None = None,
    record: str | os.PathLike[str] | Recording | None = None,
) -> Skin:
    """Open the buses of a topology and decode what they carry.

    Parameters
    ----------
    source : Topology, str or Path
        A loaded topology, a file, or a built-in one by name ("palm", "fingertip", …).
    want, slip : collection of str, and SlipSettings, optional
        What is computed, and settings of slip: also fields of `options`.
    options : Options, optional
        How it is computed; see `skin.Options`.
    sync : "host" or "bus"
        SYNC is sent by this host, or by another node.
    pace : bool
        Keep the cycle rate, or start each cycle at once.
    simulate : bool, str, Path, SceneFile or Scene
        Simulated units: True for the scene "demo", or a scene by its name or file.
    seed : int, optional
        Of the simulated noise and faults; the scene's, or 0, if not given.
    faults : FaultScript, str or Path, optional
        Faults of received frames (docs/guides/faults.md); by default the scene's own.
    record : path, or Recording, optional
        A new file: .mcap (frames and states), or .log, .log.gz (frames).

    Raises
    ------
    topology.TopologyError, bus.BusOpenError, bus.FaultScriptError, bus.LogError, SkinError
        A file, a bus or an option cannot be used; every problem of a file is listed.
    """
    loaded = source if isinstance(source, Topology) else topology_package.load(source)
    options = Options() if options is None else options
    check_kind("options", options, Options)
    given = {"want": want, "slip": slip}
    options = replace(options, **{name: one for name, one in given.items() if one is not None})
    check_choice("sync", sync, get_args(Sync))
    check_flag("pace", pace)
    if seed is not None:
        check_number("seed", seed, 0, MOST_SEED, whole=True)
    with ExitStack() as undo:
        scene = _scene(loaded, simulate, seed, sync)
        pipeline = _pipeline(loaded, options, scene)
        undo.callback(pipeline.sinks.stop)
        pipeline.compile()  # while the rest is opened
        nodes = _nodes(loaded, scene, seed)
        if nodes is not None:
            undo.callback(nodes.close)
        loaded = pipeline.topology
        ends = [undo.enter_context(end) for end in _ends(loaded, nodes)]
        ends = _faulty(ends, loaded, nodes, faults)
        recorder, frames = _recording(record, pipeline, ends)
        undo.pop_all()  # no error: the skin closes them
    return Skin(pipeline, ends, recorder, sync=sync, pace=pace, nodes=nodes, log=frames)


def _scene(topology: Topology, scene: Any, seed: int | None, sync: Sync) -> Scene | None:
    """What simulated units play; None, for any false value, means hardware."""
    try:
        if not scene:
            return None
    except ValueError:  # an array
        raise OptionError(f"simulate: must be a scene; got {shown(scene)}") from None
    if sync != "host" and topology.sync_id is not None:
        raise OptionError(f"sync: must be 'host' with simulate; got {sync!r}")
    from skin.sim.node import played

    return played(topology, scene, seed)


def _pipeline(topology: Topology, options: Options, scene: Scene | None) -> Pipeline:
    """The pipeline; of simulated units without errors of fabrication it knows the constants."""
    if scene is None:
        return Pipeline(topology, options)
    from skin.sim.node import is_exact

    return Pipeline(topology.exact() if is_exact(scene) else topology, options)


def _nodes(topology: Topology, scene: Scene | None, seed: int | None) -> SimulatedUnits | None:
    """Simulated units that play a scene, if there is one."""
    if scene is None:
        return None
    from skin.sim.node import SimulatedUnits

    return SimulatedUnits(topology, scene, seed=seed or 0)


def _ends(topology: Topology, nodes: SimulatedUnits | None) -> Iterable[Transport]:
    """This host's ends of the buses: of the file's, opened one by one, or of simulated units."""
    if nodes is not None:
        return nodes.in_process()
    return (open_transport(bus, i) for i, bus in enumerate(topology.buses))


def _faulty(
    ends: list[Transport], topology: Topology, nodes: SimulatedUnits | None, faults: Any
) -> list[Transport]:
    """Ends that put the faults of a script, or else of the scene, into received frames; on
    simulated units by the time of the scene."""
    script = getattr(nodes.scene, "faults", None) if nodes is not None else None
    if faults is not None:
        from bus.faults import FaultScript, load_script

        is_file = isinstance(faults, str | os.PathLike)
        script = load_script(Path(faults), topology) if is_file else faults
        check_kind("faults", script, FaultScript)
    if script is None or not script.faults:
        return ends
    from bus.faults import FaultyTransport

    return [
        FaultyTransport(
            end, script, topology=topology,
            clock=None if nodes is None else partial(nodes.time_ns, end.index),
        ) for end in ends
    ]  # fmt: skip


def _recording(
    record: Any, pipeline: Pipeline, ends: list[Transport]
) -> tuple[Recorder | None, Recording | None]:
    """What records frames and states, or what records frames; None for none."""
    if record is None or isinstance(record, Recording):
        return None, record
    if not isinstance(record, str | os.PathLike):
        check_kind("record", record, Recording)
    name = os.fspath(record)
    if name.endswith(FRAMES_ALONE):
        return None, Recording(record, pipeline.topology)
    if not name.endswith(".mcap"):
        ends_known = ", ".join((".mcap", *FRAMES_ALONE))
        raise OptionError(f"record: {name}: must end in one of {ends_known}")
    from skin.io.record.recorder import Recorder

    pipeline.sinks.attach(recorder := Recorder(record, pipeline, ends))
    return recorder, None
