"""From slots to the messages that come every cycle: frames, state, wrenches.

Layouts are fixed once the skin is known: a template of each message is written once, and a cycle
fills its numbers in.
"""

from __future__ import annotations

import numpy as np

from bus.frame import FRAME_DTYPE
from bus.status import INVALID
from skin.contact.record import CONTACT, Flag
from skin.record.cdr import FRAME, HEAD, Cdr, seconds

__all__ = ["FRAMES_AT", "FRAMES_HEAD", "StateEncoder", "WrenchEncoder", "frames_message"]

STAMP = ("sec", "<i4"), ("nanosec", "<u4")


def _at(message: Cdr, fields: dict[str, tuple[str, tuple[int, ...], int]]) -> np.dtype:
    """The record that a template is: kind, shape and place of each field."""
    return np.dtype(
        {
            "names": list(fields),
            "formats": [(kind, shape) for kind, shape, _ in fields.values()],
            "offsets": [place for _, _, place in fields.values()],
            "itemsize": len(message.raw),
        }
    )


def _frames_head() -> tuple[bytes, np.dtype, int]:
    message = Cdr()
    stamp = message.header(0)
    places = {
        "sec": ("<i4", (), stamp),
        "nanosec": ("<u4", (), stamp + 4),
        "event": ("u1", (), message.number("B", 0)),
        "more": ("u1", (), message.number("B", 0)),
        "elapsed_ns": ("<i8", (), message.number("q", 0)),
        "lost_cycles": ("<u8", (), message.number("Q", 0)),
        "lost_frames": ("<u8", (), message.number("Q", 0)),
        "count": ("<u4", (), message.number("I", 0)),
    }
    record = _at(message, places)
    return bytes(message.raw), record, message.align(8)


_FRAMES, FRAMES_HEAD, FRAMES_AT = _frames_head()
"""A ``f3t_msgs/msg/CanFrames`` without frames, its record, and where its first frame stands."""


def frames_message(values: dict[str, int], stamp_ns: int, frames: np.ndarray) -> bytes:
    """A ``f3t_msgs/msg/CanFrames``: a frame is there as it is in memory.

    Parameters
    ----------
    values : dict of str to int
        ``event``, ``more``, ``elapsed_ns``, ``lost_cycles``, ``lost_frames``.
    stamp_ns : int
    frames : ndarray, shape (m,) or (m, 10)
        FRAME_DTYPE, or as words.
    """
    raw = bytearray(_FRAMES)
    record = np.frombuffer(raw, FRAMES_HEAD)
    record["sec"], record["nanosec"] = seconds(stamp_ns)
    for name, value in values.items():
        record[name] = value
    if not len(frames):
        return bytes(raw)
    record["count"] = len(frames)
    return b"".join((raw, bytes(FRAMES_AT - len(raw)), frames.tobytes()))


assert FRAME_DTYPE.itemsize % 8 == 0  # or frames in a list would be padded

CONTACT_MESSAGE = np.dtype(
    {
        "names": ["id", "wrench", "wrench_sigma", "centroid", "normal", "slip", "stick_ratio",
                  "friction", "friction_sigma", "margin", "slip_probability", "grip_force",
                  "grip_force_sigma", "units", "whole"],
        "formats": ["<i8", ("<f8", 6), ("<f8", 6), ("<f8", 3), ("<f8", 3), "u1", *["<f4"] * 7,
                    "<u2", "?"],
        "offsets": [0, 8, 56, 104, 128, 152, *range(156, 184, 4), 184, 186],
        "itemsize": 192,
    }
)  # fmt: skip
"""``f3t_msgs/msg/Contact`` in a list; the last of a list ends with its last field."""
LAST_BYTES = 187
_SAME = ("id", "wrench", "wrench_sigma", "centroid", "normal", "slip", "stick_ratio", "friction",
         "friction_sigma", "margin", "slip_probability", "grip_force",
         "grip_force_sigma")  # fmt: skip


class StateEncoder:
    """Slots to ``f3t_msgs/msg/SkinState``.

    Parameters
    ----------
    n : int
        Units.
    """

    def __init__(self, n: int) -> None:
        message = Cdr()
        stamp = message.header(0)
        places = {
            "sec": ("<i4", (), stamp),
            "nanosec": ("<u4", (), stamp + 4),
            "cycle": ("<u8", (), message.number("Q", 0)),
            "force": ("<f4", (3, n), message.array(np.zeros((3, n), "<f4"))),
            "force_sigma": ("<f4", (3, n), message.array(np.zeros((3, n), "<f4"))),
            "temperature": ("<f4", (n,), message.array(np.zeros(n, "<f4"))),
            "status": ("<u2", (n,), message.array(np.zeros(n, "<u2"))),
            "contact": ("<i4", (n,), message.array(np.zeros(n, "<i4"))),
            "count": ("<u4", (), message.number("I", 0)),
        }
        self._raw, record = message.raw, _at(message, places)
        self._fields = {name: np.frombuffer(self._raw, record)[name] for name in places}
        self._padding = bytes(-(len(self._raw) - len(HEAD)) % 8)

    def __call__(self, slot: np.ndarray) -> bytes:
        """The message of a slot that has a state."""
        fields = self._fields
        fields["sec"][0], fields["nanosec"][0] = seconds(int(slot["stamp_ns"]))
        fields["cycle"][0] = max(0, int(slot["cycle"]))
        for name in ("force", "force_sigma", "temperature", "status", "contact"):
            fields[name][0] = slot[name]
        wrong = slot["status"] & int(INVALID) != 0
        fields["force"][0][:, wrong] = np.nan
        fields["temperature"][0][wrong] = np.nan
        contacts = contacts_of(slot)
        fields["count"][0] = contacts.size
        if not contacts.size:
            return bytes(self._raw)
        listed = np.zeros(contacts.size, CONTACT_MESSAGE)
        for name in _SAME:
            listed[name] = contacts[name]
        listed["units"] = contacts["end"] - contacts["begin"]
        listed["whole"] = contacts["flags"] & Flag.UNSEEN == 0
        tail = CONTACT_MESSAGE.itemsize - LAST_BYTES
        return b"".join((self._raw, self._padding, listed.tobytes()[:-tail]))


class WrenchEncoder:
    """Six numbers to ``geometry_msgs/msg/WrenchStamped`` in the skin frame."""

    def __init__(self) -> None:
        message = Cdr()
        stamp = message.header(0, FRAME)
        places = {
            "sec": ("<i4", (), stamp),
            "nanosec": ("<u4", (), stamp + 4),
            "wrench": ("<f8", (6,), message.number("d", *[0.0] * 6)),
        }
        self._raw, record = message.raw, _at(message, places)
        self._fields = {name: np.frombuffer(self._raw, record)[name] for name in places}

    def __call__(self, stamp_ns: int, wrench: np.ndarray) -> bytes:
        """The message of a wrench, shape (6,)."""
        fields = self._fields
        fields["sec"][0], fields["nanosec"][0] = seconds(stamp_ns)
        fields["wrench"][0] = wrench
        return bytes(self._raw)


def contacts_of(slot: np.ndarray) -> np.ndarray:
    """The CONTACT records of a slot, shape (k,)."""
    return slot["contacts"][: int(slot["contact_count"])].view(CONTACT)[:, 0]
