"""Counts of received data frames, changed in place by the codec that packs them."""

from __future__ import annotations

import numpy as np

from bus.frame import FRAME_DTYPE, PAYLOAD, as_bytes, views
from bus.table import FrameTable
from topology import CHANNELS, Topology

__all__ = ["Payloads"]


class Payloads:
    """Data frames of one bus of a topology, with new contents.

    Parameters
    ----------
    topology : Topology
    index : int
        Of the bus.
    """

    def __init__(self, topology: Topology, index: int) -> None:
        from bus.codec_kernels import pack, unpack_frame  # compiled

        self._pack, self._unpack = pack, unpack_frame
        self._tables = FrameTable(topology).tables
        self._rows: dict[int, list[int]] = {}
        for f in np.flatnonzero(topology.frames.bus == index).tolist():
            self._rows.setdefault(int(topology.frames.can_id[f]), []).append(f)
        self._counts = np.zeros((len(CHANNELS), topology.n), np.int16)
        self._codes = np.zeros(topology.n, np.uint8)
        self._made = np.zeros(1, FRAME_DTYPE)

    def find(self, record: np.ndarray) -> int | None:
        """The frame of the topology that a record, shape (1,), is; None if it is none, or cut."""
        for f in self._rows.get(int(record["id"][0]), ()):
            expected = self._tables.frames[f]
            if not expected["pages"] or expected["page"] == record["data"][0, 0]:
                return f if record["length"][0] == expected["size"] else None
        return None

    def places(self, f: int) -> tuple[np.ndarray, np.ndarray]:
        """Channel and unit of each count of a frame of the topology."""
        expected = self._tables.frames[f]
        signals = self._tables.signals[expected["first_channel"] : expected["first_status"]]
        return signals["target"], signals["unit"]

    def read(self, record: np.ndarray, f: int) -> np.ndarray:
        """Counts of a record, shape (1,), in an array of all units, shape (c, n), int16: always the
        same one."""
        self._codes[:] = 0
        counts = self._counts.reshape(-1)
        self._unpack(as_bytes(record), 0, f, self._tables, counts, self._codes)
        return self._counts

    def write(self, record: np.ndarray, f: int, offset: int = 0) -> None:
        """Write the counts of the last record that was read, as they are now, into it; with
        `offset` added to its sequence number, and the CRC that fits."""
        from bus.codec_kernels import read_bits

        data, field = as_bytes(record), self._tables.frames[f]["sequence"]
        sequence = int(read_bits(data, 0, field)) + offset if field["mask"] else 0
        made = views(self._made)
        self._pack(f, f + 1, sequence, 0, self._counts, self._codes, self._tables, made)
        data[0, PAYLOAD:] = made.data[0, PAYLOAD:]
