"""The live view of a skin in a browser: `show`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skin.errors import check_number
from skin.state import State
from skin.view.server import check_installed
from skin.view.snapshot import RATE_HZ, Snapshots, snapshot_dtype
from skin.worker import RingBuffer, Worker

if TYPE_CHECKING:
    from skin.live import Skin
    from skin.pipeline import Pipeline

__all__ = ["HOST", "View", "show"]

HOST = "127.0.0.1"
SLOTS = 8
"""Snapshots that may wait for the view: a quarter of a second."""
KEPT_S = 60.0
MOST_BYTES = 2**28
"""Of the snapshots that are kept."""
TOLD = 6
"""Units that were refused and are named."""


class View:
    """A view of a running skin; made by `show`.

    Attributes
    ----------
    address : str
        For a browser.
    snapshots : Snapshots
        `taken` and `missed` count.
    """

    def __init__(self, source: Any, host: str, port: int | None) -> None:
        check_installed()
        self._source, topology = source, source.topology
        pipeline: Pipeline = source.pipeline
        timing = getattr(source, "timing", None)
        dtype = snapshot_dtype(topology.n)
        ring = RingBuffer(dtype, SLOTS)
        self.snapshots = Snapshots(ring, pipeline, timing)
        self._ring, self._calls, self._zeros = ring, 0, _summary(pipeline)
        self._worker = Worker("skin.view.process", ring, {
            "host": host, "port": port, "title": topology.name, "area": topology.area.tolist(),
            "names": list(topology.unit_names), "rate_hz": topology.cycle_rate_hz,
            "can_tare": timing is not None,
            "kept": min(round(KEPT_S * RATE_HZ), max(60, MOST_BYTES // dtype.itemsize)),
        })  # fmt: skip
        try:
            self.address: str = self._worker.ask("address")["address"]
        except BaseException:
            self._worker.close()
            raise
        pipeline.watch(self._look)

    def _look(self, state: State) -> None:
        """See a cycle, in the skin's own loop."""
        if not self.snapshots.look(state):
            return
        pipeline: Pipeline = self._source.pipeline
        calls = self._ring.calls
        if calls != self._calls:
            self._calls = calls
            pipeline.retake_zeros()
            self._zeros = _summary(pipeline)
        elif (zeros := _summary(pipeline)) != self._zeros:
            self._zeros = zeros
            self._worker.tell("zeros", text=_told(pipeline))

    @property
    def process_id(self) -> int:
        """Of the view's own process."""
        return self._worker.process_id

    @property
    def waiting(self) -> int:
        """Snapshots that the view has not seen yet."""
        return self._ring.waiting

    @property
    def alive(self) -> bool:
        """Whether the view is still served."""
        return self._worker.alive

    def export(self, file: str | os.PathLike[str], seconds: float = 10.0) -> None:
        """Write what is seen, and the seconds before it, as one HTML file; waits for it.

        Parameters
        ----------
        file : path
        seconds : float
            0 for the moment alone.

        Raises
        ------
        SkinError
            The file cannot be written, or the view has ended.
        """
        check_number("seconds", seconds, 0.0, KEPT_S)
        self._worker.ask("export", file=str(Path(file).absolute()), seconds=float(seconds))

    def close(self) -> None:
        """End the view; the skin goes on. Closing twice is fine."""
        self._source.pipeline.unwatch(self._look)
        self._worker.close()

    def __enter__(self) -> View:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<View of {self._source.topology.name!r} at {self.address}>"


def show(source: Skin | Any, *, host: str = HOST, port: int | None = None) -> View:
    """Show a skin in a browser, while it is iterated over.

    The view is a process of its own: the skin's loop copies a snapshot 30 times a second. Browsers
    may come and go. It ends with `View.close`, or with this process.

    Parameters
    ----------
    source : Skin or DecodedLog
        Or anything else with a `topology` and a `pipeline` that states come from.
    host : str
        Address of this machine to listen on; by default nobody else can reach it. Whoever reaches
        it sees the skin and can tare it.
    port : int, optional
        The first free one from 8080 on if not given.

    Raises
    ------
    LibraryError
        viser is not installed.
    SkinError
        The port is in use, or the host is none of this machine.

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
    return View(source, host, port)


def _summary(pipeline: Pipeline) -> tuple[object, ...]:
    """Changes whenever zeros were taken or refused."""
    zeros = pipeline.zeros
    return () if zeros is None else (len(zeros.taken), id(zeros.refused))


def _told(pipeline: Pipeline) -> str:
    """Whose zeros were taken, and whose were refused, and why."""
    assert pipeline.zeros is not None
    report = pipeline.zeros.report()
    refused = report["refused"]
    text = f"{len(report['tared'])} units tared"
    if refused:
        named = "; ".join(f"{name}: {why}" for name, why in list(refused.items())[:TOLD])
        text += f", {len(refused)} refused: {named}"
        text += f"; and {len(refused) - TOLD} more" if len(refused) > TOLD else ""
    return text
