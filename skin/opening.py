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
    from skin.contact.slip import SlipSettings
    from skin.physics.stencil import Stencil
    from skin.sim.node import Nodes
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
    tare: bool = True,
    creep: bool = True,
    skip: bool = False,
    slip: SlipSettings | None = None,
    false_contacts_per_day: float = 1.0,
    stencil: Stencil | str | os.PathLike[str] | None = None,
    zeros: str | os.PathLike[str] | None = None,
    learn: bool = False,
    sync: Sync = "host",
    wait: Wait = "event",
    pace: bool = True,
    deadline_s: float | None = None,
    simulate: bool | str | Path | SceneFile | Scene | None = False,
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
    want, estimator, dtype, sweeps, ambient, tare, creep, skip, slip, false_contacts_per_day, …
        What is computed, and how: see `skin.options.Options`; of a stencil a file will do.
    zeros, learn : path, optional, and bool
        Carry zeros from run to run (`skin.calibrate.zeros`); learn fields of neighbours.
    sync : "host" or "bus"
        Who sends SYNC: this host, or another node (then this end only listens).
    wait : "event" or "drain"
        Wake when cycles use to be complete (least latency), or at the deadline (least work).
    pace : bool
        Keep the cycle rate of the topology; False asks for the next cycle as soon as one is done.
    deadline_s : float, optional
        That a cycle waits for frames after its SYNC; 0.9 periods if not given.
    simulate : bool, str, Path, SceneFile or Scene
        Attach simulated units: True for the scene "demo", a name of `skin.sim.scenes.names`, a
        file, a loaded one (`skin.sim.load_scene`), or your own; what is false: none.
    faults : FaultScript, str or Path, optional
        What is done to the frames that come (docs/faults.md); a scene's own faults if not given.
    transports : iterable of Transport, optional
        Transports to use instead of opening the file's buses, one for each bus, in order.
    seed : int, optional
        Seed of the simulated noise, and of a scene's own faults; the scene's, or 0, if not given.
    log, record : path, optional
        Write down all frames as candump (.log, .log.gz) or BLF (.blf), or by a `Recording`; record
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
            want=want, estimator=estimator, dtype=dtype, sweeps=sweeps, ambient=ambient, tare=tare,
            creep=creep, skip=skip, slip=slip, false_contacts_per_day=false_contacts_per_day,
            stencil=_stencil(stencil, loaded),
        )  # fmt: skip
        _check(sync, wait, pace, learn, seed, log)
        undo.callback(announcer().hold().finish)
        loaded, nodes = _nodes(undo, loaded, _scene(simulate), seed, transports is not None, sync)
        ends += [undo.enter_context(end) for end in _ends(loaded, nodes, transports)]
        ends = _checked(ends, loaded, nodes, faults)
        pipeline = _pipeline(undo, loaded, options, ends, deadline_s, zeros, learn, record)
        recording = Recording(log, loaded) if isinstance(log, str | os.PathLike) else log
        undo.pop_all()  # all is well: the skin closes them
    return Skin(pipeline, ends, sync=sync, wait=wait, pace=pace, nodes=nodes, recording=recording)


def _pipeline(
    undo: ExitStack,
    topology: Topology,
    options: Options,
    ends: list[Transport],
    deadline_s: float | None,
    zeros: Any,
    learn: bool,
    record: Any,
) -> Pipeline:
    """The pipeline, with what outlasts a run; recorded where that is asked for."""
    if record is None:
        pipeline = Pipeline(topology, options, deadline_s=deadline_s)
        if zeros is not None:
            pipeline.take_zeros(zeros)
    else:
        from skin.record.pipeline import RecordedPipeline

        pipeline = RecordedPipeline(
            topology, options, deadline_s=deadline_s, file=record, zeros=zeros
        )
        undo.callback(pipeline.recorder.close)
        pipeline.recorder.watch(ends)
    if learn:
        pipeline.learn()
        if pipeline.learning is not None:
            undo.callback(pipeline.learning.close)
    return pipeline


def _stencil(given: Any, topology: Topology) -> Stencil | None:
    """What was learned of the neighbours' fields, read where its file is given."""
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
    """The user's own transports."""
    ends: list[Any]
    try:
        ends = [] if transports is None else list(transports)
    except TypeError:  # one alone
        ends = [transports]
    for end in ends:
        check_kind("transports", end, Transport)
    return ends


def _scene(simulate: Any) -> Any:
    """What simulated units are to play, False for none: all that is false means hardware."""
    try:
        return simulate if simulate else False
    except ValueError:  # an array, which is no scene
        raise OptionError(f"simulate: must be a scene; got {shown(simulate)}") from None


def _nodes(
    undo: ExitStack, topology: Topology, scene: Any, seed: int | None, has_transports: bool,
    sync: Sync,
) -> tuple[Topology, Nodes | None]:  # fmt: skip
    """Simulated units, where a scene is given, and the topology as it is known of them."""
    if not scene:
        return topology, None
    _check_simulated(has_transports, sync, topology)
    from skin.sim.attached import nodes_of

    nodes = nodes_of(topology, scene, seed)
    undo.callback(nodes.close)
    return topology.exact() if nodes.exact else topology, nodes


def _ends(topology: Topology, nodes: Nodes | None, transports: object) -> Iterable[Transport]:
    """This host's ends of the buses: of the file's, opened one by one, or of simulated units'; none
    where transports are given."""
    if transports is not None:
        return ()
    if nodes is None:
        return (open_transport(bus, i) for i, bus in enumerate(topology.buses))
    from skin.sim.attached import in_process

    return in_process(nodes)


def _script(faults: Any, topology: Topology) -> FaultScript | None:
    """The faults that are given, read where that is their file."""
    if faults is None:
        return None
    from bus.faults import FaultScript, load_script

    if isinstance(faults, str | os.PathLike):
        return load_script(Path(faults), topology)
    check_kind("faults", faults, FaultScript)
    script: FaultScript = faults
    return script


def _checked(
    ends: list[Transport], topology: Topology, nodes: Nodes | None, faults: Any
) -> list[Transport]:
    """One end for each bus, with what a script, or else the scene, does to the frames that come
    from it: on simulated units by the time of the scene."""
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
    """Refuse what means nothing together with simulated units."""
    if has_transports:
        raise OptionError("transports: must not be given with simulate; got both")
    if sync != "host" and topology.buses[0].sync_id is not None:
        raise OptionError(f"sync: must be 'host' with simulate; got {sync!r}")
