"""The live view of a skin in a browser: `show`."""

from __future__ import annotations

from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.errors import check_number
from skin.io.messages.definitions import require
from skin.sinks import WorkerSink
from skin.state import State
from skin.view.snapshot import Snapshots, snapshot_dtype
from skin.worker import RingBuffer
from topology.packed import packed

if TYPE_CHECKING:
    from skin.live import Skin
    from skin.pipeline import Pipeline

__all__ = ["HOST", "View", "show"]

HOST = "127.0.0.1"
SLOTS = 8
"""Snapshots that may wait for the view, as a time span: a quarter of a second."""
LISTED = 6
"""Refused units that are named."""


class View(WorkerSink):
    """A view of a running skin, a sink; made by `show`. It stays after the skin is closed.

    Attributes
    ----------
    address : str
        To open in a browser.
    snapshots : Snapshots
        Counters `taken` and `missed`.
    """

    def __init__(self, source: Any, host: str, port: int | None) -> None:
        require("view", "view", "viser")
        pipeline: Pipeline = source.pipeline
        super().__init__("view", pipeline)
        self._source, topology = source, source.topology
        timing = getattr(source, "timing", None)
        self._ring = RingBuffer(snapshot_dtype(topology, pipeline.contact_capacity), SLOTS)
        self.snapshots = Snapshots(self._ring, pipeline, timing, getattr(source, "transports", ()))
        self._tares, self._moves, self._zeros = 0.0, 0.0, _summary(pipeline)
        joints = () if topology.robot is None else topology.robot.joint_names
        with NamedTemporaryFile() as file:  # memory of both processes, even when it has no name
            # what browsers ask for: how often to tare, how often to move, and the joints
            self._asked = np.asarray(np.memmap(file, float, "w+", shape=2 + len(joints)))
            self.address: str = self.start("skin.view.process", self._ring, {
                "host": host, "port": port, "topology": packed(topology),
                "is_live": timing is not None, "asked": file.name,
            }, "address")["address"]  # fmt: skip

    def frames(self, frames: np.ndarray) -> None:
        """Before frames are decoded: move the joints as sliders were moved; see `Sink.frames`."""
        if self._asked[1] != self._moves:
            self._moves = self._asked[1]
            self._source.move_joints(self._asked[2:].copy())

    def state(self, state: State) -> None:
        """Take a snapshot when due, within the skin's loop; see `Sink.state`."""
        if self.failure is not None or not self.snapshots.look(state):
            return
        self.lost = self.snapshots.missed
        self.look()
        pipeline = self.pipeline
        if self._asked[0] != self._tares:
            self._tares = self._asked[0]
            pipeline.retake_zeros()
            self._zeros = _summary(pipeline)
        elif (zeros := _summary(pipeline)) != self._zeros:
            self._zeros = zeros
            self._worker.send("zeros", text=_tare_report(pipeline))

    @property
    def waiting(self) -> int:
        """Snapshots that the view has not read yet."""
        return self._ring.waiting

    def __enter__(self) -> View:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<View of {self._source.topology.name!r} at {self.address}>"


def show(source: Skin | Any, *, host: str = HOST, port: int | None = None) -> View:
    """Show a skin in a browser, while it is iterated over.

    The view is a process of its own: the skin's loop copies a snapshot 30 times a second. Browsers
    may connect and leave. It ends with `View.close`, or with this process.

    Parameters
    ----------
    source : Skin or DecodedLog
        Or another object with a `topology` and a `pipeline` that its states come from.
    host : str
        Address of this machine to listen on; by default only this machine can connect. Every client
        sees the skin, can tare it and set the joints of its model.
    port : int, optional
        The first free one from 8080 on if not given.

    Raises
    ------
    LibraryError
        viser is not installed.
    SkinError
        The port is in use, or the host is not an address of this machine.

    Examples
    --------
    >>> import skin
    >>> with skin.open("palm", simulate=True) as palm:  # doctest: +SKIP
    ...     view = skin.view.show(palm)
    ...     print(view.address)
    ...     for state in palm:
    ...         pass
    """
    if port is not None:
        check_number("port", port, 0, 65535, whole=True)
    view = View(source, host, port)
    source.pipeline.sinks.attach(view)
    return view


def _summary(pipeline: Pipeline) -> tuple[object, ...]:
    """Changes whenever zeros were taken or refused."""
    zeros = pipeline.zeros
    return () if zeros is None else (len(zeros.taken), id(zeros.refused))


def _tare_report(pipeline: Pipeline) -> str:
    """Units whose zeros were taken, and refused units with the reason."""
    assert pipeline.zeros is not None
    report = pipeline.zeros.report()
    named = [f"{name}: {why}" for name, why in report["refused"].items()]
    text = f"{len(report['tared'])} units tared, {len(named)} refused"
    return ": ".join([text, *(["; ".join(named[:LISTED])] if named else [])])
