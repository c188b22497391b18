"""What cantools and canmatrix make of DBC files, and what our own unpacking makes of frames."""

import canmatrix.formats
import cantools
import numpy as np

from bus import kernels
from bus.dbc import dbc_text
from bus.table import FrameTable
from topology import CHANNELS


def by_cantools(topology, bus=0):
    """Load the DBC of a bus with cantools."""
    return cantools.database.load_string(dbc_text(topology, bus), "dbc")


def by_canmatrix(topology, bus=0):
    """Load the DBC of a bus with canmatrix."""
    text = dbc_text(topology, bus).encode()
    (matrix,) = canmatrix.formats.loads(text, "dbc", flat_import=False).values()
    return matrix


class Unpacker:
    """Physical values of single frames, by our tables and kernels."""

    def __init__(self, topology):
        self.topology = topology
        self.table = FrameTable(topology)
        frames = topology.frames
        self.rows = {}
        for f in range(len(frames)):
            self.rows.setdefault((int(frames.bus[f]), int(frames.can_id[f])), []).append(f)

    def __call__(self, record):
        """Return (values by unit name and channel, fault codes by unit name) of one record."""
        topology = self.topology
        data = kernels.as_bytes(np.atleast_1d(record))
        f = self.rows[int(record["bus"]), int(record["id"])][0]
        f = kernels._page_of(f, 0, data, self.table.frames)
        counts = np.zeros((len(CHANNELS), topology.n), np.int16)
        codes = np.zeros(topology.n, np.uint8)
        table = self.table
        data, flat = kernels.as_bytes(np.atleast_1d(record)), counts.reshape(-1)
        kernels.unpack_frame(data, 0, f, table.frames, table.signals, table.units, flat, codes)
        physical = topology.scale * counts + topology.offset
        layout = topology.layouts[topology.frames.layout[f]]
        units = topology.frames.units[f]
        values = {
            f"{topology.unit_names[units[s.slot]]} {s.name}": (
                physical[CHANNELS.index(s.name), units[s.slot]]
            )
            for s in layout.signals
            if s.name in CHANNELS and s.part == topology.frames.part[f] and units[s.slot] >= 0
        }
        return values, {topology.unit_names[u]: int(codes[u]) for u in units if u >= 0}
