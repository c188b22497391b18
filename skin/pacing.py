"""SYNC frames, their duration on the wire, and waiting until one is due."""

from __future__ import annotations

import time

import numpy as np

from bus.frame import FRAME_DTYPE
from topology import Topology

__all__ = ["SYNC_BITS", "sync_frames", "sync_ns", "wait_until"]

SYNC_BITS = 57
"""Bits of a SYNC frame until its end, at which units sample: 52 without stuff bits, at most 62
[derived: ISO 11898-1, 11 bits of identifier and a byte]. A frame that is on the wire already
delays it by its own time."""


def sync_frames(topology: Topology) -> np.ndarray:
    """A SYNC for each bus, shape (b,), FRAME_DTYPE; without stamp and counter."""
    frames = np.zeros(len(topology.buses), FRAME_DTYPE)
    for i, bus in enumerate(topology.buses):
        frames[i]["id"] = bus.sync_id or 0
        frames[i]["length"] = 1
        frames[i]["bus"] = i
    return frames


def sync_ns(topology: Topology) -> np.ndarray:
    """Duration of a SYNC on the wire of each bus, shape (b,), int64."""
    rates = np.array([bus.bitrate for bus in topology.buses], float)
    return np.round(SYNC_BITS * 1e9 / rates).astype(np.int64)


def wait_until(due: int, period: int) -> tuple[int, int]:
    """Sleep until `due`; if that is more than a period ago, count the missed periods."""
    now = time.monotonic_ns()
    if now < due:
        time.sleep((due - now) * 1e-9)
        return due, 0
    skipped = (now - due) // period
    return due + skipped * period, int(skipped)
