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
from skin.compiling import announce
from skin.errors import (
    MOST_SEED,
    OptionError,
    SkinError,
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

FRAMES_ALONE = (".log", ".log.gz", ".blf")
"""Ends of the names of files that hold frames without states."""


def open(
    source: Topology | str | Path,
    *,
    want: Collection[str] | None = None,
    slip: SlipSettings | None = None,
    options: Options | None = None,
    sync: Sync = "host",
    pace: bool = True,
    deadline_s: float | None = None,
    transports: Iterable[Transport] | None = None,
    simulate: bool | str | Path | SceneFile | Scene | None = False,
    seed: int | None = None,
    repeat: bool = False,
    faults: FaultScript | str | os.PathLike[str] | None = None,
    record: str | os.PathLike[str] | Recording | None = None,
) -> Skin:
    """Open the buses of a topology and decode what they carry.

    Parameters
    ----------
    source : Topology, str or Path
        A loaded topology, a file, or the name of a built-in one ("palm", "fingertip", …).
    want, slip : collection of str, and SlipSettings, optional
        What is computed, and settings of slip: those of `options`, which may have them instead.
    options : Options, optional
        How it is computed; see `skin.Options`.
    sync : "host" or "bus"
        SYNC is sent by this host, or by another node.
    pace, deadline_s : bool, and float, optional
        Keep the cycle rate, or start each cycle at once; longest wait after a SYNC (0.9 periods).
    transports : iterable of Transport, optional
        Transports to use instead of opening the file's buses, one for each bus, in order.
    simulate : bool, str, Path, SceneFile or Scene
        Attach simulated units: True for the scene "demo", a name of `skin.sim.scenes.names`, a
        file, a loaded one or your own; false: none.
    seed, repeat : int, optional, and bool
        Seed of the simulated noise, and of a scene's own faults (the scene's, or 0, if not given);
        a scene that is over repeats, or ends the loop.
    faults : FaultScript, str or Path, optional
        Faults put into received frames (docs/guides/faults.md); a scene's own faults if not given.
    record : path, or Recording, optional
        A new file: frames and states as MCAP (.mcap), for `skin.replay` and other viewers; frames
        alone as candump (.log, .log.gz) or BLF (.blf), or to a `Recording`.

    Raises
    ------
    topology.TopologyError, bus.BusOpenError, bus.FaultScriptError, bus.LogError, SkinError
        A file, a bus or an option that cannot be used; every problem of a file is listed.
    """
    loaded = source if isinstance(source, Topology) else topology_package.load(source)
    with ExitStack() as undo:
        ends = [undo.enter_context(end) for end in _given(transports)]
        options = _options(options, want, slip)
        check_choice("sync", sync, get_args(Sync))
        check_flag("pace", pace)
        if seed is not None:
            check_number("seed", seed, 0, MOST_SEED, whole=True)
        announce()
        played = _scene(simulate), seed, repeat
        loaded, nodes = _nodes(undo, loaded, *played, transports is not None, sync)
        ends = _checked([*ends, *_ends(undo, loaded, nodes, transports)], loaded, nodes, faults)
        pipeline = Pipeline(loaded, options, deadline_s=deadline_s)
        recorder, frames = _recording(undo, record, pipeline, ends)
        undo.pop_all()  # no error: the skin closes them
    return Skin(pipeline, ends, recorder, sync=sync, pace=pace, nodes=nodes, log=frames)


def _options(
    options: Options | None, want: Collection[str] | None, slip: SlipSettings | None
) -> Options:
    """The options, with what was given besides."""
    if options is None:
        return Options(want=want, slip=slip)
    check_kind("options", options, Options)
    given = {"want": want, "slip": slip}
    return replace(options, **{name: one for name, one in given.items() if one is not None})


def _recording(
    undo: ExitStack, record: Any, pipeline: Pipeline, ends: list[Transport]
) -> tuple[Recorder | None, Recording | None]:
    """What records frames and states, or what records frames; None for none."""
    undo.callback(pipeline.sinks.stop)
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

    pipeline.attach(recorder := Recorder(record, pipeline, ends))
    return recorder, None


def _given(transports: Any) -> list[Transport]:
    """The caller's own transports."""
    ends: list[Any]
    try:
        ends = [] if transports is None else list(transports)
    except TypeError:  # a single one
        ends = [transports]
    for end in ends:
        check_kind("transports", end, Transport)
    return ends


def _scene(simulate: Any) -> Any:
    """The scene of simulated units; False for hardware, which any false value means."""
    try:
        return simulate if simulate else False
    except ValueError:  # an array
        raise OptionError(f"simulate: must be a scene; got {shown(simulate)}") from None


def _nodes(
    undo: ExitStack, topology: Topology, scene: Any, seed: int | None, repeat: bool,
    has_transports: bool, sync: Sync,
) -> tuple[Topology, SimulatedUnits | None]:  # fmt: skip
    """Simulated units, if a scene is given, and the topology with their calibration."""
    check_flag("repeat", repeat)
    if not scene:
        return topology, None
    _check_simulated(has_transports, sync, topology)
    from skin.sim.node import simulated_units

    nodes = simulated_units(topology, scene, seed, repeat)
    undo.callback(nodes.close)
    return topology.exact() if nodes.exact else topology, nodes


def _ends(
    undo: ExitStack, topology: Topology, nodes: SimulatedUnits | None, transports: object
) -> list[Transport]:
    """This host's ends of the buses: of the file's, opened one by one, or of simulated units; none
    where transports are given."""
    if transports is not None:
        return []
    if nodes is None:
        opened = (open_transport(bus, i) for i, bus in enumerate(topology.buses))
        return [undo.enter_context(end) for end in opened]
    return [undo.enter_context(end) for end in nodes.in_process()]


def _script(faults: Any, topology: Topology) -> FaultScript | None:
    """The given faults, read if a file is given."""
    if faults is None:
        return None
    from bus.faults import FaultScript, load_script

    if isinstance(faults, str | os.PathLike):
        return load_script(Path(faults), topology)
    check_kind("faults", faults, FaultScript)
    script: FaultScript = faults
    return script


def _checked(
    ends: list[Transport], topology: Topology, nodes: SimulatedUnits | None, faults: Any
) -> list[Transport]:
    """One end for each bus, which puts the faults of a script, or else of the scene, into received
    frames; on simulated units by the time of the scene."""
    if len(ends) != (buses := len(topology.buses)):
        raise SkinError(f"transports: must be one for each of {buses} buses; got {len(ends)}")
    script = _script(faults, topology)
    if script is None and nodes is not None:
        script = getattr(nodes.scene, "faults", None)
    if script is None or not script.faults:
        return ends
    from bus.faults import FaultyTransport

    return [
        FaultyTransport(
            end, script, topology=topology,
            clock=None if nodes is None else partial(nodes.time_ns, end.index),
        ) for end in ends
    ]  # fmt: skip


def _check_simulated(has_transports: bool, sync: Sync, topology: Topology) -> None:
    """Refuse options that exclude simulated units."""
    if has_transports:
        raise OptionError("transports: must not be given with simulate; got both")
    if sync != "host" and topology.buses[0].sync_id is not None:
        raise OptionError(f"sync: must be 'host' with simulate; got {sync!r}")
