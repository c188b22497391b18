"""Small topologies of any layout, and frames made by hand, for the tests of the bus."""

from dataclasses import replace

import numpy as np

import topology
from bus import FRAME_DTYPE, FrameBatch, Packer
from topology import CHANNELS, LAYOUTS, Bus, Frames, Signal, Topology, WireLayout

SYNC_ID = 0x80
PERIOD_NS = 10_000_000
PLAIN = topology.load("strip")
TWO_PARTS = WireLayout(
    name="two-parts",
    size=6,
    units=2,
    parts=2,
    signals=tuple(
        Signal(name=name, start=22 * slot + 11 * i, length=11, signed=True, slot=slot, part=part)
        for part, names in enumerate([("gel", "bx"), ("frequency", "by")])
        for slot in range(2)
        for i, name in enumerate(names)
    )
    + tuple(Signal(name="sequence", start=44, length=4, part=part) for part in range(2)),
)
"""Two units in two frames: gel and bx in the first, frequency and by in the second."""


def name_of(layout):
    """Name of a layout, as the id of a test."""
    return layout.name if isinstance(layout, WireLayout) else None


def make_topology(
    layout="f3t-classic",
    units=4,
    *,
    buses=1,
    sync_id=SYNC_ID,
    first_id=0x100,
    frozen_cycles=0,
    enabled=None,
):
    """Lay `units` out in turn over `buses`, with identifiers that count up from `first_id`."""
    layout = LAYOUTS[layout] if isinstance(layout, str) else layout
    per_bus = -(-units // buses)
    rows = []
    for b in range(buses):
        mine = range(b * per_bus, min((b + 1) * per_bus, units))
        for g, start in enumerate(range(mine.start, mine.stop, layout.units)):
            carried = [u if u < mine.stop else -1 for u in range(start, start + layout.units)]
            for part in range(layout.parts):
                can_id = first_id + g * layout.ids + (0 if layout.pages else part)
                rows.append((b, can_id, part, carried))
    frames = Frames(
        bus=np.array([row[0] for row in rows], np.int32),
        can_id=np.array([row[1] for row in rows], np.uint32),
        layout=np.zeros(len(rows), np.int32),
        part=np.array([row[2] for row in rows], np.int32),
        units=np.array([row[3] for row in rows], np.int32).reshape(len(rows), layout.units),
    )
    parameters = {name: np.resize(values, units) for name, values in PLAIN.parameters.items()
                  if values.ndim == 1}  # fmt: skip
    parameters["frozen_cycles"] = np.full(units, float(frozen_cycles))
    return Topology(
        name="small",
        path=None,
        buses=tuple(
            Bus(name=f"bus{b}", channel=f"small{b}", cycle_rate_hz=1e9 / PERIOD_NS, sync_id=sync_id)
            for b in range(buses)
        ),
        layouts=(layout,),
        frames=frames,
        unit_names=tuple(f"patch/{i}" for i in range(units)),
        patch_names=("patch",),
        patch=np.zeros(units, np.int32),
        enabled=np.ones(units, bool) if enabled is None else np.array(enabled, bool),
        position=np.zeros((3, units)),
        rotation=np.zeros((3, 3, units)),
        area=np.full(units, 1e-4),
        parameters=parameters,
        scale=np.ones((len(CHANNELS), units)),
        offset=np.zeros((len(CHANNELS), units)),
        wired=np.ones((len(CHANNELS), units), bool),
        neighbour_start=np.zeros(units + 1, np.int32),
        neighbour_index=np.zeros(0, np.int32),
    )


def with_data_ids(small, ids):
    """Return the topology with other identifiers for its frames, in order."""
    return replace(small, frames=replace(small.frames, can_id=np.array(ids, np.uint32)))


def counts_of(small, value):
    """Counts that fit every built-in layout and differ by unit, channel and `value`."""
    channel, unit = np.indices((len(CHANNELS), small.n))
    return ((7 * value + 3 * unit + channel) % 100).astype(np.int16)


def data_frames(small, value, sequence, *, stamp_ns=0, fault_code=None, bus=None):
    """Pack the frames of one cycle, with the counts of `counts_of`."""
    batch = FrameBatch(len(small.frames))
    Packer(small)(
        counts_of(small, value), batch, sequence=sequence, stamp_ns=stamp_ns,
        fault_code=fault_code, bus=bus,
    )  # fmt: skip
    return batch.frames.copy()


def frame(can_id, data=b"", **fields):
    """Make one record, shape (1,)."""
    batch = FrameBatch(1)
    batch.append(can_id, bytes(data), **fields)
    return batch.frames


def sync(counter, *, bus=0, stamp_ns=0):
    """Make a SYNC record, shape (1,)."""
    return frame(SYNC_ID, bytes([counter & 0xFF]), bus=bus, stamp_ns=stamp_ns)


def join(*parts):
    """Put records one after the other."""
    return np.concatenate(parts) if parts else np.zeros(0, FRAME_DTYPE)
