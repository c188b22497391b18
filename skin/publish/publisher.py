"""`ros`: what a skin feels as topics of ROS 2, published by a process beside the loop."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.errors import OptionError, check_flag, check_kind, check_number, shown
from skin.messages.record import described, note
from skin.publish import dds
from skin.publish.names import check_frame, check_prefix
from skin.publish.snapshot import fill, snapshot_dtype
from skin.worker import RingBuffer, Worker

if TYPE_CHECKING:
    from skin.live import Skin
    from skin.state import State

__all__ = ["Publisher", "ros"]

WAITING_S = 1.0
"""Of records that wait for the process, at most [assumed]."""
NOTED_NS = 1_000_000_000
"""Between two diagnoses: what diagnostic tools of ROS expect."""
MOST_DOMAIN = 232
"""Largest domain whose ports there are [derived: 7400 + 250 · 232 < 65536]."""


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
    """Publish what a skin feels to ROS 2, which need not be installed here.

    Topics: ``skin/state`` (all units), ``skin/layout`` (once, for late subscribers too),
    ``skin/wrench``, ``skin/contact/<slot>`` as long as it lasts and zeros once it has ended,
    ``skin/poses`` and ``/tf_static`` as units move, ``/diagnostics`` once a second. docs/connect.md
    has the messages.

    Parameters
    ----------
    skin : Skin
        As opened by `skin.open`.
    prefix : str
        Of the topics, in place of ``skin``.
    frame : str
        Of the skin, as tf2 knows it.
    patch_frame : str
        Of a patch; ``{}`` stands for its name.
    rate_hz : float, optional
        At which states are published, at most; every cycle if None.
    moving : bool
        Frames of the patches go to ``/tf`` with every state, not to ``/tf_static`` when they move
        (`Skin.move`): for patches that move all the time.
    reliable : bool
        Whether states are sent again where they are lost; subscribers of both kinds match then.
    domain : int, optional
        ROS_DOMAIN_ID of the environment if not given, else 0.
    network : bool
        Let the subnet see the topics, as the nodes of ROS 2 do; else this machine alone does,
        unless the environment says more (docs/connect.md).

    Returns
    -------
    Publisher
        To be given every state; close it, or use it in a ``with`` block.

    Raises
    ------
    LibraryError
        cyclonedds is not installed.
    OptionError
        A name that ROS 2 refuses, or an option that cannot be.
    SkinError
        DDS cannot be started.

    Examples
    --------
    >>> with skin.open("palm", simulate=True) as palm, ros(palm) as node:  # doctest: +SKIP
    ...     for state in palm:
    ...         node.publish(state)
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
    return Publisher(skin, request, rate_hz)


def _domain(domain: int | None) -> int:
    """The domain that is given, else that of the environment."""
    if domain is None:
        text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
        if not (text.isascii() and text.isdigit() and len(text) <= 3):
            raise OptionError(f"ROS_DOMAIN_ID: must be an integer from 0 to {MOST_DOMAIN}; got "
                              f"{shown(text)}")  # fmt: skip
        domain = int(text)
        check_number("ROS_DOMAIN_ID", domain, 0, MOST_DOMAIN, whole=True)
    check_number("domain", domain, 0, MOST_DOMAIN, whole=True)
    return domain


class Publisher:
    """The loop's end of what is published; made by `ros`.

    Attributes
    ----------
    left_out : int
        States for which the process had no time.
    """

    def __init__(self, skin: Skin, request: dict[str, Any], rate_hz: float | None) -> None:
        dds.check_library()
        self._skin, poses = skin, skin.pipeline.poses
        # those of the topology stand in the layout
        self._poses = poses if poses[0] is skin.topology.position else None
        self._record = np.zeros(1, snapshot_dtype(skin.topology))
        self._period_ns = 0 if rate_hz is None else round(1e9 / rate_hz)
        rate = min(rate_hz or np.inf, skin.topology.cycle_rate_hz)
        self._ring = RingBuffer(self._record.dtype, max(8, round(WAITING_S * rate)))
        self._due_ns = self._note_ns = np.iinfo(np.int64).min
        self.left_out = 0
        self._worker = _started(self._ring, request)

    @property
    def alive(self) -> bool:
        """Whether the process that publishes runs."""
        return self._worker.alive

    def publish(self, state: State) -> None:
        """Hand a state to the process, if one is due; never waits."""
        stamp_ns = state.stamp_ns
        if stamp_ns < self._due_ns and self._due_ns - stamp_ns <= self._period_ns:
            return
        # the next one a period after this was due, and not after it came: the mean rate is right
        self._due_ns = max(self._due_ns, stamp_ns - self._period_ns) + self._period_ns
        if self._due_ns - stamp_ns > self._period_ns:  # time ran back
            self._due_ns = stamp_ns + self._period_ns
        claimed = self._ring.claim()
        if claimed is None:
            self.left_out += 1
            return
        record, poses = self._record, self._skin.pipeline.poses
        fill(record, state)
        record["lost_cycles"] = self.left_out
        record["has_moved"] = poses is not self._poses
        if record["has_moved"]:
            self._poses = poses
            record["pose"][0, :3], record["pose"][0, 3:] = poses[0], poses[1].reshape(9, -1)
        if not 0 <= stamp_ns - self._note_ns < NOTED_NS:
            self._note_ns = stamp_ns
            note(record, state, self._skin.transports)
        claimed[:] = record
        self._ring.publish()

    def sent(self) -> int:
        """States that the process has published so far; waits for its answer.

        Raises
        ------
        SkinError
            The process has ended.
        """
        return int(self._worker.ask("sent")["sent"])

    def close(self) -> None:
        """Let the process publish what waits, and end it; closing twice is fine."""
        self._worker.close()

    def __enter__(self) -> Publisher:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _patch_frames(frame: str, names: Sequence[str]) -> list[str]:
    """Frames of the patches."""
    check_kind("patch_frame", frame, str)
    if names and frame.count("{}") != 1:
        raise OptionError(
            f"patch_frame: must have {{}} once, for the name of a patch; got {frame!r}"
        )
    return [check_frame("patch_frame", frame.replace("{}", name)) for name in names]


def _reaches_out() -> bool:
    """Whether the environment says how far to go: then cyclonedds goes by it, or by its file."""
    discovery = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper()
    return discovery == "SUBNET" or bool(os.environ.get("CYCLONEDDS_URI"))


def _started(ring: RingBuffer, request: dict[str, Any]) -> Worker:
    """The process, once it can publish."""
    worker = Worker("skin.publish.process", ring, request)
    try:
        worker.ask("sent")
    except BaseException:
        worker.close()
        raise
    return worker
