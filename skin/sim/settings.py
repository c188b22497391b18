"""Settings of simulated boards by the host: tare and rate."""

from __future__ import annotations

import numpy as np

from bus.codec import Packer
from bus.configure import ALL_NODES, Command, node_numbers, read
from bus.frame import FrameBatch
from skin.sim.hall import HallChip
from topology import CHANNELS, Topology

__all__ = ["BoardSettings"]

FREQUENCY, BX, BY, HALL_TEMPERATURE = (
    CHANNELS.index(name) for name in ("frequency", "bx", "by", "hall_temperature")
)


class BoardSettings:
    """Tare and rate of all boards of a topology.

    Parameters
    ----------
    topology : Topology
        Units at rest as it describes them are the goal of a tare.
    lowest, highest : ndarray, shape (c, n), int32
        Rails of the counts, which a tare does not move.
    """

    def __init__(self, topology: Topology, lowest: np.ndarray, highest: np.ndarray) -> None:
        frames = topology.frames
        self._topology = topology
        self._lowest, self._highest = lowest, highest
        self._node = node_numbers(topology)
        self._rate = np.ones(len(frames), np.int64)
        self._base = np.zeros(len(frames), np.int64)
        """Added to the number of a frame, so that a change of rate leaves no gap."""
        self._tare = np.zeros((len(CHANNELS), topology.n), np.int32)
        self._rows = [frames.bus == bus for bus in range(len(topology.buses))]
        synced = np.full(len(frames), topology.sync_id is not None)
        own = np.array([layout.sequence == "own" for layout in topology.layouts])[frames.layout]
        self._counts = own | ~synced
        """Whether the number of a frame is its board's own count, not that of the SYNC."""
        self._asks = [bool((own & synced)[rows].any()) for rows in self._rows]
        self._last, self._left_out = [-1] * len(self._rows), [0] * len(self._rows)
        """Of each bus with such counts: its last cycle, and cycles so far without a SYNC."""
        self._scratch = FrameBatch(max(1, len(frames)))

    def obey(self, record: np.void, bus: int, cycle: int, recent: np.ndarray) -> bool:
        """Execute a configuration frame; False if it is ignored.

        Parameters
        ----------
        record : FRAME_DTYPE
        bus : int
        cycle : int
            The last one sent on the bus.
        recent : ndarray, shape (m, c, n), int16
            The last counts, without tare.
        """
        order = read(record)
        if order is None or not order.valid:
            return False
        asked = self._node > 0 if order.node == ALL_NODES else self._node == order.node
        asked = asked & self._rows[bus]
        if not asked.any() or (order.command == Command.TARE and not len(recent)):
            return False
        if order.command == Command.RATE:
            at = cycle - self._left_out[bus]
            self._base[asked] += at // self._rate[asked] - at // order.value
            self._rate[asked] = order.value
        else:
            carried = self._topology.frames.units[asked]
            units = np.unique(carried[carried >= 0])
            self._tare[:, units] = self._excess(recent.mean(axis=0))[:, units]
        return True

    def _excess(self, counts: np.ndarray) -> np.ndarray:
        """Counts above those at rest, shape (c, n), int32."""
        topology, p = self._topology, self._topology.parameters
        scale = np.where(topology.wired, topology.scale, 1.0)
        chip = np.where(
            topology.wired[HALL_TEMPERATURE],
            scale[HALL_TEMPERATURE] * counts[HALL_TEMPERATURE] + topology.offset[HALL_TEMPERATURE],
            p["hall_reference_c"],
        )
        rest = HallChip(topology)(np.zeros((3, topology.n)), chip)
        excess = np.zeros(counts.shape)
        for row, value in ((FREQUENCY, p["frequency_rest_hz"]), (BX, rest[0]), (BY, rest[1])):
            excess[row] = counts[row] - (value - topology.offset[row]) / scale[row]
        return np.where(topology.wired, np.rint(excess), 0.0).astype(np.int32)

    def counts(self, counts: np.ndarray) -> np.ndarray:
        """Counts that boards send in place of these, shape (c, n), int16."""
        if not self._tare.any():
            return counts
        tared = np.clip(counts - self._tare, self._lowest, self._highest)
        railed = (counts <= self._lowest) | (counts >= self._highest)
        return np.where(railed, counts, tared).astype(np.int16)

    def pack(
        self, packer: Packer, counts: np.ndarray, out: FrameBatch, *, cycle: int, bus: int,
        stamp_ns: int,
    ) -> None:  # fmt: skip
        """Append the frames of the boards of a bus that are due."""
        counts = self.counts(counts)
        if self._asks[bus]:
            self._left_out[bus] += cycle - self._last[bus] - 1 if self._last[bus] >= 0 else 0
            self._last[bus] = cycle
        itself = self._counts[self._rows[bus]]
        at = cycle - self._left_out[bus] * itself
        rate, base = self._rate[self._rows[bus]], self._base[self._rows[bus]]
        due = at % rate == 0
        own = np.where(itself, base + at // rate, cycle) & 0xFF
        if due.all() and (own == own[:1]).all():
            number = int(own.min(initial=0xFF))
            packer(counts, out, sequence=number, stamp_ns=stamp_ns, bus=bus)
            return
        chosen = np.empty(rate.size, out.records.dtype)
        for number in np.unique(own[due]).tolist():
            self._scratch.clear()
            packer(counts, self._scratch, sequence=number, stamp_ns=stamp_ns, bus=bus)
            mine = due & (own == number)
            chosen[mine] = self._scratch.frames[mine]
        out.extend(chosen[due])
