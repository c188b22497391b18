"""Addresses: bus, frame and bits of each unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from topology.arrays import Frames
from topology.wire import WireLayout

__all__ = ["EXTENDED", "Address", "number", "to_frames"]

EXTENDED = 0x8000_0000
"""Bit 31 of a SocketCAN identifier: it is a 29-bit one."""


@dataclass(frozen=True)
class Address:
    """Addresses of n units on the buses.

    Attributes
    ----------
    bus, layout : ndarray, shape (n,), int32
        Indices into the buses and layouts.
    can_id : ndarray, shape (n,), int64
        Identifier of the unit's frame (the first of its parts), bit 31 set for a 29-bit one.
    slot : ndarray, shape (n,), int32
        Place in the frame.
    """

    bus: np.ndarray
    layout: np.ndarray
    can_id: np.ndarray
    slot: np.ndarray


def number(n: int, first_id: int, layout: WireLayout) -> tuple[np.ndarray, np.ndarray]:
    """Identifiers and slots of n consecutive units: `layout.units` a frame, `layout.ids` ids a
    frame.

    Returns
    -------
    can_id, slot : ndarray, shape (n,), int64
    """
    group, slot = np.divmod(np.arange(n), layout.units)
    return first_id + group * layout.ids, slot


def to_frames(address: Address, layouts: tuple[WireLayout, ...]) -> Frames:
    """The frames of these units; addresses must not clash."""
    key = np.stack([address.bus, address.can_id, address.layout]).astype(np.int64)
    groups, member = np.unique(key, axis=1, return_inverse=True)
    member = member.reshape(-1)
    units = np.full((groups.shape[1], max(layout.units for layout in layouts)), -1, np.int32)
    units[member, address.slot] = np.arange(member.size)

    parts = np.array([layout.parts for layout in layouts])[groups[2]]
    frame = np.repeat(np.arange(parts.size), parts)
    part = np.arange(frame.size) - np.repeat(np.cumsum(parts) - parts, parts)
    has_ids = np.array([layout.ids > 1 for layout in layouts])[groups[2]]
    return Frames(
        bus=groups[0, frame].astype(np.int32),
        can_id=(groups[1, frame] + part * has_ids[frame]).astype(np.uint32),
        layout=groups[2, frame].astype(np.int32),
        part=part.astype(np.int32),
        units=units[frame],
    )
