"""Skin: the open buses of a topology, the schedule of SYNC, and poses that move."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Generator, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from inspect import GEN_CLOSED, getgeneratorstate
from itertools import chain
from threading import Lock, RLock
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bus.errors import BusClosedError
from bus.frame import FRAME_DTYPE, FrameBatch
from bus.logs import Recording
from bus.memory import MemoryTransport
from bus.state import BusChange
from bus.transport import Transport
from bus.wait import IdleWindow, Waiter
from skin.errors import OptionError, SkinError, check_kind
from skin.patch import as_pose
from skin.pipeline import Pipeline
from skin.sinks import Attachable, Ending
from skin.state import INVALID, State, Status
from topology import Topology

if TYPE_CHECKING:
    from skin.contact.contact import Contact
    from skin.io.record.recorder import Recorder
    from skin.robot.joints import Joints
    from skin.sim.node import SimulatedUnits

__all__ = ["SYNC_BITS", "Skin", "Sync", "Timing", "wait_until"]

_log = logging.getLogger("skin")

Sync = Literal["host", "bus"]
SYNC_BITS = 57
"""Bits of a SYNC frame until its end, at which units sample: 52 without stuff bits, at most 62
[derived: ISO 11898-1, 11 bits of identifier and a byte]. A frame that is on the wire already
delays it by its own time."""
QUIET_S = 5.0
"""Time without any answer after which that is said, or an error if nobody can answer [assumed]."""
JUMP_NS = 1_000_000_000
"""Jump of stamps by which a clock was set [assumed: more than frames wait to be read]."""


@dataclass
class Timing:
    """Processing time of the last cycle, and how often the host was late."""

    work_ns: int = 0
    """Assembling, decoding and contacts of the last cycle, without waiting."""
    overruns: int = 0
    """SYNCs that could not be sent in time and were left out."""
    unsent: int = 0
    """SYNCs that a bus did not accept: no unit could answer in that cycle."""


class Skin(Attachable):
    """An open skin; iterate over it for one `State` a cycle, to the end of a simulated scene, or
    for ever. Made by `skin.open`, or of transports that are open already.

    Parameters
    ----------
    pipeline : Pipeline
        Turns frames into states.
    transports : list of Transport
        This host's end of each bus, in order; closed with the skin.
    recorder : Recorder, optional
        Records the run, with ``record=FILE``; see `Recorder.report`.
    sync, pace
        As of `skin.open`.
    nodes : SimulatedUnits, optional
        Simulated units at the other ends.
    log : Recording, optional
        Records the frames; closed with the skin.

    Attributes
    ----------
    topology : Topology
    timing : Timing

    Raises
    ------
    SkinError
        Not one transport for each bus.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        transports: list[Transport],
        recorder: Recorder | None = None,
        *,
        sync: Sync = "host",
        pace: bool = True,
        nodes: SimulatedUnits | None = None,
        log: Recording | None = None,
    ) -> None:
        self.topology = topology = pipeline.topology
        for end in transports:
            check_kind("transports", end, Transport)
        if len(transports) != (buses := len(topology.buses)):
            raise SkinError(
                f"transports: must be one for each of {buses} buses; got {len(transports)}"
            )
        self.pipeline = pipeline
        self.transports = transports
        self.timing = Timing()
        self.nodes, self.recorder = nodes, recorder
        self._ends_s = math.inf if nodes is None else nodes.ends_s
        self._recording = log
        self._batch = FrameBatch(4096)
        self._waiter = Waiter(transports)
        self._pace = pace
        self._period_ns = round(1e9 / topology.cycle_rate_hz)
        self._lull = IdleWindow(self._period_ns)
        self._sends_sync = sync == "host" and topology.sync_id is not None
        self._keeps_stamps = topology.sync_id is not None and all(
            end.keeps_stamps for end in transports
        )
        self._sync_frames, self._wire_ns = sync_frames(topology)
        if nodes is not None:
            self._wire_ns[:] = 0
        # frames that this host has not asked for have the system's clock
        self._has_system_time = not self._sends_sync and not any(e.keeps_stamps for e in transports)
        self._ahead_ns: dict[int, int] = {}
        self._quiet_s, self._began_ns = QUIET_S, 0
        self._started_ns, self._epoch_ns = time.monotonic_ns(), time.time_ns()
        self._number = 0
        self._cycles: Generator[State] | None = None
        self._iterating, self._closing = Lock(), RLock()
        self._closed = False
        self._is_watched, self._latest = False, None

    def __repr__(self) -> str:
        """The skin, and whether its units are simulated."""
        units = "simulated units" if self.simulated else "units"
        return f"<Skin {self.topology.name!r}: {self.topology.n} {units}>"

    @property
    def simulated(self) -> bool:
        """Whether `skin.open` has attached simulated units: forces are not real."""
        return self.nodes is not None

    @property
    def zeros(self) -> dict[str, Any]:
        """Zeros of this run: units ``tared`` in it, and units ``refused`` so far, with the
        reason."""
        taken = self.pipeline.zeros
        return {"tared": [], "refused": {}} if taken is None else taken.report()

    def retake_zeros(self) -> None:
        """Take the zeros of all units again, in the next second in which nothing touches them; see
        `skin.pipeline.Pipeline.retake_zeros`."""
        self._require_open("retake_zeros")
        self.pipeline.retake_zeros()

    @property
    def bus_changes(self) -> list[tuple[str, BusChange]]:
        """Changes of state of every bus so far, by its name: warnings, bus-off, unplugged, …"""
        pairs = zip(self.topology.buses, self.transports, strict=True)
        return [(bus.name, change) for bus, end in pairs for change in end.changes]

    @property
    def clocks(self) -> dict[str, dict[str, Any]]:
        """Source of the frame stamps of each bus, by its name: ``by`` is "interface" where it has a
        clock of its own, else "kernel"; "host" where python-can has no stamps of the kernel.
        ``error_ns``, one sigma of the map from the own clock to this host's, and its ``drift_ppm``;
        ``steps`` counts how often one of the clocks was set."""
        pairs = zip(self.topology.buses, self.transports, strict=True)
        return {bus.name: end.clock.report() if end.clock else {"by": end.stamped_by}
                for bus, end in pairs}  # fmt: skip

    def realtime_ns(self, stamp_ns: int) -> int:
        """A stamp of a cycle on the system's clock: as it is now, or, without SYNC of this host, as
        it was at the cycle.

        `State.stamp_ns` and `State.sampled_ns` of cycles that this host has begun are of a clock
        that is never set: it starts at the system's time and runs with the monotonic clock, so that
        steps of the system's clock do not affect forces or contacts. Cameras and other programs
        stamp by the system's clock.
        """
        if self._has_system_time:
            return stamp_ns
        return stamp_ns + time.time_ns() - self._stamp_ns()

    # -- patches that move -------------------------------------------------------------------------

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set the poses of all units, for patches that move against each other.

        They hold from the next cycle on; the skin frame stays. Once a cycle is cheap. Units that
        come close do not become neighbours.

        Parameters
        ----------
        position : ndarray, shape (3, n)
            Metre, skin frame.
        rotation : ndarray, shape (3, 3, n)
            Columns are the unit's axes in the skin frame.

        Raises
        ------
        SkinError
            An array of another shape, a position that is not finite, or no rotation.
        """
        self._require_open("move")
        self.pipeline.move(position, rotation)

    def move_joints(self, q: Mapping[str, float] | np.ndarray) -> None:
        """Set the joints of the robot that carries the skin, and with them the poses of all units.

        As `move`, by forward kinematics; mimic joints follow. Poses set by `move` or `move_patch`
        before are lost.

        Parameters
        ----------
        q : mapping of str to float, or ndarray, shape (J,)
            Radian or metre, by name, where other joints stay; or all of them, in
            the order of ``topology.robot.joint_names``.

        Raises
        ------
        SkinError
            The topology file has no [robot].
        OptionError
            No such joint, the wrong number of coordinates, one that is not finite, or one outside
            its limits. No joint has moved then.
        """
        self._require_open("move_joints")
        joints = self.joints
        joints.move(q)
        self.pipeline.move(*joints.unit_poses, joints.q)

    def turn(self, attitude: np.ndarray) -> None:
        """Report the attitude of the skin in the world, from an IMU or the robot's kinematics.

        Where too few units are untouched to estimate the ambient field, the estimate is turned by
        these attitudes; turns of the untouched skin before that make the field at its tare known.
        Call it after `move` or `move_joints`, so that patches on links turn with these. From the
        first call on only reported turns count: call it as often as the skin turns, about 60 µs for
        each frame that carries patches. Recordings do not contain it.

        Parameters
        ----------
        attitude : ndarray, shape (3, 3)
            A rotation: columns are the axes of the skin frame in any fixed frame.

        Raises
        ------
        OptionError
            It is not a rotation.
        """
        self._require_open("turn")
        self.pipeline.turn(attitude)

    @cached_property
    def joints(self) -> Joints:
        """The robot's joints: their coordinates, and poses of links; see `skin.robot.joints`.

        Raises
        ------
        SkinError
            The topology file has no [robot].
        """
        from skin.robot.joints import Joints

        return Joints(self.topology)

    def link_pose(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """T_skin_link of the robot now; see `skin.robot.joints.Joints.link_pose`."""
        return self.joints.link_pose(name)

    def wrench_in(self, link: str, wrench: Contact | np.ndarray) -> Any:
        """A wrench in a link's frame; see `skin.robot.joints.Joints.wrench_in`."""
        return self.joints.wrench_in(link, wrench)

    def move_patch(self, name: str, rotation: np.ndarray, translation: np.ndarray) -> None:
        """Set the pose of one patch, by a rigid motion from its pose in the file; see `move`.

        Parameters
        ----------
        name : str
            Of `Topology.patch_names`.
        rotation : ndarray, shape (3, 3)
        translation : ndarray, shape (3,)
            Metre. A point p of the skin frame is now at ``rotation @ p + translation``.

        Raises
        ------
        OptionError
            There is no such patch.
        SkinError
            An array of another shape, a translation that is not finite, or no rotation.
        """
        topology = self.topology
        if name not in topology.patch_names:
            raise OptionError.unknown("patch", name, topology.patch_names)
        turn, shift = as_pose(rotation, translation)
        units = topology.patch == topology.patch_names.index(name)
        position, turned = (pose.copy() for pose in self.pipeline.poses)
        position[:, units] = turn @ topology.position[:, units] + shift[:, np.newaxis]
        turned[:, :, units] = np.einsum("ij,jkn->ikn", turn, topology.rotation[:, :, units])
        self.move(position, turned)

    # -- states ------------------------------------------------------------------------------------

    def trouble(self, state: State) -> dict[str, Status]:
        """Units that are not valid in this state: their flags of `skin.state.INVALID`, by name."""
        flags, names = state.units.status & int(INVALID), self.topology.unit_names
        return {names[i]: Status(int(flags[i])) for i in np.flatnonzero(flags)}

    def latest(self) -> State | None:
        """A copy of the newest state, for other threads than the one that iterates; never waits.

        It is a whole cycle and belongs to the caller. Calls between two cycles return the same
        copy. The first call turns the copying on.

        Returns
        -------
        State or None
            None until a cycle has ended after the first call.
        """
        self._is_watched = True
        return self._latest

    def __enter__(self) -> Skin:
        return self

    def __exit__(self, *exc: object) -> None:
        try:
            self.close()
        except Exception as other:
            if not isinstance(gone := exc[1], BusClosedError):
                raise
            gone.add_note(f"{type(other).__name__} on closing: {other}")

    def close(self) -> None:
        """Release the buses; may be called twice.

        May be called from any thread: a loop over the skin then ends without an error.
        """
        self._closed = True
        with self._closing, ExitStack() as ending:  # a full disk of the log must not keep sinks
            ending.callback(self.pipeline.sinks.stop)  # from their own, nor an adapter both
            if self._recording is not None:
                ending.callback(self._recording.close)
            for transport in reversed(self.transports):
                ending.callback(transport.close)
            if self.nodes is not None:
                ending.callback(self.nodes.close)

    def __iter__(self) -> Iterator[State]:
        """One state a cycle; a later loop continues where the one before ended.

        Raises
        ------
        SkinError
            Another iterator is live; the skin is closed; nobody else is on a bus within this
            process for 5 s (`QUIET_S`), while no unit has answered.
        BusClosedError
            A bus is unplugged.
        """
        self._require_open("iter(skin)")
        self.pipeline.warmup()
        return self._states()

    def _require_open(self, method: str) -> None:
        """Raise SkinError where the skin is closed."""
        if self._closed:
            raise SkinError(f"{method}: must be an open skin; got one that is closed")

    def _states(self) -> Iterator[State]:
        """States of the cycles; the generator outlives this iterator."""
        if not self._iterating.acquire(blocking=False):
            raise SkinError("iter(skin): must be the only live iterator of a skin; got a second")
        try:
            if self._cycles is None:
                self._began_ns = time.monotonic_ns()
                if alone := self._alone():
                    _log.warning(alone)
            if self._cycles is None or getgeneratorstate(self._cycles) == GEN_CLOSED:
                self._cycles = self._host_cycles() if self._sends_sync else self._bus_cycles()
            first = next(self._cycles, None)
            for state in () if first is None else chain((first,), self._cycles):
                if self._quiet_s:
                    self._expect_answers()
                if self._is_watched:
                    self._latest = state.copy()
                yield state
        except BusClosedError:
            if not self._closed:
                raise
        finally:
            self._iterating.release()

    def _host_cycles(self) -> Generator[State]:
        """This host sends SYNC: one cycle each."""
        due = time.monotonic_ns()
        while not self._closed and 1e-9 * (self._number * self._period_ns) < self._ends_s:
            if self._pace:
                due, skipped = wait_until(due, self._period_ns)
                self.timing.overruns += skipped
                self._number += skipped
            else:
                due = time.monotonic_ns()
            self._receive(0)  # boards that answer late are waited for from now on
            yield from self._feed(self._batch.frames)
            yield from self._feed(self._sync(self._number))
            self._number += 1
            yield from self._answers()
            due += self._period_ns

    def _alone(self) -> str:
        """That nobody can answer, where no other end of a bus within the process is open."""
        for i, (bus, end) in enumerate(zip(self.topology.buses, self.transports, strict=True)):
            if isinstance(end, MemoryTransport) and end.is_alone:
                return (
                    f"nobody can answer: {self.topology.name}: buses[{i}] {bus.name!r}: interface: "
                    "must be one that other processes can reach, or units must be simulated "
                    "(simulate=True, --simulate); got 'memory'"
                )
        return ""

    def _expect_answers(self) -> None:
        """Until a unit has answered: say that none does, less and less often."""
        quiet_s = 1e-9 * (time.monotonic_ns() - self._began_ns)
        if self.counters.data:
            self._quiet_s = 0.0
        elif quiet_s > self._quiet_s:
            if alone := self._alone():
                raise SkinError(alone)
            self._quiet_s *= 2.0
            _log.warning("%s: no unit has answered for %.0f s; skin doctor finds out why",
                         self.topology.name, quiet_s)  # fmt: skip

    def _answers(self) -> Iterator[State]:
        """Receive until the cycle is closed; sleep while arrivals cannot complete it."""
        pipeline, lull = self.pipeline, self._lull
        asked_ns = heard_ns = time.monotonic_ns()
        until_ns = asked_ns + pipeline.assembler.deadline_ns
        if pipeline.zeros is not None:  # while frames are on their way
            pipeline.zeros.work()
        looks, sleeps = 0, lull.ns > 0
        while not self._closed and pipeline.assembler.pending:
            if sleeps and looks == 1:
                wait_until(min(asked_ns + lull.ns, until_ns), self._period_ns)
            now_ns = time.monotonic_ns()  # frames that have arrived by then precede the deadline
            # units within this process have answered already
            self._receive(0 if sleeps and looks == 0 else until_ns - now_ns)
            looks, heard_ns = looks + 1, time.monotonic_ns()
            yield from self._feed(self._batch.frames)
            yield from self._end(now_ns, Ending.EXPIRED)
        if heard_ns < until_ns:
            lull.learn(heard_ns - asked_ns, slept_too_long=looks <= 1 + sleeps)

    def _bus_cycles(self) -> Generator[State]:
        """Another node sends SYNC, or none does: cycles come as they close."""
        while not self._closed:
            is_over = self.nodes is not None and 1e-9 * self.nodes.time_ns() >= self._ends_s
            if self.pipeline.zeros is not None:
                self.pipeline.zeros.work()
            self._receive(0 if is_over else self._period_ns)
            if is_over and not self._batch.frames.size:
                return
            now_ns = time.monotonic_ns()  # a consumer that takes its time is no silence
            if len(self.transports) > 1:
                self._batch.merge()
            yield from self._feed(self._batch.frames)
            yield from self._end(now_ns, Ending.EXPIRED, Ending.SILENT)

    def _sync(self, number: int) -> np.ndarray:
        """Send SYNC on every bus and return the frames, as a log has them."""
        frames = self._sync_frames
        frames["data"][:, 0] = number & 0xFF
        frames["stamp_ns"] = self._stamp_ns() + self._wire_ns
        for i, transport in enumerate(self.transports):
            self.timing.unsent += 1 - transport.send(frames[i : i + 1])
        return frames

    def _stamp_ns(self) -> int:
        """Now, on a clock that is never set. Unpaced simulated units have a simulated time, one
        period a cycle; so has a bus within this process, whose frames have the stamps of the SYNCs
        that they answer."""
        if not self._pace and (self.nodes is not None or self._keeps_stamps):
            return self._epoch_ns + self._number * self._period_ns
        return self._epoch_ns + time.monotonic_ns() - self._started_ns

    def _receive(self, wait_ns: int) -> None:
        """Fill the batch with received frames, waiting as `wait` says."""
        self._batch.clear()
        self._waiter.receive(self._batch, wait_ns)
        if not self._has_system_time or not self._batch.count or not self._batch.room:
            return  # frames still wait to be read
        bus, ahead_ns = self._batch.records[self._batch.count - 1][["bus", "stamp_ns"]].item()
        ahead_ns -= self._stamp_ns()
        jump_ns = ahead_ns - self._ahead_ns.setdefault(bus, ahead_ns)
        if abs(jump_ns) > JUMP_NS:
            self._ahead_ns[bus] = ahead_ns
            _log.warning("bus %r: stamps jump by %+.6g s: a clock was set",
                         self.topology.buses[bus].name, 1e-9 * jump_ns)  # fmt: skip

    def _feed(self, frames: np.ndarray) -> Iterator[State]:
        if self._recording is not None and frames.size:
            self._recording.write(frames)
        started = time.perf_counter_ns()
        for state in self.pipeline.feed(frames):
            self.timing.work_ns = time.perf_counter_ns() - started
            yield state
            started = time.perf_counter_ns()

    def _end(self, now_ns: int, *by: Ending) -> Iterator[State]:
        """The state of a cycle that ends at this time, by the first of these that ends one."""
        started = time.perf_counter_ns()
        for ending in by:
            if (state := self.pipeline.end(ending, now_ns)) is not None:
                self.timing.work_ns = time.perf_counter_ns() - started
                yield state
                return


def sync_frames(topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """A SYNC for each bus without stamp and counter, shape (b,), FRAME_DTYPE, and its duration on
    the wire, nanoseconds, shape (b,), int64."""
    frames = np.zeros(len(topology.buses), FRAME_DTYPE)
    frames["id"] = topology.sync_id or 0
    frames["length"], frames["bus"] = 1, np.arange(frames.size)
    bits_per_s = np.array([bus.bitrate for bus in topology.buses], float)
    return frames, np.round(SYNC_BITS * 1e9 / bits_per_s).astype(np.int64)


def wait_until(due: int, period: int) -> tuple[int, int]:
    """Sleep until `due`; if that is more than a period ago, count the missed periods."""
    now = time.monotonic_ns()
    if now < due:
        time.sleep((due - now) * 1e-9)
        return due, 0
    skipped = (now - due) // period
    return due + skipped * period, int(skipped)
