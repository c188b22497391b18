"""FrameTable: the wire layouts of a topology as the integer tables that the kernels read."""

from __future__ import annotations

import numpy as np

from bus import kernels as k
from bus.errors import LayoutError
from bus.frame import FRAME_DTYPE
from topology import CHANNELS, Signal, Topology, WireLayout
from topology.wire import UNIT_FIELDS

__all__ = ["FrameTable"]


class FrameTable:
    """Tables of the f data frames of a topology; columns are named in `bus.kernels`.

    Parameters
    ----------
    topology : Topology

    Attributes
    ----------
    frames : ndarray, shape (f, FRAME_COLUMNS), uint32
        What each frame looks like, and which rows of `signals` it has.
    signals : ndarray, shape (m, SIGNAL_COLUMNS), int32
    units : ndarray, shape (f, s), int32
        Unit in each slot, or -1.
    standard : ndarray, shape (buses, 2048), int32
        Frame of each 11-bit identifier (the first of its pages), or -1.
    extended : ndarray, shape (e, 2), int64
        Sorted ``bus << 32 | identifier`` of the frames with 29-bit identifiers, and the frame.
    groups : ndarray, shape (g, p), int32
        Frames of the g sets of units by part, -1 past the last part or where there is none.
    parts : ndarray, shape (g,), int32
        Frames that make a set whole.
    unit_group : ndarray, shape (n,), int32
        Set that the unit belongs to, -1 for none.
    tables : Tables
        All of the above but the last, as the kernels take them.

    Raises
    ------
    LayoutError
        A signal that is not within its frame, or a crc of another shape.
    """

    def __init__(self, topology: Topology) -> None:
        expected = topology.frames
        # A copy, because a topology's arrays are read-only.
        self.units = np.array(expected.units, np.int32, order="C")
        signals = {
            (index, part): _signals(layout, part)
            for index, layout in enumerate(topology.layouts)
            for part in range(layout.parts)
        }
        rows = [np.zeros((0, k.SIGNAL_COLUMNS), np.int32)]
        first_row = 0

        firsts: dict[tuple[int, int, int], int] = {}
        self.frames = np.zeros((len(expected), k.FRAME_COLUMNS), np.uint32)
        for f in range(len(expected)):
            bus, layout_index = int(expected.bus[f]), int(expected.layout[f])
            part, can_id = int(expected.part[f]), int(expected.can_id[f])
            layout = topology.layouts[layout_index]
            carried = self.units[f][self.units[f] >= 0]
            row = self.frames[f]
            row[k.BUS] = bus
            row[k.IDENTIFIER] = can_id
            row[k.SIZE], row[k.IS_FD] = layout.size, layout.fd
            rows.append(_of_units(signals[layout_index, part], self.units[f], topology.n))
            channels = int(np.count_nonzero(rows[-1][:, k.CHANNEL] < k.CHANNEL_COUNT))
            row[k.FIRST_CHANNEL], row[k.FIRST_STATUS] = first_row, first_row + channels
            row[k.END_STATUS] = first_row = first_row + len(rows[-1])
            first_id = can_id if layout.pages else can_id - part
            row[k.GROUP] = firsts.setdefault((bus, layout_index, first_id), len(firsts))
            row[k.PART] = part
            if layout.pages:
                row[k.PAGES], row[k.PAGE] = layout.parts, layout.pages[part]
            row[k.AWAITED] = topology.enabled[carried].any()
            has_sync = topology.buses[bus].sync_id is not None
            row[k.ECHOES] = has_sync and layout.sequence == "sync"
            _frame_fields(layout, part, row)
        self.signals = np.concatenate(rows)
        self._group(topology, len(firsts))
        self._index(topology)
        self.tables = k.Tables(
            self.frames, self.signals, self.units, self.standard, self.extended, self.groups,
            self.parts,
        )  # fmt: skip

    def _group(self, topology: Topology, count: int) -> None:
        most = max((layout.parts for layout in topology.layouts), default=1)
        self.groups = np.full((count, most), -1, np.int32)
        self.parts = np.ones(count, np.int32)
        self.unit_group = np.full(topology.n, -1, np.int32)
        for f, row in enumerate(self.frames):
            self.groups[row[k.GROUP], row[k.PART]] = f
            self.parts[row[k.GROUP]] = topology.layouts[topology.frames.layout[f]].parts
            self.unit_group[self.units[f][self.units[f] >= 0]] = row[k.GROUP]

    def _index(self, topology: Topology) -> None:
        bus, can_id = topology.frames.bus, topology.frames.can_id.astype(np.int64)
        is_standard = can_id < 2048
        # Of the pages of one identifier the first; the others follow it.
        paged = self.frames[:, k.PAGES] > 0
        frame = np.arange(can_id.size) - self.frames[:, k.PART] * paged
        self.standard = np.full((len(topology.buses), 2048), -1, np.int32)
        self.standard[bus[is_standard], can_id[is_standard]] = frame[is_standard]
        others = np.stack([bus.astype(np.int64) << 32 | can_id, frame], axis=1)[~is_standard]
        self.extended = others[np.argsort(others[:, 0])].reshape(-1, 2)


