"""`ros`: publishes a skin as topics of ROS 2, by a process next to the loop."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.errors import OptionError, check_flag, check_kind, check_number, shown
from skin.io.messages.record import described, note, record_dtype
from skin.io.messages.writer import RecordWriter
from skin.io.publish import dds
from skin.io.publish.names import check_frame, check_prefix
from skin.sinks import WorkerSink
from skin.worker import RingBuffer

if TYPE_CHECKING:
    from skin.live import Skin
    from skin.state import State

__all__ = ["Publisher", "ros"]

WAITING_S = 1.0
"""Time span of the records that may wait for the process [assumed]."""
NOTED_NS = 1_000_000_000
"""Interval of diagnostics, which ROS tools expect."""
MOST_DOMAIN = 232
"""Largest domain with valid ports [derived: 7400 + 250 · 232 < 65536]."""


def ros(
    skin: Skin,
    *,
    prefix: str = "skin",
    frame: str = "skin",
    patch_frame: str = "{}",
    rate_hz: float | None = 100.0,
    moving: bool = False,
    reliable: bool = True,
    domain: int | None = None,
    network: bool = False,
) -> Publisher:
    """Publish a skin to ROS 2, which need not be installed here, from now on.

    Topics: ``skin/state`` (all units), ``skin/layout`` (once, also for late subscribers),
    ``skin/wrench``, ``skin/contact/<slot>`` while a contact lasts and one wrench of zeros after it,
    ``skin/poses`` and ``/tf_static`` when units move, ``/diagnostics`` once a second.
    docs/guides/connect.md has the messages.

    Parameters
    ----------
    skin : Skin
        As opened by `skin.open`; the publisher is attached to it.
    prefix : str
        Prefix of the topics, in place of ``skin``.
    frame : str
        Name of the skin frame in tf2.
    patch_frame : str
        Name of a patch's frame; ``{}`` is replaced by the patch's name.
    rate_hz : float, optional
        Maximum rate of published states; every cycle if None.
    moving : bool
        Publish frames of patches on ``/tf`` with every state, not on ``/tf_static`` when they move
        (`Skin.move`): for patches that move all the time.
    reliable : bool
        Whether lost states are sent again; both kinds of subscribers match then.
    domain : int, optional
        ROS_DOMAIN_ID of the environment if not given, else 0.
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
        cyclonedds is not installed.
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
    check_flag("moving", moving)
    check_flag("reliable", reliable)
    check_flag("network", network)
    patches = _patch_frames(patch_frame, topology.patch_names)
    bare = check_prefix("prefix", prefix)
    request = {
        **described(topology), "name": bare.replace("/", "_"), "prefix": bare,
        "frame": check_frame("frame", frame),
        "patch_frames": patches,
        "moving": moving, "reliable": reliable, "domain": _domain(domain),
        "local": not (network or _reaches_out()),
    }  # fmt: skip
    return skin.attach(Publisher(skin, request, rate_hz))


def _domain(domain: int | None) -> int:
    """The given domain, or that of the environment."""
    if domain is None:
        text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
        if not (text.isascii() and text.isdigit() and len(text) <= 3):
            raise OptionError(f"ROS_DOMAIN_ID: must be an integer from 0 to {MOST_DOMAIN}; got "
                              f"{shown(text)}")  # fmt: skip
        domain = int(text)
        check_number("ROS_DOMAIN_ID", domain, 0, MOST_DOMAIN, whole=True)
    check_number("domain", domain, 0, MOST_DOMAIN, whole=True)
    return domain


class Publisher(WorkerSink):
    """The loop's side of publishing, a sink; made by `ros`."""

    def __init__(self, skin: Skin, request: dict[str, Any], rate_hz: float | None) -> None:
        dds.check_library()
        pipeline, topology = skin.pipeline, skin.topology
        super().__init__("publish", pipeline)
        self._transports, poses = skin.transports, pipeline.poses
        # the layout has those of the topology
        self._poses = poses if poses[0] is topology.position else None
        dtype = record_dtype(topology, pipeline.contact_capacity, (("has_moved", "i8", ()),))
        self._record = np.zeros(1, dtype)
        self._writer = RecordWriter(self._record, pipeline.contacts, pipeline.assembler.totals)
        self._period_ns = 0 if rate_hz is None else round(1e9 / rate_hz)
        rate = min(rate_hz or np.inf, topology.cycle_rate_hz)
        self._ring = RingBuffer(self._record.dtype, max(8, round(WAITING_S * rate)))
        self._due_ns = self._note_ns = np.iinfo(np.int64).min
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
        claimed = None if self.failure else self._ring.claim()
        if claimed is None:
            self.missed += 1
            return
        record, poses = self._record, self.pipeline.poses
        self._writer.write(state)
        record["lost_cycles"] = self.missed
        record["has_moved"] = poses is not self._poses
        if record["has_moved"]:
            self._poses = poses
            record["pose"][0, :3], record["pose"][0, 3:] = poses[0], poses[1].reshape(9, -1)
        if not 0 <= stamp_ns - self._note_ns < NOTED_NS:
            self._note_ns = stamp_ns
            note(record, state, self._transports)
        claimed[:] = record
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


def _patch_frames(frame: str, names: Sequence[str]) -> list[str]:
    """Names of the frames of the patches."""
    check_kind("patch_frame", frame, str)
    if names and frame.count("{}") != 1:
        raise OptionError(
            f"patch_frame: must have {{}} once, for the name of a patch; got {frame!r}"
        )
    return [check_frame("patch_frame", frame.replace("{}", name)) for name in names]


def _reaches_out() -> bool:
    """Whether the environment configures the network; cyclonedds then follows it, or its file."""
    discovery = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper()
    return discovery == "SUBNET" or bool(os.environ.get("CYCLONEDDS_URI"))
