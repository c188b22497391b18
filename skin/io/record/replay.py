"""Replay: a recording, or a log, through the pipeline of a live run.

A recording has the inputs of the pipeline in order; the states are the same, bit for bit, which is
checked against those in the recording. A log has frames alone: its cycles end with their last frame
or with the next SYNC.
"""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import topology as topology_package
from bus.errors import LogError
from bus.frame import FRAME_DTYPE
from bus.logs.formats import READERS
from bus.logs.reader import existing
from skin.errors import OptionError, check_number
from skin.io.messages.definitions import FRAMES, POSES, STATE, decode, encode, header
from skin.io.messages.of_skin import state_message
from skin.io.messages.record import RecordWriter, record_dtype
from skin.io.record import is_recording
from skin.io.record.attached import Setup, differences, read_setup
from skin.io.record.container import RecordedFile
from skin.io.record.recorder import FED, PART
from skin.offline import DecodedLog, decode_log
from skin.sinks import Attachable, Ending
from topology import Topology

if TYPE_CHECKING:
    from skin.pipeline import Pipeline
    from skin.state import State

__all__ = ["Pace", "Replay", "recorded_topology", "replay"]

LONGEST_WAIT_S = 5.0
"""Longest wait for a state in real time [assumed: longer gaps are skipped]."""
FASTEST = 1e6
ENDINGS = [one.value for one in Ending]


def recorded_topology(file: str | os.PathLike[str]) -> Topology:
    """The topology of the skin that a recording is of, as it was in the run.

    Raises
    ------
    bus.LogError
        There is no such file, or it is no recording.
    LibraryError
        The library that reads recordings is not installed.
    """
    recorded = RecordedFile(existing(file))
    return read_setup(recorded).topology


def replay(
    file: str | os.PathLike[str],
    source: Topology | str | Path | None = None,
    *,
    speed: float | None = None,
    recalibrate: bool = True,
    **options: Any,
) -> Replay | Played:
    """Play a recording (.mcap), or any log that `decode_log` reads.

    Parameters
    ----------
    file : path
    source : Topology, str or Path, optional
        Needed for a log. A recording has its own; of a given one, which must be of the same skin,
        the calibration is used, if `recalibrate`. Units that were simulated keep theirs.
    speed : float, optional
        1 for real time, 10 for ten times as fast; no waiting if not given.
    **options
        Of a log: channels, what is computed, and how, as of `decode_log`. Of a recording: what
        replaces the options of its run.

    Returns
    -------
    Played, of a recording Replay
        Iterate over it, once, for one `State` a cycle.

    Raises
    ------
    bus.LogError
        There is no such file, its format is unknown, or it was recorded with another skin.
    OptionError
        An option that cannot be, or a log without a topology.
    LibraryError
        The library that reads recordings is not installed.

    Examples
    --------
    >>> for state in replay("run.mcap"):  # doctest: +SKIP
    ...     print(state.time_s, state.wrench)
    """
    if speed is not None:
        check_number("speed", speed, 1e-6, FASTEST)
    path = existing(file)
    if not is_recording(path):
        kind = path.with_suffix("").suffix if path.suffix.lower() == ".gz" else path.suffix
        if kind.lower() not in READERS:
            raise LogError(
                f"{path}: must be a recording (.mcap) or a log ({', '.join(sorted(READERS))}); got "
                f"{path.suffix or 'no suffix'!r}"
            )
        if source is None:
            raise OptionError(f"{path}: topology: must be given with a log; got none")
        decoded = decode_log(source, path, **options)
        return Played(decoded.pipeline, speed, decoded)
    if "channels" in options:
        raise OptionError(f"{path}: channels: must not be given with a recording")
    recorded = RecordedFile(path)
    ran = setup = read_setup(recorded)
    if source is not None:
        given = source if isinstance(source, Topology) else topology_package.load(source)
        if _is_recalibrated(path, ran.topology, given) and recalibrate:
            setup = dataclasses.replace(setup, topology=given)
    if options:
        setup = dataclasses.replace(setup, options=dataclasses.replace(setup.options, **options))
    return Replay(recorded, setup, speed, compares=setup is ran)


def _is_recalibrated(path: Path, recorded: Topology, given: Topology) -> bool:
    """Whether the skin of a recording has another calibration now; another skin is refused. Units
    that were simulated had exact parameters."""
    others, is_other = differences(recorded, given)
    if others:
        raise LogError(
            f"{path}: topology: must be recorded with {given.name!r} as it is now; got differences "
            f"in {', '.join(others)}"
        )
    return is_other and differences(recorded, given.exact())[1]


class Pace:
    """Waits until the next state is due.

    Parameters
    ----------
    speed : float or None
        1 for real time; None never waits.
    """

    def __init__(self, speed: float | None) -> None:
        self._speed = speed
        self._due_s: float | None = None
        self._stamp_ns = 0

    def wait(self, stamp_ns: int) -> None:
        """Sleep until the state with this stamp is due. A late caller restarts the schedule."""
        if self._speed is None:
            return
        now = time.monotonic()
        if self._due_s is not None:
            gap_s = 1e-9 * (stamp_ns - self._stamp_ns) / self._speed
            self._due_s += min(max(gap_s, 0.0), LONGEST_WAIT_S)
            if self._due_s > now:
                time.sleep(self._due_s - now)
            elif now - self._due_s > LONGEST_WAIT_S:
                self._due_s = now
        else:
            self._due_s = now
        self._stamp_ns = stamp_ns


