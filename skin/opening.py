"""From a topology to an open skin: its buses, or simulated units in their place."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import topology as topology_package
from bus.logs import Recording
from bus.open import open_transport
from bus.transport import Transport
from skin.compiling import announcer
from skin.errors import OptionError, SkinError
from skin.live import Skin, Sync, Wait
from skin.options import DType, Estimator, Options, Sweeps
from skin.pipeline import Pipeline
from topology import Topology

if TYPE_CHECKING:
    from skin.contact.slip import SlipSettings
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
    skip: bool = False,
    slip: SlipSettings | None = None,
    false_contacts_per_day: float = 1.0,
    sync: Sync = "host",
    wait: Wait = "event",
    pace: bool = True,
    deadline_s: float | None = None,
    simulate: bool | str | Path | SceneFile | Scene | None = False,
    transports: Iterable[Transport] | None = None,
    seed: int = 0,
    log: str | os.PathLike[str] | Recording | None = None,
) -> Skin:
    """Open the buses of a topology and decode what they carry.

    Parameters
    ----------
    source : Topology, str or Path
        A loaded topology, a file, or the name of a built-in one ("palm", "fingertip", …).
    want, estimator, dtype, sweeps, ambient, skip, slip, false_contacts_per_day
        What is computed, and how: see `skin.options.Options`.
    sync : "host" or "bus"
        Who sends SYNC: this host, or another node (then this end only listens).
    wait : "event" or "drain"
        Wake for every arrival (least latency), or once a cycle at its deadline (least work).
    pace : bool
        Keep the cycle rate of the topology; False asks for the next cycle as soon as one is done.
    deadline_s : float, optional
        How long after its SYNC a cycle waits for missing frames; 0.9 periods if not given.
    simulate : bool, str, Path, SceneFile or Scene
        Attach simulated units instead of opening the buses: True for the scene "demo", the name of
        a scene (`skin.sim.scenes.names`), its file, a loaded one (`skin.sim.load_scene`), or a
        scene of your own. False, None and "" open the buses.
    transports : iterable of Transport, optional
        Transports to use instead of opening the file's buses, one for each bus, in order.
    seed : int
        Seed of the simulated noise.
    log : path or Recording, optional
        Write down all frames, SYNC included, in the order in which they are decoded: candump (.log,
        .log.gz) or BLF (.blf). `skin.decode_log` and `skin decode` take the file as it is.

    Returns
    -------
    Skin
        Context manager and iterator of `State`.

    Raises
    ------
    topology.TopologyError
        The file cannot be used; every problem is listed.
    bus.BusOpenError
        A bus cannot be opened.
    bus.LogError
        No log can be written there.
    skin.errors.SkinError
        An option is not one of those there are.
    """
    loaded = source if isinstance(source, Topology) else topology_package.load(source)
    nodes = None
    with ExitStack() as undo:
        ends = [undo.enter_context(end) for end in transports or ()]
        options = Options(
            want=want, estimator=estimator, dtype=dtype, sweeps=sweeps, ambient=ambient, skip=skip,
            slip=slip, false_contacts_per_day=false_contacts_per_day,
        )  # fmt: skip
        _check(sync, wait, deadline_s)
        _check_simulated(bool(simulate), transports is not None, sync, loaded)
        undo.callback(announcer().hold().finish)
        if simulate:
            from skin.sim.attached import in_process, nodes_of

            nodes = nodes_of(loaded, simulate, seed)
            undo.callback(nodes.close)
            ends = [undo.enter_context(end) for end in in_process(nodes)]
        elif transports is None:
            ends = [undo.enter_context(open_transport(b, i)) for i, b in enumerate(loaded.buses)]
        _check_ends(ends, loaded)
        pipeline = Pipeline(loaded, options, deadline_s=deadline_s)
        is_path = isinstance(log, str | os.PathLike)
        recording = Recording(log, loaded) if is_path else log
        opened = Skin(
            pipeline, ends, sync=sync, wait=wait, pace=pace, nodes=nodes, recording=recording
        )
        undo.pop_all()  # all is well: the skin closes them
    return opened


def _check(sync: str, wait: str, deadline_s: float | None) -> None:
    for name, value, known in (("sync", sync, get_args(Sync)), ("wait", wait, get_args(Wait))):
        if value not in known:
            raise OptionError.unknown(name, value, known)
    if deadline_s is not None and not deadline_s > 0.0:
        raise OptionError(f"deadline_s: must be above 0; got {deadline_s}")


def _check_simulated(
    is_simulated: bool, has_transports: bool, sync: Sync, topology: Topology
) -> None:
    """Refuse what means nothing together."""
    if is_simulated and has_transports:
        raise OptionError("transports: must not be given with simulate; got both")
    if is_simulated and sync != "host" and topology.buses[0].sync_id is not None:
        raise OptionError(f"sync: must be 'host' with simulate; got {sync!r}")


def _check_ends(ends: list[Transport], topology: Topology) -> None:
    if len(ends) != (buses := len(topology.buses)):
        raise SkinError(f"transports: must be one for each of {buses} buses; got {len(ends)}")
