"""Frame layouts as data: which bits of which frame carry which channel of which unit.

Bit numbers are those of a DBC file, so that a layout and a DBC message say the same thing:
little-endian (Intel) signals start at their least significant bit, big-endian (Motorola) signals at
their most significant bit in sawtooth numbering.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

__all__ = [
    "CHANNELS",
    "FRAME_FIELDS",
    "LARGEST_SCALE",
    "LAYOUTS",
    "QUANTITIES",
    "SMALLEST_SCALE",
    "UNIT_FIELDS",
    "Factor",
    "LayoutFields",
    "Signal",
    "WireLayout",
]

CHANNELS = ("gel", "frequency", "bx", "by", "bz", "hall_temperature")
"""Rows of every raw array, in order: `raw` is int16, shape (6, n)."""

UNIT_FIELDS = ("unit_status",)
"""Status of a unit; not 0 is a self-reported fault."""

FRAME_FIELDS = ("sequence", "status", "crc")
"""Fields of a frame, for all of its units."""

QUANTITIES = {
    "gel": "µA",
    "frequency": "Hz",
    "bx": "µT",
    "by": "µT",
    "bz": "µT",
    "hall_temperature": "°C",
}
"""Physical unit of each channel, after scale and offset."""


SMALLEST_SCALE, LARGEST_SCALE = 1e-9, 1e9
"""Of scales, without their sign, and of offsets."""

Factor = Annotated[float, Meta(ge=-LARGEST_SCALE, le=LARGEST_SCALE)]
"""Scale and offset of an integer."""


class Signal(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One integer in a frame. Physical value = scale * integer + offset."""

    name: Annotated[
        str, Meta(description="A channel, `unit_status`, `sequence`, `status` or `crc`")
    ]
    start: Annotated[int, Meta(ge=0, le=511, description="Start bit, numbered as in a DBC")]
    length: Annotated[int, Meta(ge=1, le=16, description="Bits")]
    signed: bool = False
    order: Literal["little", "big"] = "little"
    scale: Factor = 1.0
    offset: Factor = 0.0
    slot: Annotated[
        int, Meta(ge=0, le=31, description="Which of the frame's units; 0 for frame fields")
    ] = 0
    part: Annotated[
        int, Meta(ge=0, le=15, description="Which of the consecutive frames carries it")
    ] = 0

    @property
    def bias(self) -> int:
        """Integer on the wire minus count: 16 bits unsigned do not fit in int16."""
        return 0 if self.signed or self.length < 16 else 1 << 15

    @property
    def rails(self) -> tuple[int, int]:
        """Lowest and highest count."""
        low = -(1 << (self.length - 1)) if self.signed else -self.bias
        return low, low + (1 << self.length) - 1