class Played(Attachable):
    """States of a log, in real time or as fast as they come; iterate over it once.

    Attributes
    ----------
    topology : Topology
    pipeline : Pipeline
    faults : list of str
        Those of the file so far.
    work_ns : int
        Processing time of the last state, of a recording with its comparison.
    """

    def __init__(self, pipeline: Pipeline, speed: float | None, log: DecodedLog | None) -> None:
        self.topology, self.pipeline = pipeline.topology, pipeline
        self.work_ns = 0
        self._pace, self._log = Pace(speed), log

    @property
    def faults(self) -> list[str]:
        """Faults of the file so far."""
        assert self._log is not None
        return self._log.faults

    def __iter__(self) -> Iterator[State]:
        started = time.perf_counter_ns()
        for state in self._states():
            self.work_ns = time.perf_counter_ns() - started
            self._pace.wait(state.stamp_ns)
            yield state
            started = time.perf_counter_ns()

    def _states(self) -> Iterator[State]:
        assert self._log is not None
        return iter(self._log)


class Replay(Played):
    """States of a recording, reproduced; made by `replay`.

    Attributes
    ----------
    count, same : int
        States that were compared so far, and how many of them equal those of the recording, to the
        bit. None is compared that another calibration or another option gives.
    """

    def __init__(
        self, recorded: RecordedFile, setup: Setup, speed: float | None, *, compares: bool
    ) -> None:
        from skin.pipeline import Pipeline

        pipeline = Pipeline(setup.topology, setup.options, deadline_s=setup.deadline_s)
        super().__init__(pipeline, speed, None)
        self.count = self.same = 0
        self._recorded, self._compares = recorded, compares
        self._record = np.zeros(1, record_dtype(self.topology, self.pipeline.contact_capacity))
        self._writer = RecordWriter(self._record, self.pipeline)
        self._parts: list[np.ndarray] = []
        self._lost = (0, 0)
        self._unmade = 0

    @property
    def faults(self) -> list[str]:
        """Faults of the recording so far: damage, dropped cycles, and states that differ from those
        in the recording."""
        path, (cycles, frames) = self._recorded.path, self._lost
        found = list(self._recorded.damage)
        if cycles + frames:
            found.append(f"{path}: must hold every cycle; got {cycles} cycles and {frames} frames "
                         "left out, as the recorder was behind")  # fmt: skip
        if self._unmade:
            found.append(f"{path}: must hold the frames of every state; got {self._unmade} states "
                         "without")  # fmt: skip
        if other := self.count - self.same:
            found.append(f"{path}: must give the states of the run; got {other} of {self.count} "
                         "that differ")  # fmt: skip
        return found

    def _states(self) -> Iterator[State]:
        self.pipeline.warmup()
        try:
            coming: Iterator[State] = iter(())
            for topic, data in self._recorded.messages((FRAMES, POSES, STATE)):
                if topic == POSES:
                    self._move(self._message(topic, data))
                elif topic == FRAMES:
                    yield from coming  # cycles whose states are not in the file
                    given = self._message(topic, data)
                    self._lost = int(given.lost_cycles), int(given.lost_frames)
                    coming = self._given(given)
                elif (state := next(coming, None)) is None:
                    self._unmade += 1
                else:
                    if self._compares:
                        self._compare(data)
                    yield state
        finally:
            self.pipeline.sinks.stop()

    def _message(self, topic: str, data: bytes) -> Any:
        try:
            return decode(topic, data)
        except ValueError as error:
            raise LogError(f"{self._recorded.path}: {error}") from None

    def _given(self, message: Any) -> Iterator[State]:
        """Feed the pipeline recorded inputs; yields the states."""
        events = message.events.tolist(), message.values.tolist()
        done = 0
        for event, value in zip(*events, strict=True):
            if event in (FED, PART):
                size = value * FRAME_DTYPE.itemsize
                self._parts.append(message.frames[done : done + size].copy().view(FRAME_DTYPE))
                done += size
                if event == FED:
                    parts, self._parts = self._parts, []
                    yield from self.pipeline.feed(np.concatenate(parts))
                continue
            if (state := self._end(event, value)) is not None:
                yield state

    def _end(self, event: int, elapsed_ns: int) -> State | None:
        """End a cycle, or the silence, that was so old. Without SYNC, and before the first one, the
        first event of the clock starts the time."""
        if event not in ENDINGS:
            raise LogError(f"{self._recorded.path}: event: must be of {ENDINGS}; got {event}")
        by, pipeline = Ending(event), self.pipeline
        if by is Ending.FLUSHED:
            return pipeline.end(by)
        since_ns = pipeline.assembler.since_ns
        if since_ns is None:
            pipeline.end(by, 0)
            since_ns = pipeline.assembler.since_ns or 0
        return pipeline.end(by, since_ns + elapsed_ns) if elapsed_ns else None

    def _move(self, message: Any) -> None:
        """Set recorded poses, and the joints that they are of."""
        position, rotation = message.position.reshape(3, -1), message.rotation.reshape(3, 3, -1)
        known = message.q.size and np.isfinite(message.q).all()
        self.pipeline.move(position.copy(), rotation.copy(), message.q.copy() if known else None)

    def _compare(self, recorded: bytes) -> None:
        """Compare a state to that of the recording."""
        now = self.pipeline.now
        self._writer.state(0, now)
        head = header(max(0, now.stamp_ns), "skin")
        self.count += 1
        self.same += encode(STATE, state_message(head, self._record[0])) == recorded
