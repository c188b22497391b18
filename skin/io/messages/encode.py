"""Encoders for the messages of every cycle: frames, state, wrenches.

The layout of a message is fixed for a skin: a template is encoded once, and each cycle fills in its
numbers.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bus.frame import FRAME_DTYPE
from bus.status import INVALID
from skin.contact.record import QUANTITIES, Flag
from skin.io.messages.cdr import FRAME, HEAD, Cdr, seconds
from skin.io.messages.definitions import NUMBERS, STATE_VERSION, Field, definitions, schema
from skin.io.messages.record import contacts_of

__all__ = ["FRAMES_AT", "FRAMES_HEAD", "StateEncoder", "WrenchEncoder", "frames_message"]

Definitions = Mapping[str, tuple[Field, ...]]
"""The fields of messages, by name; see `skin.io.messages.definitions.definitions`."""
Places = dict[str, tuple[str, tuple[int, ...], int]]
"""Kind, shape and offset of each field of a template."""


def _at(message: Cdr, fields: Places) -> np.dtype:
    """The dtype of a template: kind, shape and offset of each field."""
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
"""A ``f3t_msgs/msg/CanFrames`` without frames, its dtype, and the offset of its first frame."""


def frames_message(values: dict[str, int], stamp_ns: int, frames: np.ndarray) -> bytes:
    """A ``f3t_msgs/msg/CanFrames``: frames have the same layout as in memory.

    Parameters
    ----------
    values : dict of str to int
        ``event``, ``more``, ``elapsed_ns``, ``lost_cycles``, ``lost_frames``.
    stamp_ns : int
    frames : ndarray, shape (m,) or (m, 10)
        FRAME_DTYPE, or as 64-bit words.
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

STATE_KIND, CONTACT_KIND = "f3t_msgs/msg/SkinState", "f3t_msgs/msg/Contact"
ROWS = {"force": 3, "force_sigma": 3}
"""Rows of the arrays of a state; others have one."""

OF_STATE = ("force", "force_sigma", "temperature", "test_ratio", "status", "contact", "whole")
"""Fields that are copied from a record."""
NAN_SINCE = {"force": 1, "temperature": 1, "force_sigma": 3}
"""Fields that are NaN where a unit is invalid, and the version that introduced this."""
BOUNDS, BOUNDS_SINCE = ("friction", "margin", "grip_force"), 5
"""Of a contact whose friction is not known: bounds since this version, NaN before."""


def _contact_record(known: Definitions) -> tuple[np.dtype, int]:
    """The dtype of a contact in a list, and the bytes of the last one in a list, which has no
    padding at its end."""
    names: list[str] = []
    formats: list[np.dtype] = []
    offsets: list[int] = []
    end = 0
    for field in known[CONTACT_KIND]:
        kind, count = (field.kind, field.size) if field.is_array else _flat(known, field.kind)
        one = np.dtype((NUMBERS[kind], (count,) if count else ()))
        end += -end % one.base.itemsize
        names.append(field.name)
        formats.append(one)
        offsets.append(end)
        end += one.itemsize
    size = end + -end % formats[0].base.itemsize  # the next one begins with its first field
    dtype = np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
    )  # fmt: skip
    return dtype, end


def _flat(known: Definitions, kind: str) -> tuple[str, int]:
    """Kind and count of the numbers in a field; 0 for text."""
    if kind in NUMBERS:
        return kind, 0
    parts = [_flat(known, field.kind) for field in known[kind]]
    return parts[0][0], sum(max(count, 1) for _, count in parts)


class StateEncoder:
    """Records to ``f3t_msgs/msg/SkinState``.

    Parameters
    ----------
    n : int
        Units.
    frame : str
        Of the skin.
    known : mapping, optional
        Definitions of the message and its parts, as of `skin.io.messages.definitions.definitions`,
        in a recording of an earlier version; the current ones if not given.

    Raises
    ------
    ValueError
        The definitions have an unknown field.
    """

    def __init__(self, n: int, frame: str = FRAME, known: Definitions | None = None) -> None:
        if known is None:
            known = definitions(STATE_KIND, schema(STATE_KIND))
        message = Cdr()
        stamp = message.header(0, frame)
        places: Places = {"sec": ("<i4", (), stamp), "nanosec": ("<u4", (), stamp + 4)}
        _, *fields, listed = known[STATE_KIND]
        for field in fields:
            kind = NUMBERS[field.kind]
            if field.is_array:
                shape = (ROWS[field.name], n) if field.name in ROWS else (n,)
                places[field.name] = kind, shape, message.array(np.zeros(shape, kind))
            else:
                size = np.dtype(kind).itemsize
                places[field.name] = kind, (), message.align(size)
                message.raw += bytes(size)
        places["count"] = "<u4", (), message.number("I", 0)
        self._contact, last = _contact_record(known)
        self._tail = self._contact.itemsize - last
        self._raw, self._record = message.raw, _at(message, places)
        self._fields = {name: np.frombuffer(self._raw, self._record)[name] for name in places}
        self._padding = bytes(-(len(self._raw) - len(HEAD)) % 8)
        self._write_as(STATE_VERSION if "version" in places else 1)
        self._copied = [name for name in OF_STATE if name in places]
        self._listed = [one for one in QUANTITIES if one.name in (self._contact.names or ())]
        unknown = {*places} - {*OF_STATE, "sec", "nanosec", "version", "cycle", "count"}
        unknown |= {*(self._contact.names or ())} - {one.name for one in self._listed}
        if listed.kind != CONTACT_KIND or unknown:
            raise ValueError(", ".join(sorted(unknown | {listed.name} - {"contacts"})))

    def _write_as(self, version: int) -> None:
        if "version" in self._fields:
            self._fields["version"][0] = version
        self._nan = [
            name for name, since in NAN_SINCE.items() if since <= version and name in self._fields
        ]
        self._unknown = () if version >= BOUNDS_SINCE else BOUNDS

    def write_as(self, message: bytes) -> None:
        """Use the version of this message from now on.

        Raises
        ------
        ValueError
            It is later than the current version.
        """
        size = self._record.itemsize
        if "version" not in self._fields or len(message) < size:
            return
        version = int(np.frombuffer(message[:size], self._record)["version"][0])
        if version > STATE_VERSION:
            raise ValueError(f"version {version}")
        self._write_as(version)

    def __call__(self, record: np.ndarray) -> bytes:
        """The message of the record of a cycle."""
        fields = self._fields
        fields["sec"][0], fields["nanosec"][0] = seconds(int(record["stamp_ns"]))
        fields["cycle"][0] = max(0, int(record["cycle"]))
        for name in self._copied:
            fields[name][0] = record[name]
        wrong = record["status"] & int(INVALID) != 0
        for name in self._nan:
            fields[name][0][..., wrong] = np.nan
        contacts = contacts_of(record)
        fields["count"][0] = contacts.size
        if not contacts.size:
            return bytes(self._raw)
        listed = np.zeros(contacts.size, self._contact)
        for one in self._listed:
            listed[one.name] = one.values(contacts)
        for name in self._unknown:
            if name in (listed.dtype.names or ()):
                listed[name][contacts["flags"] & int(Flag.NO_FRICTION) != 0] = np.nan
        end = -self._tail or None
        return b"".join((self._raw, self._padding, listed.tobytes()[:end]))


class WrenchEncoder:
    """Six numbers to ``geometry_msgs/msg/WrenchStamped`` in the frame of the skin."""

    def __init__(self, frame: str = FRAME) -> None:
        message = Cdr()
        stamp = message.header(0, frame)
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
