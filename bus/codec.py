"""Packing and unpacking of data frames, for any layout that a topology describes."""

from __future__ import annotations

import itertools

import numpy as np

from bus.frame import FrameBatch, views
from bus.table import FrameTable
from topology import CHANNELS, Topology

__all__ = ["Packer", "crc16"]

_CHECK = 0xFFFF


def crc16(data: bytes, crc: int = _CHECK) -> int:
    """CRC-16/CCITT-FALSE (polynomial 0x1021, not reflected), carried on from `crc`.

    Examples
    --------
    >>> hex(crc16(b"123456789"))
    '0x29b1'
    """
    from bus.codec_kernels import crc16_python

    return int(crc16_python(crc, np.frombuffer(data, np.uint8)[np.newaxis], 0, 0, len(data)))


class Packer:
    """Counts of n units → the data frames of a topology, in the order of (bus, id).

    Parameters
    ----------
    topology : Topology

    Raises
    ------
    LayoutError
        A layout of the topology cannot be packed.
    """

    def __init__(self, topology: Topology) -> None:
        from bus.codec_kernels import pack
        from bus.compiled.jit import direct

        self._pack = direct(pack)
        self._tables = FrameTable(topology).tables
        self._no_faults = np.zeros(topology.n, np.uint8)
        self._n = topology.n
        bounds = np.searchsorted(topology.frames.bus, np.arange(len(topology.buses) + 1))
        self._spans = [(int(a), int(b)) for a, b in itertools.pairwise(bounds)]
        self._all = (0, len(topology.frames))

    def __call__(
        self,
        counts: np.ndarray,
        batch: FrameBatch,
        *,
        sequence: int,
        fault_code: np.ndarray | None = None,
        stamp_ns: int = 0,
        bus: int | None = None,
    ) -> int:
        """Append one cycle's frames to `batch`; nothing is allocated.

        A count beyond its signal's bits is clipped. Frames have their bus in `bus`, and 0 in their
        status field.

        Parameters
        ----------
        counts : ndarray, shape (c, n), int16
            Raw channels (`topology.CHANNELS`).
        batch : FrameBatch
            Appended to.
        sequence : int
            Sequence number of all frames, truncated to the bits of its field.
        fault_code : ndarray, shape (n,), uint8, optional
            Each unit's own status; 0 if not given.
        stamp_ns : int
            Time stamp of all frames.
        bus : int, optional
            Only the frames of this bus; all if not given.

        Returns
        -------
        int
            Number of frames appended.

        Raises
        ------
        IndexError
            The batch has no room for all of them; none was appended.
        ValueError
            An array of another shape or type.
        """
        codes = self._no_faults if fault_code is None else fault_code
        if counts.dtype != np.int16 or counts.shape != (len(CHANNELS), self._n):
            raise ValueError(_must_be("counts", (len(CHANNELS), self._n), "int16", counts))
        if codes.dtype != np.uint8 or codes.shape != (self._n,):
            raise ValueError(_must_be("fault_code", (self._n,), "uint8", codes))
        first, end = self._all if bus is None else self._spans[bus]
        if end - first > batch.room:
            raise IndexError(f"batch: must have room for {end - first} frames; got {batch.room}")
        rows = views(batch.records[batch.count :])
        self._pack(first, end, sequence, stamp_ns, counts, codes, self._tables, rows)
        batch.count += end - first
        return end - first


def _must_be(name: str, shape: tuple[int, ...], dtype: str, got: np.ndarray) -> str:
    return f"{name}: must be {dtype} of shape {shape}; got {got.dtype} of shape {got.shape}"
