"""What the topology says of a data frame, and writing into its payload bit by bit."""

from __future__ import annotations

import numpy as np

from bus.codec import crc16
from topology import CHANNELS, Signal, Topology, WireLayout

__all__ = ["ExpectedFrame", "count_in", "flip", "frames_of", "put_count"]


class ExpectedFrame:
    """A data frame of the topology, and how to write into it."""

    def __init__(self, can_id: int, layout: WireLayout, part: int, units: list[int]) -> None:
        self.can_id = can_id
        self.layout = layout
        self.page = layout.pages[part] if layout.pages else None
        self.units = units
        mine = [signal for signal in layout.signals if signal.part == part]
        self.channels = [s for s in mine if s.name in CHANNELS and units[s.slot] >= 0]
        self._sequence = layout.frame_field("sequence", part)
        self._crc = layout.frame_field("crc", part)

    def counts_of(self, slots: list[int]) -> np.ndarray:
        """Mask of the channels of some slots, shape (64,), uint8."""
        mask = np.zeros(64, np.uint8)
        for signal in self.channels:
            if signal.slot in slots:
                flip(mask, signal, self.layout.size, (1 << signal.length) - 1)
        return mask

    def count_on(self, data: np.ndarray, offset: int) -> None:
        """Add to the sequence number."""
        if self._sequence is not None and offset:
            now = _value(data, self._sequence, self.layout.size)
            flip(data, self._sequence, self.layout.size, now ^ (now + offset))

    def seal(self, data: np.ndarray) -> None:
        """Write the CRC that fits the payload, where the layout has one."""
        if self._crc is None:
            return
        size = self.layout.size
        now = _value(data, self._crc, size)
        first, _ = _place(self._crc, size)
        rest = np.delete(data[:size], [first, first + 1]).tobytes()
        good = crc16(rest, crc16((self.can_id & 0xFFFF).to_bytes(2, "little")))
        flip(data, self._crc, size, now ^ good)


def frames_of(topology: Topology, index: int) -> dict[int, list[ExpectedFrame]]:
    """Frames of one bus by identifier."""
    found: dict[int, list[ExpectedFrame]] = {}
    frames = topology.frames
    for f in np.flatnonzero(frames.bus == index):
        can_id, layout = int(frames.can_id[f]), topology.layouts[frames.layout[f]]
        units = frames.units[f, : layout.units].tolist()
        expected = ExpectedFrame(can_id, layout, int(frames.part[f]), units)
        found.setdefault(can_id, []).append(expected)
    return found


def _place(signal: Signal, size: int) -> tuple[int, int]:
    """First byte that a signal touches, and its lowest bit in the payload as one integer."""
    byte, bit = divmod(signal.start, 8)
    if signal.order == "little":
        return byte, signal.start
    return byte, 8 * size - (8 * byte + 7 - bit) - signal.length


def _value(data: np.ndarray, signal: Signal, size: int) -> int:
    """The unsigned integer of a signal."""
    _, shift = _place(signal, size)
    whole = int.from_bytes(data[:size].tobytes(), signal.order)
    return (whole >> shift) & ((1 << signal.length) - 1)


def count_in(data: np.ndarray, signal: Signal, size: int) -> int:
    """The count of a channel."""
    raw, low = _value(data, signal, size), signal.rails[0]
    return low + ((raw - low) & ((1 << signal.length) - 1)) if signal.signed else raw + low


def put_count(data: np.ndarray, signal: Signal, size: int, count: int) -> None:
    """Write the count of a channel, at the rail if it has no room."""
    low, high = signal.rails
    raw = min(max(count, low), high) + signal.bias
    flip(data, signal, size, raw ^ _value(data, signal, size))


def flip(data: np.ndarray, signal: Signal, size: int, bits: int) -> None:
    """Invert bits of a signal, in place."""
    _, shift = _place(signal, size)
    inverted = (bits & ((1 << signal.length) - 1)) << shift
    data[:size] ^= np.frombuffer(inverted.to_bytes(size, signal.order), np.uint8)
