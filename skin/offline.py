"""Recorded logs to states, the same as live."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

import topology as topology_package
from bus.cycle import WRONG_FRAMES
from bus.frame import CAN_ERR, CAN_RTR
from bus.heartbeat import FIRST_ID, LAST_ID, LAYOUT, heartbeat_nodes
from bus.logs import LogReader, buses_of, read
from bus.processors import processors
from skin.options import Options
from skin.sinks import Attachable, Ending
from skin.state import INVALID
from topology import Topology

if TYPE_CHECKING:
    from skin.blocks import Block
    from skin.pipeline import Pipeline
    from skin.state import State

__all__ = ["DecodedLog", "LogWatch", "decode_log", "prefetch"]

T = TypeVar("T")
NEVER = np.iinfo(np.int64).min
LONGEST_SILENCE_NS = 365 * 86_400 * 1_000_000_000
"""No log is silent for a year [assumed]."""
UPTIME_UNCERTAIN_S = 2.0
"""A board counts whole seconds; as much again for a logger that stamps late [assumed]."""

LEAST_PERIODS = 10
"""Of a batch of frames, for a median [assumed]."""
RATE_SHARE = 0.05
"""Difference from the cycle rate of the topology that is worth a note [assumed]."""


def decode_log(
    source: Topology | str | Path, log: str | os.PathLike[str], *,
    channels: Mapping[str, str] | None = None, **options: Any,
) -> DecodedLog:  # fmt: skip
    """Decode a recorded CAN log (candump, BLF, ASC, TRC, …).

    The states are those of `skin.open`, contacts, slip and counters included. A cycle ends with its
    last frame or with the SYNC of the next one; there is no deadline. Of several channels in a log
    those are decoded that the topology's file names.

    Parameters
    ----------
    source : Topology, str or Path
        A loaded topology, a file, or the name of a built-in one.
    log : path
    channels : mapping of str to str, optional
        Name of the bus of a channel, by the channel's name or number in the log, where the log and
        the topology's file name the channels differently: ``{"1": "left", "2": "right"}``.
    **options
        What is computed, and how, as in `skin.options.Options`: want, sweeps, dtype, …

    Returns
    -------
    DecodedLog
        Iterate over it, once, for one `State` a cycle; or over `DecodedLog.blocks`, for arrays of
        thousands of cycles, which is several times as fast.

    Raises
    ------
    topology.TopologyError
        The topology cannot be used.
    bus.LogError
        There is no such log, or its format is unknown; later: no channel is one of the topology.
    OptionError
        The wire does not carry a channel that an option needs.

    Examples
    --------
    >>> for state in decode_log("palm", "run.log"):  # doctest: +SKIP
    ...     print(state.time_s, state.wrench, state.contacts)
    >>> for block in decode_log("palm", "run.log").blocks():  # doctest: +SKIP
    ...     print(block.stamp_ns, block.units.force)  # shapes (t,) and (t, 3, n)
    """
    loaded = source if isinstance(source, Topology) else topology_package.load(source)
    buses, chosen = buses_of(loaded, log, channels), Options(**options)
    reader = read(log, buses=buses, strict=False)
    from skin.pipeline import Pipeline

    return DecodedLog(Pipeline(loaded, chosen), reader)


class DecodedLog(Attachable):
    """States of a log; made by `decode_log`.

    Attributes
    ----------
    topology : Topology
    pipeline : Pipeline
    """

    def __init__(self, pipeline: Pipeline, reader: LogReader) -> None:
        self.topology = pipeline.topology
        self.pipeline = pipeline
        self._reader = reader
        self._watch = LogWatch(self.topology)
        self._cycles, self._has_valid = 0, not self.topology.feels.any()

    @property
    def faults(self) -> list[str]:
        """Faults of the log so far, as messages: where it is damaged, bus or SYNC missing, stamps
        that run back or jump ahead, frames that the logger lost, no valid reading."""
        found = [*self._watch.faults()]
        if self._cycles and not self._has_valid:
            found.append(_nothing_valid(self.pipeline, self._cycles))
        reader = self._reader
        of_log = [str(one) for one in (reader.damage, reader.lacking, reader.loss) if one]
        return [*of_log, *(f"{reader.path}: {fault}" for fault in found)]

    @property
    def notes(self) -> list[str]:
        """What is unusual, but no fault: another cycle rate than that of the topology."""
        return [f"{self._reader.path}: {note}" for note in self._watch.notes()]

    @property
    def left_out(self) -> dict[str, int]:
        """Frames so far of each channel of the log that is no bus of the topology."""
        return self._reader.left_out

    @property
    def skipped(self) -> dict[str, int]:
        """Counts of what else the log holds, by kind: events, lines that are no frames."""
        found = self._reader.skipped.items()
        return {kind: count for kind, count in found if not kind.startswith("frame of ")}

    def __iter__(self) -> Iterator[State]:
        return self._states(self._batches(), own=True)

    def blocks(self, most: int | None = None, *, threads: bool | None = None) -> Iterator[Block]:
        """The same states, once, as arrays of many cycles: every number is the same to the bit.

        Memory is bounded for a log of any length.

        Parameters
        ----------
        most : int, optional
            Maximum number of cycles of a block; some megabytes if not given.
        threads : bool, optional
            Whether a thread reads what comes next; if not given, where there is more than one
            processor.
        """
        from skin.blocks import blocks_of

        batches = self._batches()
        if processors() > 1 if threads is None else threads:
            batches = prefetch(frames.copy() for frames in batches)
        return blocks_of(self._states(batches, own=False), self.pipeline, most)

    def _states(self, batches: Iterable[np.ndarray], *, own: bool) -> Iterator[State]:
        """States of their own, or the pipeline's `now` for each."""
        pipeline = self.pipeline
        pipeline.warmup()
        try:
            for frames in batches:
                for state in pipeline.feed(frames, own=own):
                    self._count(state)
                    yield state
            if (last := pipeline.end(Ending.FLUSHED)) is not None:
                self._count(last)
                yield last
        finally:
            pipeline.sinks.stop()

    def _count(self, state: State) -> None:
        """Count a cycle, and look whether one has a valid reading."""
        self._cycles += 1
        self._has_valid = self._has_valid or bool(state.units.valid.any())

    def _batches(self) -> Iterator[np.ndarray]:
        """Frames as they are read; each batch is overwritten by the next one."""
        for batch in self._reader:
            # a frame that the logger itself sent was on the bus as well
            batch.frames["origin"] = 0
            self._watch.take(batch.frames)
            yield batch.frames


