"""FrameTable: the wire layouts of a topology as tables for kernels.

n units, c channels, f frames, m signals, g sets of units, b buses.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.errors import LayoutError
from bus.frame import FRAME_DTYPE, PAYLOAD
from topology import CHANNELS, Signal, Topology, WireLayout
from topology.wire import UNIT_FIELDS

__all__ = ["EXPECTED", "EXTENDED", "FIELD", "SIGNAL", "FrameTable", "Tables"]

SWAPPED, BYTE_AT, SHIFT_MASK = 1 << 5, 6, (1 << 5) - 1
FIELD = np.dtype([("where", np.uint32), ("mask", np.uint32)], align=True)
"""A bit field: four bytes of the record as one number, shifted right and masked. `where` has the
first of the bytes from bit BYTE_AT on, SWAPPED where the high byte comes first, and the shift below
that: in one number, since the time to read a signal is proportional to its fields. A mask of 0:
there is no such field."""
SIGNAL = np.dtype(
    [
        ("field", FIELD),
        ("flip", np.int32),
        ("bias", np.int32),
        ("target", np.int32),
        ("unit", np.int32),
        ("place", np.int32),
    ],
    align=True,
)
"""A signal of a frame. Its count is (field ^ flip) - bias: that is how signs, and 16 bits unsigned,
are read. `target` is the channel, or, from c on, the unit's status; `place` that of the count in
the channels of all units, one after the other."""
EXPECTED = np.dtype(
    [
        ("bus", np.uint32),
        ("identifier", np.uint32),
        ("size", np.uint32),
        ("is_fd", np.uint32),
        ("first_channel", np.uint32),
        ("first_status", np.uint32),
        ("end_status", np.uint32),
        ("group", np.uint32),
        ("part", np.uint32),
        ("pages", np.uint32),
        ("page", np.uint32),
        ("is_awaited", np.uint32),
        ("echoes", np.uint32),
        ("crc_place", np.uint32),
        ("sequence", FIELD),
        ("status", FIELD),
        ("crc", FIELD),
    ],
    align=True,
)
"""A data frame of the topology. Its signals are rows of `Tables.signals`: channels from
`first_channel`, status from `first_status` to before `end_status`. `pages` frames have the same
identifier (0: it is the frame's own), and `page` as their first byte. `echoes`: its sequence number
is the counter of the SYNC. Indexing by unsigned integers spares the test for negative ones."""
EXTENDED = np.dtype([("key", np.int64), ("frame", np.int64)])
"""``bus << 32 | identifier`` of a 29-bit identifier, and its frame."""


class Tables(NamedTuple):
    """Expected frames of a topology, for kernels."""

    frames: np.ndarray
    """Shape (f,), EXPECTED: layout of each frame."""
    signals: np.ndarray
    """Shape (m,), SIGNAL."""
    units: np.ndarray
    """Shape (f, s), int32: unit in each slot, or -1."""
    standard: np.ndarray
    """Shape (b, 2048), int32: frame of each 11-bit identifier (the first of its pages), or -1."""
    extended: np.ndarray
    """Shape (e,), EXTENDED, sorted by key."""
    groups: np.ndarray
    """Shape (g, p), int32: frames of the sets of units by part, -1 past the last part or where
    there is none."""
    parts: np.ndarray
    """Shape (g,), int32: frames that make a set whole."""


class FrameTable:
    """Tables of the data frames of a topology.

    Parameters
    ----------
    topology : Topology

    Attributes
    ----------
    tables : Tables
    units : ndarray, shape (f, s), int32
        Those of `tables`.
    unit_group : ndarray, shape (n,), int32
        Set that the unit belongs to, -1 for none.

    Raises
    ------
    LayoutError
        A signal outside of its frame, or a crc of another shape.
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
        rows = [np.zeros(0, SIGNAL)]
        first_row = 0

        firsts: dict[tuple[int, int, int], int] = {}
        self._frames = np.zeros(len(expected), EXPECTED)
        for f in range(len(expected)):
            bus, layout_index = int(expected.bus[f]), int(expected.layout[f])
            part, can_id = int(expected.part[f]), int(expected.can_id[f])
            layout = topology.layouts[layout_index]
            carried = self.units[f][self.units[f] >= 0]
            row = self._frames[f]
            row["bus"], row["identifier"] = bus, can_id
            row["size"], row["is_fd"] = layout.size, layout.fd
            rows.append(_of_units(signals[layout_index, part], self.units[f], topology.n))
            channels = int(np.count_nonzero(rows[-1]["target"] < len(CHANNELS)))
            row["first_channel"], row["first_status"] = first_row, first_row + channels
            row["end_status"] = first_row = first_row + len(rows[-1])
            first_id = can_id if layout.pages else can_id - part
            row["group"] = firsts.setdefault((bus, layout_index, first_id), len(firsts))
            row["part"] = part
            if layout.pages:
                row["pages"], row["page"] = layout.parts, layout.pages[part]
            row["is_awaited"] = topology.enabled[carried].any()
            has_sync = topology.sync_id is not None
            row["echoes"] = has_sync and layout.sequence == "sync"
            _frame_fields(layout, part, row)
        groups, parts = self._group(topology, len(firsts))
        standard, extended = self._index(topology)
        self.tables = Tables(
            self._frames, np.concatenate(rows), self.units, standard, extended, groups, parts
        )

    def _group(self, topology: Topology, count: int) -> tuple[np.ndarray, np.ndarray]:
        most = max((layout.parts for layout in topology.layouts), default=1)
        groups, parts = np.full((count, most), -1, np.int32), np.ones(count, np.int32)
        self.unit_group = np.full(topology.n, -1, np.int32)
        for f, row in enumerate(self._frames):
            groups[row["group"], row["part"]] = f
            parts[row["group"]] = topology.layouts[topology.frames.layout[f]].parts
            self.unit_group[self.units[f][self.units[f] >= 0]] = row["group"]
        return groups, parts

    def _index(self, topology: Topology) -> tuple[np.ndarray, np.ndarray]:
        bus, can_id = topology.frames.bus, topology.frames.can_id.astype(np.int64)
        is_standard = can_id < 2048
        # Of the pages of one identifier the first; the others follow it.
        frame = np.arange(can_id.size) - self._frames["part"] * (self._frames["pages"] > 0)
        standard = np.full((len(topology.buses), 2048), -1, np.int32)
        standard[bus[is_standard], can_id[is_standard]] = frame[is_standard]
        extended = np.zeros(np.count_nonzero(~is_standard), EXTENDED)
        extended["key"] = (bus.astype(np.int64) << 32 | can_id)[~is_standard]
        extended["frame"] = frame[~is_standard]
        return standard, np.sort(extended, order="key", kind="stable")


def _field_of(signal: Signal, size: int) -> tuple[int, int]:
    """Place of a signal in a record, and its mask: a FIELD.

    The four bytes are within the record, if not within the frame; the mask removes bits outside of
    the signal.
    """
    first, bit = divmod(signal.start, 8)
    if signal.order == "little":
        shift, last = bit, (signal.start + signal.length - 1) // 8
        byte = min(PAYLOAD + first, FRAME_DTYPE.itemsize - 4)
        shift += 8 * (PAYLOAD + first - byte)
    else:
        last, bit = divmod(8 * first + 7 - bit + signal.length - 1, 8)
        shift, byte = 7 - bit, PAYLOAD + last - 3
    if not 0 <= first <= last < size:
        raise ValueError(f"must lie within the {size} bytes of its frame")
    swapped = SWAPPED if signal.order == "big" else 0
    return byte << BYTE_AT | swapped | shift, (1 << signal.length) - 1


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
        rows.append((_field(layout, signal), flip, bias, target, signal.slot, 0))
    return np.array(rows, SIGNAL)


def _of_units(signals: np.ndarray, units: np.ndarray, n: int) -> np.ndarray:
    """Rows of `_signals`, for the units in the slots of one frame."""
    rows = signals.copy()
    rows["unit"] = units[signals["unit"]]
    rows["place"] = rows["target"] * n + rows["unit"]
    return rows[rows["unit"] >= 0]


def _frame_fields(layout: WireLayout, part: int, row: np.void) -> None:
    """The fields of one frame's sequence, status and crc."""
    for name in ("sequence", "status", "crc"):
        signal = layout.frame_field(name, part)
        # Without the field the mask is 0, and reading gives 0.
        where, mask = (PAYLOAD << BYTE_AT, 0) if signal is None else _field(layout, signal)
        row[name]["where"], row[name]["mask"] = where, mask
        if name == "crc" and signal is not None:
            if signal.length != 16 or where & SHIFT_MASK:
                raise _wrong(layout, signal, "must be 16 bits that fill two bytes",
                             f"{signal.length} bits from bit {signal.start}")  # fmt: skip
            row["crc_place"] = PAYLOAD + signal.start // 8


def _field(layout: WireLayout, signal: Signal) -> tuple[int, int]:
    try:
        return _field_of(signal, layout.size)
    except ValueError as error:
        got = f"{signal.length} bits from bit {signal.start}, {signal.order} endian"
        raise _wrong(layout, signal, str(error), got) from None


def _wrong(layout: WireLayout, signal: Signal, expected: str, got: str) -> LayoutError:
    where = f"layout {layout.name!r}: signal {signal.name!r} (slot {signal.slot})"
    return LayoutError(f"{where}: {expected}; got {got}")
