"""Wire layouts: signals within their frame, and all channels of a unit."""

from __future__ import annotations

from collections import defaultdict

from topology.check.dbc import DbcFiles, from_dbc
from topology.check.names import check_name, entries, refer
from topology.read import show
from topology.report import Report
from topology.schema import File, Layout
from topology.source import Key, Source
from topology.wire import (
    CHANNELS,
    FRAME_FIELDS,
    LARGEST_SCALE,
    LAYOUTS,
    SMALLEST_SCALE,
    UNIT_FIELDS,
    Signal,
    WireLayout,
)

__all__ = ["CLASSIC_SIZES", "FD_SIZES", "NEEDED", "resolve_layouts", "signal_bits"]

CLASSIC_SIZES = tuple(range(1, 9))
FD_SIZES = (*CLASSIC_SIZES, 12, 16, 20, 24, 32, 48, 64)

NEEDED = ("gel", "frequency", "bx", "by")
"""Channels without which a unit cannot be decoded."""


def resolve_layouts(file: File, source: Source, report: Report) -> dict[str, WireLayout | None]:
    """Layouts by name; None where one is wrong."""
    first: dict[str, Key] = {}
    layouts: dict[str, WireLayout | None] = dict(LAYOUTS)
    files: DbcFiles = {}
    for key, layout in entries(file, "layouts"):
        if report.sound(source, key, "name"):
            check_name(layout.name, key, first, LAYOUTS, source, report)
        sound = report.sound(source, key)
        wire = None
        if report.sound(source, key, "size", "fd", "units", "parts", "pages", "dbc"):
            if layout.dbc is None:
                made = _as_written(layout, key, source, report)
            else:
                made = from_dbc(layout, key, source, report, files)
            if made is not None:
                wire, places = made
                _check_layout(wire, places, key, source, report)
        if layout.name is not None and first.get(layout.name) == key:
            layouts[layout.name] = wire if sound and report.sound(source, key) else None
    for messages in files.values():
        faults = [f for message in (messages or {}).values() for f in message.faults.values()]
        if faults:
            more = f", nor are {len(faults) - 1} more lines like it" if len(faults) > 1 else ""
            report.notes.append(f"{faults[0]}; it is not read, as no layout uses it{more}")
    return layouts


def _as_written(
    layout: Layout, key: Key, source: Source, report: Report
) -> tuple[WireLayout, list[Key]] | None:
    """A layout whose bits stand in the file, and where each of its signals does."""
    if layout.message is not None:
        report.add("missing-key", source, key, part="dbc", name="dbc",
                   expected="the DBC file of the message")  # fmt: skip
        return None
    if isinstance(layout.signals, dict):
        report.add("value", source, (*key, "signals"), expected="a list of tables, without a dbc",
                   got=show(layout.signals))  # fmt: skip
        return None
    if layout.size is None:
        report.add("missing-key", source, key, part="size", name="size",
                   expected="an integer from 1 to 64")  # fmt: skip
        return None
    given = [(i, signal) for i, signal in enumerate(layout.signals) if signal is not None]
    wire = WireLayout(
        name=layout.name,
        size=layout.size,
        fd=bool(layout.fd),
        units=layout.units,
        parts=layout.parts,
        pages=layout.pages,
        counts_only=layout.counts_only,
        sequence=layout.sequence,
        signals=tuple(signal for _, signal in given),
    )
    return wire, [(*key, "signals", i) for i, _ in given]


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


def _check_layout(
    layout: WireLayout, places: list[Key], key: Key, source: Source, report: Report
) -> None:
    sizes = FD_SIZES if layout.fd else CLASSIC_SIZES
    if layout.size not in sizes:
        report.add("frame-size", source, (*key, "size"), kind="CAN FD" if layout.fd else "classic",
                   sizes=", ".join(map(str, sizes)), got=layout.size)  # fmt: skip
    if not layout.signals and not report.sound(source, key, "signals"):
        return
    complete = report.sound(source, key, "signals")
    owner: dict[tuple[int, int], Key] = {}
    if layout.pages:
        owner = {(part, bit): (*key, "pages") for part in range(layout.parts) for bit in range(8)}
        if len(set(layout.pages)) != len(layout.pages) or len(layout.pages) != layout.parts:
            report.add("pages", source, (*key, "pages"), parts=layout.parts, got=list(layout.pages))
    first: dict[tuple[str, int, int], Key] = {}
    for signal, at in zip(layout.signals, places, strict=True):
        if not report.sound(source, at):
            continue
        _check_signal(signal, layout, at, source, report)
        _check_bits(signal, layout, at, owner, source, report)
        place = (signal.name, signal.slot, signal.part if signal.name in FRAME_FIELDS else 0)
        if first.setdefault(place, at) != at:
            report.add("signal-twice", source, at, line=source.line(first[place]))
    lacking: dict[int, list[str]] = defaultdict(list)
    for slot in range(layout.units if complete else 0):
        if layout.counts_only:
            if not any((name, slot, 0) in first for name in CHANNELS):
                lacking[slot].append("a channel")
            continue
        for name in NEEDED:
            if (name, slot, 0) not in first:
                lacking[slot].append(name)
    if complete and layout.sequence == "own" and not layout.carries("sequence"):
        report.add("sequence-missing", source, (*key, "sequence"))
    for slot, names in lacking.items():
        report.add(
            "signal-missing", source, (*key, "signals"), names=" and ".join(names), slot=slot
        )


def _check_signal(
    signal: Signal, layout: WireLayout, at: Key, source: Source, report: Report
) -> None:
    fields = (*CHANNELS, *UNIT_FIELDS, *FRAME_FIELDS)
    refer(signal.name, "a channel or field", fields, (*at, "name"), source, report)
    for what, got, limit in (("slot", signal.slot, "units"), ("part", signal.part, "parts")):
        if got >= getattr(layout, limit):
            report.add("signal-slot", source, (*at, what),
                       limit=getattr(layout, limit), what=limit, got=got)  # fmt: skip
    if signal.name in FRAME_FIELDS and signal.slot:
        report.add("signal-field", source, (*at, "slot"), got=signal.slot)
    if signal.name in CHANNELS and not (
        SMALLEST_SCALE <= abs(signal.scale) <= LARGEST_SCALE >= abs(signal.offset)
    ):
        report.add("scale", source, (*at, "scale"), least=SMALLEST_SCALE, most=LARGEST_SCALE,
                   got=signal.scale)  # fmt: skip
    whole = {"little": 0, "big": 7}[signal.order]
    if signal.name == "crc" and (signal.length != 16 or signal.start % 8 != whole):
        report.add("crc", source, at, length=signal.length, start=signal.start)


def _check_bits(
    signal: Signal,
    layout: WireLayout,
    at: Key,
    owner: dict[tuple[int, int], Key],
    source: Source,
    report: Report,
) -> None:
    bits = signal_bits(signal)
    if max(bits) >= 8 * layout.size:
        report.add("signal-bits", source, at,
                   bits=8 * layout.size, first=min(bits), last=max(bits))  # fmt: skip
    for bit in sorted(bits):
        other = owner.setdefault((signal.part, bit), at)
        if other != at:
            report.add("signal-overlap", source, at, bit=bit,
                       other=source.where(other[2:]), line=source.line(other))  # fmt: skip
            return