def prefetch(items: Iterable[T], most: int = 4) -> Iterator[T]:
    """The same items, produced by a thread before they are needed, up to `most`; exceptions are
    passed on.

    Examples
    --------
    >>> list(prefetch(range(3)))
    [0, 1, 2]
    """
    coming, none = iter(items), object()
    pool = ThreadPoolExecutor(1, "skin-prefetch")
    try:
        waiting = deque(pool.submit(next, coming, none) for _ in range(most))
        while (item := waiting.popleft().result()) is not none:
            waiting.append(pool.submit(next, coming, none))
            yield item  # type: ignore[misc]
    finally:
        pool.shutdown(cancel_futures=True)


class LogWatch:
    """Looks for faults of a log, on each bus, that cycles cannot show."""

    def __init__(self, topology: Topology) -> None:
        count = len(topology.buses)
        self._buses = topology.buses
        self._period_ns = round(1e9 / topology.cycle_rate_hz)
        self._frames = 0
        self._data = np.zeros(count, np.int64)
        self._syncs = np.zeros(count, np.int64)
        self._newest_ns = np.full(count, NEVER)
        self._nodes = [heartbeat_nodes(topology, index) for index in range(count)]
        self._beats: dict[tuple[int, int], tuple[float, int]] = {}
        self._back = self._jump_ahead = ""
        self._rate_hz, self._sync_id = topology.cycle_rate_hz, topology.sync_id
        self._pulse = [topology.sync_id] * count
        """Identifier of each bus that comes once a cycle; None until one is seen."""
        self._periods_ns: list[list[float]] = [[] for _ in self._buses]

    def take(self, frames: np.ndarray) -> None:
        """Check frames, shape (m,), in the order of the log."""
        plain = frames["id"] & (CAN_ERR | CAN_RTR) == 0
        for index, bus in enumerate(self._buses):
            here = np.flatnonzero(plain & (frames["bus"] == index))
            if not here.size:
                continue
            syncs = np.count_nonzero(frames["id"][here] == self._sync_id)
            self._syncs[index] += syncs
            self._data[index] += here.size - syncs
            stamps = frames["stamp_ns"][here]
            if self._pulse[index] is None:  # units send freely: one of their frames a cycle
                self._pulse[index] = int(frames["id"][here[0]])
            steps = np.diff(stamps[frames["id"][here] == self._pulse[index]])
            if steps.size >= LEAST_PERIODS:
                self._periods_ns[index].append(float(np.median(steps)))
            newest = np.maximum.accumulate(np.maximum(stamps, self._newest_ns[index]))
            back = np.flatnonzero(newest - stamps > self._period_ns)
            if back.size and not self._back:
                step_s = 1e-9 * float(newest[back[0]] - stamps[back[0]])
                self._back = (
                    f"frame {self._frames + here[back[0]] + 1}: must not be older than the frames "
                    f"before it on bus {bus.name!r}; got one {step_s:.6g} s older"
                )
            for i, step_s in self._steps_ahead(frames, index, here, newest):
                self._jump_ahead = self._jump_ahead or (
                    f"frame {self._frames + i + 1}: must follow the frames before it on bus "
                    f"{bus.name!r}; got one {step_s:.6g} s ahead: the clock was set, or stood still"
                )
            self._newest_ns[index] = newest[-1]
        self._frames += frames.size

    def _steps_ahead(
        self, frames: np.ndarray, index: int, here: np.ndarray, newest: np.ndarray
    ) -> Iterator[tuple[int, float]]:
        """Frames of a bus, and by how much their stamps jump ahead: of the seconds that a board
        counts from one heartbeat to the next, or beyond what any log is silent for."""
        old_ns = self._newest_ns[index]
        steps = np.diff(newest, prepend=newest[:1] if old_ns == NEVER else old_ns)
        for k in np.flatnonzero(steps > LONGEST_SILENCE_NS):
            yield int(here[k]), 1e-9 * float(steps[k])
        nodes = frames["id"][here].astype(np.int64) - FIRST_ID
        for k in np.flatnonzero((nodes > 0) & (nodes <= LAST_ID - FIRST_ID)):
            i, key = int(here[k]), (index, int(nodes[k]))
            if key[1] in self._nodes[index] and frames["length"][i] == LAYOUT.size:
                stamp_s, uptime_s = (
                    1e-9 * float(newest[k]),
                    LAYOUT.unpack(bytes(frames["data"][i, :8]))[1],
                )
                before_s, counted_s = self._beats.get(key, (stamp_s, uptime_s))
                self._beats[key] = stamp_s, uptime_s
                ahead_s = stamp_s - before_s - (uptime_s - counted_s)
                if 1 <= uptime_s - counted_s <= 2 and ahead_s > UPTIME_UNCERTAIN_S:
                    yield i, ahead_s

    def faults(self) -> Iterator[str]:
        """Faults, as messages."""
        for bus, data, syncs in zip(self._buses, self._data, self._syncs, strict=True):
            if self._sync_id is not None and data and not syncs:
                yield (
                    f"bus {bus.name!r}: must carry SYNC (0x{self._sync_id:03x}), which starts the "
                    f"cycles; got none in {data} frames"
                )
        yield from self.jumps

    @property
    def jumps(self) -> list[str]:
        """Steps of the stamps, the first one back and the first one ahead, as messages."""
        return [text for text in (self._back, self._jump_ahead) if text]

    def notes(self) -> Iterator[str]:
        """Notes, as messages."""
        for bus, periods in zip(self._buses, self._periods_ns, strict=True):
            period_ns = float(np.median(periods)) if periods else float(self._period_ns)
            if abs(period_ns / self._period_ns - 1.0) > RATE_SHARE:
                yield (
                    f"bus {bus.name!r}: should have {self._rate_hz:g} cycles a second, as the "
                    f"topology says; got {1e9 / max(period_ns, 1.0):.4g}"
                )


def _nothing_valid(pipeline: Pipeline, cycles: int) -> str:
    """The fault of a log without a valid reading, with what the assembler and the units say."""
    skin, counters = pipeline.topology, pipeline.assembler.counters
    why = [f"{count} {name} frames" for name in WRONG_FRAMES if (count := getattr(counters, name))]
    status = pipeline.decoder.reading.status[skin.feels] & int(INVALID)
    why += [f"{count} units flagged {str(flag.name).lower()}" for flag in INVALID
            if (count := np.count_nonzero(status & int(flag)))]  # fmt: skip
    return (f"must hold valid readings of {skin.name!r}; got none in {cycles} cycles: "
            f"{', '.join(why)}")  # fmt: skip
