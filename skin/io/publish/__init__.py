"""Publishes states to other processes as topics of ROS 2, by a process next to the loop.

::

    from skin.io.publish import ros

    with skin.open("palm", simulate=True) as palm, ros(palm):
        for state in palm:
            ...
"""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.errors import OptionError, check_flag, check_number, shown
from skin.io.messages.definitions import require
from skin.io.messages.record import RecordWriter, described, record_dtype
from skin.sinks import WorkerSink
from skin.worker import RingBuffer

if TYPE_CHECKING:
    from skin.live import Skin
    from skin.state import State

__all__ = ["Publisher", "ros"]

WAITING_S = 1.0
"""Time span of the records that may wait for the process [assumed]."""
MOST_DOMAIN = 232
"""Largest domain with valid ports [derived: 7400 + 250 · 232 < 65536]."""
LONGEST = 237
"""Maximum characters of a prefix: DDS names have 256 [derived]."""
TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def ros(
    skin: Skin,
    *,
    prefix: str = "skin",
    frame: str = "skin",
    rate_hz: float | None = 100.0,
    network: bool = False,
) -> Publisher:
    """Publish a skin to ROS 2, which need not be installed here, from now on, in the domain of
    ROS_DOMAIN_ID.

    Topics: ``skin/state`` (all units), ``skin/wrench``, ``skin/contact/<slot>`` while a contact
    lasts and one wrench of zeros after it, ``skin/points`` and ``skin/forces`` (point clouds, 20
    times a second), ``/diagnostics`` once a second; ``skin/layout`` once, ``skin/poses`` when units
    move, also for late subscribers; frames of patches on ``/tf``, 20 times a second.
    docs/guides/connect.md has the messages.

    Parameters
    ----------
    skin : Skin
        As opened by `skin.open`; the publisher is attached to it.
    prefix : str
        Prefix of the topics, in place of ``skin``.
    frame : str
        Name of the skin frame in tf2; that of a patch is ``<frame>/<patch>``.
    rate_hz : float, optional
        Maximum rate of published states; every cycle if None.
    network : bool
        Publish to the subnet, as the nodes of ROS 2 do; otherwise to this machine only, unless the
        environment sets more (docs/guides/connect.md).

    Returns
    -------
    Publisher
        Ends with the skin, with its `close`, or with a ``with`` block.

    Raises
    ------
    LibraryError
        cyclonedds or rosbags is not installed.
    OptionError
        A name that ROS 2 refuses, or an option out of range.
    SkinError
        DDS cannot be started.

    Examples
    --------
    >>> with skin.open("palm", simulate=True) as palm, ros(palm):  # doctest: +SKIP
    ...     for state in palm:
    ...         pass
    """
    topology = skin.topology
    if rate_hz is not None:
        check_number("rate_hz", rate_hz, 0.01, 1e5)
    check_flag("network", network)
    bare = _prefix(prefix)
    request = {
        **described(topology), "name": bare.replace("/", "_"), "prefix": bare,
        "frame": _frame(frame), "domain": _domain(),
        "local": not (network or _reaches_out()),
    }  # fmt: skip
    return skin.attach(Publisher(skin, request, rate_hz))


class Publisher(WorkerSink):
    """The loop's side of publishing, a sink; made by `ros`."""

    def __init__(self, skin: Skin, request: dict[str, Any], rate_hz: float | None) -> None:
        require("publish", "ros", "cyclonedds", "rosbags")
        pipeline, topology = skin.pipeline, skin.topology
        super().__init__("publish", pipeline)
        self._period_ns = 0 if rate_hz is None else round(1e9 / rate_hz)
        rate = min(rate_hz or np.inf, topology.cycle_rate_hz)
        dtype = record_dtype(topology, pipeline.contact_capacity)
        self._ring = RingBuffer(dtype, max(8, round(WAITING_S * rate)))
        self._writer = RecordWriter(self._ring.records, pipeline, skin.transports)
        self._due_ns = np.iinfo(np.int64).min
        self.start("skin.io.publish.process", self._ring, request, "sent")

    def state(self, state: State) -> None:
        """Pass a state to the process, if one is due; see `Sink.state`."""
        stamp_ns = state.stamp_ns
        if stamp_ns < self._due_ns and self._due_ns - stamp_ns <= self._period_ns:
            return
        # due a period after the last due time, not after the last state: keeps the mean rate
        self._due_ns = max(self._due_ns, stamp_ns - self._period_ns) + self._period_ns
        if self._due_ns - stamp_ns > self._period_ns:  # time ran back
            self._due_ns = stamp_ns + self._period_ns
        self.look()
        at = None if self.failure else self._ring.claim()
        if at is None:
            self.lost += 1
            return
        self._writer.look()
        self._writer.state(at, state, self.lost)
        self._writer.poses(at)
        self._ring.publish()

    def sent(self) -> int:
        """States published so far; waits for the process.

        Raises
        ------
        SkinError
            The process has ended.
        """
        return int(self._worker.ask("sent")["sent"])

    def stop(self) -> None:
        """End the process after its backlog; may be called twice."""
        self._worker.close()

    def __enter__(self) -> Publisher:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _prefix(prefix: object) -> str:
    """A prefix of topics that ROS 2 takes (https://design.ros2.org/articles/topic_and_service_names),
    without slashes around it."""
    bare = prefix.removeprefix("/").removesuffix("/") if isinstance(prefix, str) else ""
    names = bare.split("/")
    if not all(map(TOKEN.fullmatch, names)) or "__" in bare or len(bare) > LONGEST:
        raise OptionError(
            "prefix: must be names of letters, digits and '_', with '/' between, that begin with "
            f"no digit and have no '__', of {LONGEST} characters at most; got {shown(prefix)}"
        )
    return bare


def _frame(frame: object) -> str:
    """A name of a frame that tf2 takes."""
    if not isinstance(frame, str) or frame[:1] == "/" or frame.split() != [frame]:
        raise OptionError(
            "frame: must be a name without blanks that does not begin with '/', as tf2 takes it; "
            f"got {shown(frame)}"
        )
    return frame


def _domain() -> int:
    """The domain of the environment."""
    text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not (text.isascii() and text.isdigit() and len(text) <= 3 and int(text) <= MOST_DOMAIN):
        raise OptionError(f"ROS_DOMAIN_ID: must be an integer from 0 to {MOST_DOMAIN}; got "
                          f"{shown(text)}")  # fmt: skip
    return int(text)


def _reaches_out() -> bool:
    """Whether the environment configures the network; cyclonedds then follows it, or its file."""
    discovery = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper()
    return discovery == "SUBNET" or bool(os.environ.get("CYCLONEDDS_URI"))
