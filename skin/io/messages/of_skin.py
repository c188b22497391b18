"""All messages of a cycle, from its record."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from skin.io.messages.cdr import FRAME
from skin.io.messages.diagnostics import Diagnostics
from skin.io.messages.encode import StateEncoder, WrenchEncoder
from skin.io.messages.record import contacts_of
from skin.io.messages.scene import Layout
from skin.io.messages.topics import CONTACT, DIAGNOSTICS, STATE, WRENCH

__all__ = ["SkinMessages"]

SLOW_NS = 1_000_000_000
"""Interval of diagnostics, which ROS tools expect."""
NOTHING = np.zeros(6)


class SkinMessages:
    """Messages of the cycles of a skin.

    Parameters
    ----------
    skin : mapping
        As of `skin.io.messages.record.described`.
    into : str
        Output that drops cycles, as diagnostics name it: "recording" or "publishing".
    name : str
        Of the skin in diagnostics.
    frame : str
        Name of the skin frame.
    patch_frames : sequence of str, optional
        Names of the frames of patches; names of the patches if not given.
    counters : ndarray, shape (15,), int64, optional
        Counts before the first record, which diagnostics subtract.

    Attributes
    ----------
    layout : Layout
    diagnostics : Diagnostics
    """

    def __init__(
        self,
        skin: Mapping[str, Any],
        into: str,
        *,
        name: str = "skin",
        frame: str = FRAME,
        patch_frames: Sequence[str] | None = None,
        counters: np.ndarray | None = None,
    ) -> None:
        self.layout = Layout(skin, frame, skin["patches"] if patch_frames is None else patch_frames)
        self.diagnostics = Diagnostics(skin, into, name, counters)
        self._state = StateEncoder(len(skin["names"]), frame)
        self._wrench = WrenchEncoder(frame)
        self._slots: dict[int, int] = {}
        self._slow_ns = -(1 << 62)

    def of_state(self, record: np.ndarray) -> Iterator[tuple[str, bytes]]:
        """Topics and messages of a record: state, wrenches, and diagnostics if they are due. An
        ended contact has one more wrench, of zeros."""
        stamp_ns = max(0, int(record["stamp_ns"]))
        yield STATE, self._state(record)
        if not np.isnan(record["wrench"][0]):
            yield WRENCH, self._wrench(stamp_ns, record["wrench"])
        for slot, wrench in self._contacts(contacts_of(record)):
            yield f"{CONTACT}/{slot}", self._wrench(stamp_ns, wrench)
        if abs(stamp_ns - self._slow_ns) >= SLOW_NS:
            self._slow_ns = stamp_ns
            yield DIAGNOSTICS, self.diagnostics.message(record)

    def _contacts(self, contacts: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Wrenches of contacts, each with its number: the lowest free one at its begin, kept until
        its end."""
        present = contacts["id"].tolist()
        ended = [self._slots.pop(one) for one in list(self._slots) if one not in present]
        taken = set(self._slots.values())
        for identity, contact in zip(present, contacts, strict=True):
            if identity not in self._slots:
                slot = next(number for number in range(len(taken) + 1) if number not in taken)
                taken.add(slot)
                self._slots[identity] = slot
            yield self._slots[identity], contact["wrench"]
        for slot in ended:
            if slot not in taken:
                yield slot, NOTHING
