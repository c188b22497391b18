"""From the record of a cycle to all messages of it, in their order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from skin.messages.cdr import FRAME
from skin.messages.diagnostics import Diagnostics
from skin.messages.encode import StateEncoder, WrenchEncoder
from skin.messages.record import contacts_of
from skin.messages.scene import Layout
from skin.messages.topics import CONTACT, DIAGNOSTICS, STATE, WRENCH

__all__ = ["SkinMessages"]

SLOW_NS = 1_000_000_000
"""Time of the state between two diagnostics: what diagnostic tools of ROS expect."""
NOTHING = np.zeros(6)


class SkinMessages:
    """Messages of the cycles of a skin.

    Parameters
    ----------
    skin : mapping
        As of `skin.messages.record.described`.
    into : str
        What cycles are left out of, as diagnostics name it: "recording" or "publishing".
    name : str
        Of the skin in diagnostics.
    frame : str
        Of the skin.
    patch_frames : sequence of str, optional
        Of the patches; their names if not given.
    counters : ndarray, shape (15,), int64, optional
        Frames before the first record, which diagnostics do not count.

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
        """Topics and messages of a record: state, wrenches, and diagnostics if they are due. A
        contact that has ended is a wrench of zeros, once."""
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
        """Wrenches of contacts, each with its number: the lowest that is free when it begins, the
        same as long as it lasts."""
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
