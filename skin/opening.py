"""From a topology to an open skin: its buses, or simulated units in their place."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import topology as topology_package
from bus.logs import Recording
from bus.open import open_transport
from bus.transport import Transport
from skin.compiling import announcer
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
from skin.live import Skin, Sync, Wait
from skin.options import DType, Estimator, Options, Sweeps
from skin.pipeline import Pipeline
from topology import Topology

if TYPE_CHECKING:
    from bus.faults import FaultScript
    from skin.calibrate.background import Learning
    from skin.contact.slip import SlipSettings
    from skin.io.record.recorder import Recorder
    from skin.physics.stencil import Stencil
    from skin.sim.node import SimulatedUnits
    from skin.sim.scene import Scene
    from skin.sim.scenes.script import SceneFile

__all__ = ["open"]


def open(
    source: Topology | str | Path,
    *,
    want: Collection[str] | None = None,
    estimator: Estimator | None = None,
    dtype: DType = "float32",
    sweeps: Sweeps = 1,
    ambient: bool = True,
    auto_tare: bool = True,
    creep: bool = True,
    skip: bool = False,
    slip: SlipSettings | None = None,
    false_contacts_per_day: float = 1.0,
    capacity: int | None = None,
    stencil: Stencil | str | os.PathLike[str] | None = None,
    zeros: str | os.PathLike[str] | None = None,
    learn: bool = False,
    sync: Sync = "host",
    wait: Wait = "event",
    pace: bool = True,
    deadline_s: float | None = None,
    simulate: bool | str | Path | SceneFile | Scene | None = False,
    repeat: bool = False,
    faults: FaultScript | str | os.PathLike[str] | None = None,
    transports: Iterable[Transport] | None = None,
    seed: int | None = None,
    log: str | os.PathLike[str] | Recording | None = None,
    record: str | os.PathLike[str] | None = None,
) -> Skin:
    """Open the buses of a topology and decode what they carry.

    Parameters
    ----------
    source : Topology, str or Path
        A loaded topology, a file, or the name of a built-in one ("palm", "fingertip", …).
    want, estimator, dtype, sweeps, ambient, auto_tare, creep, skip, slip, capacity, …
        What is computed, and how: see `skin.options.Options`; `stencil` may be a file.
    zeros, learn : path, optional, and bool
        Carry zeros from run to run (`skin.calibrate.zeros`); learn fields of neighbours.
    sync, wait : "host" or "bus", "event" or "deadline"
        SYNC is sent by this host, or by another node. Wake when cycles are usually complete (least
        latency), or at the deadline (least work).
    pace, deadline_s : bool, and float, optional
        Keep the cycle rate, or start each cycle at once; longest wait after a SYNC (0.9 periods).
    simulate, repeat : bool, str, Path, SceneFile or Scene; and bool
        Attach simulated units: True for the scene "demo", a name of `skin.sim.scenes.names`, a
        file, a loaded one or your own; false: none. At its end it repeats, or ends the loop.
    faults : FaultScript, str or Path, optional
        Faults put into received frames (docs/guides/faults.md); a scene's own faults if not given.
    transports : iterable of Transport, optional
        Transports to use instead of opening the file's buses, one for each bus, in order.
    seed : int, optional
        Seed of the simulated noise, and of a scene's own faults; the scene's, or 0, if not given.
    log, record : path, optional
        Write all frames as candump (.log, .log.gz) or BLF (.blf), or to a `Recording`; record
        frames and states as MCAP (a new .mcap), for `skin.replay` and other viewers.

    Raises
    ------
    topology.TopologyError, bus.BusOpenError, bus.FaultScriptError, bus.LogError, SkinError
        A file, a bus or an option that cannot be used; every problem of a file is listed.
    """
    loaded = source if isinstance(source, Topology) else topology_package.load(source)
    with ExitStack() as undo:
        ends = [undo.enter_context(end) for end in _given(transports)]
        options = Options(
            want=want, estimator=estimator, dtype=dtype, sweeps=sweeps, ambient=ambient,
            auto_tare=auto_tare, creep=creep, skip=skip, slip=slip, capacity=capacity,
            false_contacts_per_day=false_contacts_per_day, stencil=_stencil(stencil, loaded),
        )  # fmt: skip
        _check(sync, wait, pace, learn, seed, log)
        _begin_to_compile(undo, options)
        played = _scene(simulate), seed, repeat
        loaded, nodes = _nodes(undo, loaded, *played, transports is not None, sync)
        ends = _checked([*ends, *_ends(undo, loaded, nodes, transports)], loaded, nodes, faults)
        pipeline = Pipeline(loaded, options, deadline_s=deadline_s)
        sinks = _sinks(undo, pipeline, ends, zeros, record, learn)
        frames = Recording(log, loaded) if isinstance(log, str | os.PathLike) else log
        undo.pop_all()  # no error: the skin closes them
    return Skin(pipeline, ends, *sinks, sync=sync, wait=wait, pace=pace, nodes=nodes, log=frames)


def _begin_to_compile(undo: ExitStack, options: Options) -> None:
    """Compile by several processes until the first state, the longest kernel first."""
    undo.callback(announcer().hold().finish)
    Pipeline.prepare(options)


def _sinks(
    undo: ExitStack, pipeline: Pipeline, ends: list[Transport], zeros: Any, record: Any, learn: bool
) -> tuple[Recorder | None, Learning | None]:
    """The requested sinks, on a pipeline that has the zeros of the run before."""
    if zeros is not None:
        pipeline.take_zeros(zeros)
    undo.callback(pipeline.sinks.stop)
    recorder = learning = None
    if record is not None:
        from skin.io.record.recorder import Recorder

        pipeline.attach(recorder := Recorder(record, pipeline, ends))
    if learn:
        from skin.calibrate.background import Learning

        pipeline.attach(learning := Learning(pipeline))
    return recorder, learning


def _stencil(given: Any, topology: Topology) -> Stencil | None:
    """The learned fields of neighbours, read if a file is given."""
    if not isinstance(given, str | os.PathLike):
        return given
    from skin.physics.stencil import Stencil

    return Stencil.load(Path(given), topology)


def _check(sync: str, wait: str, pace: bool, learn: bool, seed: int | None, log: object) -> None:
    for name, value, known in (("sync", sync, get_args(Sync)), ("wait", wait, get_args(Wait))):
        check_choice(name, value, known)
    check_flag("pace", pace)
    check_flag("learn", learn)
    if seed is not None:
        check_number("seed", seed, 0, MOST_SEED, whole=True)
    if log is not None and not isinstance(log, str | os.PathLike):
        check_kind("log", log, Recording)


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
    from skin.sim.attached import nodes_of

    nodes = nodes_of(topology, scene, seed, repeat)
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
    from skin.sim.attached import in_process

    return [undo.enter_context(end) for end in in_process(nodes)]


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
        from skin.sim.attached import own_faults

        script = own_faults(nodes.scene)
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