def _field_of(signal: Signal, size: int) -> tuple[int, int]:
    """Where a signal lies in a record, and its mask: the two columns of a field.

    The four bytes lie within the record, if not within the frame; the mask takes away what is not
    the signal's.
    """
    first, bit = divmod(signal.start, 8)
    if signal.order == "little":
        shift, last = bit, (signal.start + signal.length - 1) // 8
        byte = min(k.PAYLOAD + first, FRAME_DTYPE.itemsize - 4)
        shift += 8 * (k.PAYLOAD + first - byte)
    else:
        last, bit = divmod(8 * first + 7 - bit + signal.length - 1, 8)
        shift, byte = 7 - bit, k.PAYLOAD + last - 3
    if not 0 <= first <= last < size:
        raise ValueError(f"must lie within the {size} bytes of its frame")
    swapped = k.SWAPPED if signal.order == "big" else 0
    return byte << k.BYTE_AT | swapped | shift, (1 << signal.length) - 1


def _signals(layout: WireLayout, part: int) -> np.ndarray:
    """Rows of `signals` for one part of a layout, channels first, with the slot for a unit."""
    targets = (*CHANNELS, *UNIT_FIELDS)
    found = [s for s in layout.signals if s.part == part and s.name in targets]
    rows = []
    for signal in sorted(found, key=lambda signal: signal.name in UNIT_FIELDS):
        if signal.slot >= layout.units:
            raise _wrong(layout, signal, f"must be in one of {layout.units} slots",
                         f"slot {signal.slot}")  # fmt: skip
        is_channel = signal.name in CHANNELS
        flip = 1 << (signal.length - 1) if signal.signed and is_channel else 0
        bias = -signal.rails[0] if is_channel else 0
        target = targets.index(signal.name)
        rows.append([*_field(layout, signal), flip, bias, target, signal.slot, 0])
    return np.array(rows, np.int32).reshape(-1, k.SIGNAL_COLUMNS)


def _of_units(signals: np.ndarray, units: np.ndarray, n: int) -> np.ndarray:
    """Rows of `_signals`, for the units in the slots of one frame."""
    rows = signals.copy()
    rows[:, k.UNIT] = units[signals[:, k.UNIT]]
    rows[:, k.PLACE] = rows[:, k.CHANNEL] * n + rows[:, k.UNIT]
    return rows[rows[:, k.UNIT] >= 0]


def _frame_fields(layout: WireLayout, part: int, row: np.ndarray) -> None:
    """The columns of one frame's sequence, status and crc."""
    for name, column in (("sequence", k.SEQUENCE), ("status", k.STATUS), ("crc", k.CRC)):
        signal = layout.frame_field(name, part)
        # Without the field the mask is 0, and reading gives 0.
        field = (k.PAYLOAD << k.BYTE_AT, 0) if signal is None else _field(layout, signal)
        row[column : column + k.FIELD_WIDTH] = field
        if name == "crc" and signal is not None:
            if signal.length != 16 or field[k.WHERE] & k.SHIFT_MASK:
                raise _wrong(layout, signal, "must be 16 bits that fill two bytes",
                             f"{signal.length} bits from bit {signal.start}")  # fmt: skip
            row[k.CRC_PLACE] = k.PAYLOAD + signal.start // 8


def _field(layout: WireLayout, signal: Signal) -> tuple[int, int]:
    try:
        return _field_of(signal, layout.size)
    except ValueError as error:
        got = f"{signal.length} bits from bit {signal.start}, {signal.order} endian"
        raise _wrong(layout, signal, str(error), got) from None


def _wrong(layout: WireLayout, signal: Signal, expected: str, got: str) -> LayoutError:
    where = f"layout {layout.name!r}: signal {signal.name!r} (slot {signal.slot})"
    return LayoutError(f"{where}: {expected}; got {got}")
