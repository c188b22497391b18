"""Wire layouts: signals within their frame, and all channels of a unit."""

from __future__ import annotations

from topology.check.models import check_scale
from topology.dbc import from_dbc
from topology.schema import File, Layout
from topology.source import Key, Source
from topology.wire import (
    CHANNELS,
    FRAME_FIELDS,
    LARGEST_SCALE,
    LAYOUTS,
    UNIT_FIELDS,
    Signal,
    WireLayout,
)

__all__ = ["CLASSIC_SIZES", "FD_SIZES", "NEEDED", "resolve_layouts", "signal_bits"]

CLASSIC_SIZES = tuple(range(1, 9))
FD_SIZES = (*CLASSIC_SIZES, 12, 16, 20, 24, 32, 48, 64)

NEEDED = ("gel", "frequency", "bx", "by")
"""Channels without which a unit cannot be decoded."""


def resolve_layouts(file: File, source: Source) -> dict[str, WireLayout]:
    """Layouts by name."""
    layouts, files = dict(LAYOUTS), {}
    source.unique("layouts", [layout.name for layout in file.layouts], LAYOUTS)
    for index, layout in enumerate(file.layouts):
        key = ("layouts", index)
        if layout.dbc is None:
            made = _as_written(layout, key, source)
        else:
            made = from_dbc(layout, key, source, files)
        if made is not None:
            _check_layout(*made, key, source)
            layouts.setdefault(layout.name, made[0])
    return layouts


def _as_written(layout: Layout, key: Key, source: Source) -> tuple[WireLayout, list[Key]] | None:
    """A layout whose bits stand in the file, and where each of its signals does."""
    if layout.message is not None or layout.dbc_signals:
        source.lacks(key, "dbc", "the DBC file of the message")
        return None
    if layout.size is None:
        source.lacks(key, "size", "an integer from 1 to 64")
        return None
    wire = layout.wire(fd=bool(layout.fd))
    return wire, [(*key, "signals", i) for i in range(len(layout.signals))]


def signal_bits(signal: Signal) -> list[int]:
    """Bits of a signal in the frame, bit 8 b + i being bit i of byte b; least significant first.

    Examples
    --------
    >>> signal_bits(Signal(name="gel", start=6, length=4))
    [6, 7, 8, 9]
    >>> signal_bits(Signal(name="gel", start=1, length=4, order="big"))
    [14, 15, 0, 1]
    """
    if signal.order == "little":
        return list(range(signal.start, signal.start + signal.length))
    bits = [signal.start]
    while len(bits) < signal.length:
        bits.append(bits[-1] - 1 if bits[-1] % 8 else bits[-1] + 15)
    return bits[::-1]


def _check_layout(layout: WireLayout, places: list[Key], key: Key, source: Source) -> None:
    kind, sizes = ("CAN FD", FD_SIZES) if layout.fd else ("classic", CLASSIC_SIZES)
    if layout.size not in sizes:
        lengths = f"a length of {kind} frames ({', '.join(map(str, sizes))})"
        source.fault((*key, "size"), lengths, layout.size)
    owner: dict[tuple[int, int], Key] = {}
    if layout.pages:
        owner = {(part, bit): (*key, "pages") for part in range(layout.parts) for bit in range(8)}
        if not len({*layout.pages}) == len(layout.pages) == layout.parts:
            expected = f"{layout.parts} different bytes, one for each part"
            source.fault((*key, "pages"), expected, list(layout.pages))
    first: dict[tuple[str, int, int], Key] = {}
    for signal, at in zip(layout.signals, places, strict=True):
        _check_signal(signal, layout, at, source)
        _check_bits(signal, layout, at, owner, source)
        place = (signal.name, signal.slot, signal.part if signal.name in FRAME_FIELDS else 0)
        if first.setdefault(place, at) != at:
            got = f"a second one (first at line {source.line(first[place])})"
            source.fault(at, "there once in a frame and slot", got)
    if layout.sequence == "own" and not layout.carries("sequence"):
        source.fault((*key, "sequence"), "absent where no signal is the sequence", "'own'")
    for slot in range(layout.units):
        if not layout.counts_only:
            lacking = ", ".join(repr(name) for name in NEEDED if (name, slot, 0) not in first)
        else:
            lacking = "" if any((name, slot, 0) in first for name in CHANNELS) else "at all"
        if lacking:
            given = "dbc_signals" if "dbc" in source.data["layouts"][key[1]] else "signals"
            got = f"no channel {lacking} in slot {slot}"
            source.fault((*key, given), "the channels of every unit", got)


def _check_signal(signal: Signal, layout: WireLayout, at: Key, source: Source) -> None:
    fields = (*CHANNELS, *UNIT_FIELDS, *FRAME_FIELDS)
    source.refer(signal.name, "a channel or field", fields, (*at, "name"))
    if signal.slot >= layout.units:
        source.fault((*at, "slot"), f"below {layout.units}, the layout's units", signal.slot)
    if signal.part >= layout.parts:
        source.fault((*at, "part"), f"below {layout.parts}, the layout's parts", signal.part)
    if signal.name in FRAME_FIELDS and signal.slot:
        source.fault((*at, "slot"), "0 for what a frame carries once", signal.slot)
    if signal.name in CHANNELS:
        check_scale(signal.scale, (*at, "scale"), source)
        if abs(signal.offset) > LARGEST_SCALE:  # as a DBC may have it
            source.fault((*at, "offset"), f"at most {LARGEST_SCALE:g}", f"{signal.offset:g}")
    whole = {"little": 0, "big": 7}[signal.order]
    if signal.name == "crc" and (signal.length != 16 or signal.start % 8 != whole):
        got = f"{signal.length} bits at bit {signal.start}"
        source.fault(at, "16 bits on two whole bytes side by side", got)


def _check_bits(
    signal: Signal,
    layout: WireLayout,
    at: Key,
    owner: dict[tuple[int, int], Key],
    source: Source,
) -> None:
    bits = signal_bits(signal)
    if max(bits) >= 8 * layout.size:
        got = f"bits {min(bits)} to {max(bits)}"
        source.fault(at, f"within the {8 * layout.size} bits of the frame", got)
    for bit in sorted(bits):
        other = owner.setdefault((signal.part, bit), at)
        if other != at:
            got = f"bit {bit}, also of {source.where(other[2:])} (line {source.line(other)})"
            source.fault(at, "of bits of its own", got)
            return