class LayoutFields(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a wire layout has in a file, too."""

    name: Annotated[str, Meta(description="Name of the layout")]
    units: Annotated[int, Meta(ge=1, le=32, description="Units that one frame carries")] = 1
    parts: Annotated[int, Meta(ge=1, le=16, description="Frames that make one set of units")] = 1
    pages: Annotated[
        tuple[Annotated[int, Meta(ge=0, le=255)], ...],
        Meta(description="First byte of each part, where all parts have one identifier"),
    ] = ()
    counts_only: Annotated[
        bool,
        Meta(description="Sensors of another kind: nothing is known of them but their counts"),
    ] = False
    sequence: Annotated[
        Literal["sync", "own"],
        Meta(
            description="Whether the sequence number echoes the counter of SYNC, or counts the "
            "sender's own frames; without SYNC it always does"
        ),
    ] = "sync"
    signals: Annotated[
        tuple[Signal, ...], Meta(description="Bits of each channel and field of a frame")
    ] = ()


class WireLayout(LayoutFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One data frame, or the `parts` frames of one set of units, and the signals in it.

    Parts have consecutive ids, or, where there are `pages`, one id and another first byte each.
    The crc, where there is one, is CRC-16/CCITT-FALSE over the CAN id (two bytes, low first) and
    then every byte of the frame that is not the crc itself.
    """

    size: Annotated[int, Meta(ge=1, le=64, description="Bytes of each frame")]
    fd: Annotated[bool, Meta(description="CAN FD frames")] = False

    @property
    def ids(self) -> int:
        """Number of identifiers of one set of units."""
        return 1 if self.pages else self.parts

    def frame_field(self, name: str, part: int = 0) -> Signal | None:
        """The signal `name` ("sequence", "status", "crc") of frame `part`, or None."""
        found = (s for s in self.signals if s.name == name and s.part == part)
        return next(found, None)

    def carries(self, name: str) -> bool:
        """Whether any frame of this layout carries the channel or field `name`."""
        return any(s.name == name for s in self.signals)


def _record(slot: int, byte: int) -> tuple[Signal, ...]:
    """The 12-byte unit record of the FD layouts, at `byte` of the frame."""
    bit = 8 * byte
    field = {"length": 16, "signed": True, "slot": slot}
    return (
        Signal(name="gel", start=bit, scale=0.007, **field),
        Signal(name="frequency", start=bit + 16, scale=0.25, **field),
        Signal(name="bx", start=bit + 32, scale=2.0, **field),
        Signal(name="by", start=bit + 48, scale=2.0, **field),
        Signal(name="bz", start=bit + 64, scale=2.0, **field),
        Signal(
            name="hall_temperature",
            start=bit + 80,
            length=8,
            signed=True,
            scale=0.5,
            offset=25.0,
            slot=slot,
        ),
        Signal(name="unit_status", start=bit + 88, length=8, slot=slot),
    )


_HEADER = (
    Signal(name="sequence", start=0, length=8),
    Signal(name="status", start=8, length=8),
    Signal(name="crc", start=16, length=16),
)


def _triangle() -> tuple[Signal, ...]:
    """The twelve taxels of an iCub triangle: seven in the head, five and their errors in the tail.

    A taxel out of its range has a bit in a 12-bit mask, whose upper byte comes first; four flags
    of the whole triangle follow (no acknowledge, not connected).
    """
    signals = [Signal(name="status", start=56, length=4, part=1)]
    for k in range(12):
        byte, part = (1 + k, 0) if k < 7 else (k - 6, 1)
        mask = 60 + k if k < 4 else 44 + k
        signals += [
            Signal(name="frequency", start=8 * byte, length=8, slot=k, part=part),
            Signal(name="unit_status", start=mask, length=1, slot=k, part=1),
        ]
    return tuple(signals)


LAYOUTS: dict[str, WireLayout] = {
    layout.name: layout
    for layout in (
        WireLayout(
            name="f3t-classic",
            size=8,
            signals=(
                Signal(name="gel", start=0, length=12, scale=0.055),
                Signal(name="frequency", start=12, length=14, scale=0.5),
                Signal(name="bx", start=26, length=11, signed=True, scale=64.0),
                Signal(name="by", start=37, length=11, signed=True, scale=64.0),
                Signal(name="bz", start=48, length=11, signed=True, scale=64.0),
                Signal(name="sequence", start=59, length=4),
                Signal(name="unit_status", start=63, length=1),
            ),
        ),
        WireLayout(name="f3t-fd16", size=16, fd=True, signals=(*_HEADER, *_record(0, 4))),
        WireLayout(
            name="f3t-fd64",
            size=64,
            fd=True,
            units=5,
            signals=_HEADER + tuple(s for i in range(5) for s in _record(i, 4 + 12 * i)),
        ),
        # XELA uSkin: a frame for each taxel, three axes from its second byte on, no sequence. What
        # is known of it are drivers that never look at the length: a board that sends eight bytes
        # needs a layout of one's own with `size = 8`.
        WireLayout(
            name="xela-uskin",
            size=7,
            counts_only=True,
            signals=tuple(
                Signal(name=name, start=8 * byte + 7, length=16, order="big")
                for name, byte in (("bx", 1), ("by", 3), ("bz", 5))
            ),
        ),
        # iCub skin: two frames a triangle; a capacitance falls when pressed, as our frequency does.
        WireLayout(
            name="icub-skin",
            size=8,
            units=12,
            parts=2,
            pages=(0x40, 0xC0),
            counts_only=True,
            signals=_triangle(),
        ),
    )
}
"""Built-in layouts by name: the project's own, and two foreign ones that give counts only."""
