"""Wire layouts from a message of a DBC file: signals that exist, and that fit a count."""

from __future__ import annotations

from pathlib import Path

from topology.check.names import refer
from topology.dbc import DbcMessage, DbcSignal, conversion, read_dbc
from topology.errors import nearest
from topology.files import missing
from topology.read import show
from topology.report import Report
from topology.schema import Layout
from topology.source import Key, Source
from topology.wire import CHANNELS, FRAME_FIELDS, QUANTITIES, UNIT_FIELDS, Signal, WireLayout

__all__ = ["DbcFiles", "from_dbc"]

LARGEST_BITS = 16
"""Of a signal: counts are int16."""


DbcFiles = dict[Path, dict[str, DbcMessage] | None]
"""Messages of the DBC files read so far, None for invalid files."""


def from_dbc(
    layout: Layout, key: Key, source: Source, report: Report, files: DbcFiles
) -> tuple[WireLayout, list[Key]] | None:
    """Make a wire layout of a DBC's message.

    Parameters
    ----------
    layout : Layout
        Its table, with a `dbc`.
    key : Key
        Its place in `source`.
    report : Report
        Collects the errors.
    files : DbcFiles
        Files read for other layouts; this one's is added.

    Returns
    -------
    (WireLayout, list of Key) or None
        The layout and the places of its signals in the file. None without a message; a layout
        without its invalid signals must not be used.
    """
    for name in ("size", "parts", "pages"):
        if name in source.data["layouts"][key[1]]:
            report.add("dbc-says", source, (*key, name))
    if layout.message is None and report.sound(source, key, "message"):
        report.add("missing-key", source, key, part="message", name="message",
                   expected="the name of a message in the DBC file")  # fmt: skip
    names = layout.signals
    if not isinstance(names, dict) and report.sound(source, key, "signals"):
        report.add("value", source, (*key, "signals"),
                   expected="a table of channels and the DBC's signals",
                   got=show(list(names)))  # fmt: skip
    assert layout.dbc is not None
    path = source.path.parent / layout.dbc
    shown = str(Path(source.shown).parent / layout.dbc)
    if missing(path):
        report.add("no-file", source, (*key, "dbc"), path=shown)
        return None
    if path not in files:
        files[path] = read_dbc(path, shown, report)
    messages = files[path]
    if messages is None or layout.message is None or not isinstance(names, dict):
        return None
    if not refer(layout.message, f"a message of {shown}", [*filter(None, messages)],
                 (*key, "message"), source, report):  # fmt: skip
        return None
    message = messages[layout.message]
    if (fault := message.faults.get("")) is not None:
        report.enter(fault)
        return None
    finder = _Finder(message, layout, shown, source, report)
    for name, given in names.items():
        finder.take(name, given, (*key, "signals", name))
    wire = WireLayout(
        name=layout.name,
        size=message.size,
        fd=layout.fd if layout.fd is not None else message.fd or message.size > 8,
        units=layout.units,
        counts_only=layout.counts_only,
        sequence=layout.sequence,
        signals=tuple(finder.signals),
    )
    return wire, finder.places


class _Finder:
    """Finds the signals of a layout in a message.

    Attributes
    ----------
    signals : list of Signal
    places : list of Key
        Their places in the topology file.
    """

    def __init__(
        self, message: DbcMessage, layout: Layout, shown: str, source: Source, report: Report
    ) -> None:
        self.message = message
        self.units = layout.units
        self.counts_only = layout.counts_only
        self.shown = shown
        self.source = source
        self.report = report
        self.signals: list[Signal] = []
        self.places: list[Key] = []

    def take(self, name: str, given: str | tuple[str, ...] | None, at: Key) -> None:
        """Add the signals of a channel or field, one for each slot."""
        if name in FRAME_FIELDS:
            if isinstance(given, tuple):
                self._refuse(at, "the name of one signal", given)
            elif given is not None:
                self._enter(name, given, 0, at)
            return
        fields = (*CHANNELS, *UNIT_FIELDS, *FRAME_FIELDS)
        if not refer(name, "a channel or field", fields, at, self.source, self.report):
            return
        if isinstance(given, tuple):
            if len(given) != self.units:
                self._refuse(at, f"a list of {self.units} names, one for each unit", given)
                return
            for slot, signal in enumerate(given):
                self._enter(name, signal, slot, (*at, slot))
        elif given is not None:
            named = [_in_slot(given, slot) for slot in range(self.units)]
            if self.units > 1 and len(set(named)) == 1:
                expected = f"a name with {{slot}} or {{slot+1}} in it, or a list of {self.units}"
                self._refuse(at, expected, given)
                return
            for slot, signal in enumerate(named):
                self._enter(name, signal, slot, at)

    def _refuse(self, at: Key, expected: str, given: str | tuple[str, ...]) -> None:
        got = show(list(given) if isinstance(given, tuple) else given)
        self.report.add("value", self.source, at, expected=expected, got=got)

    def _enter(self, name: str, signal: str, slot: int, at: Key) -> None:
        if (fault := self.message.faults.get(signal)) is not None:
            self.report.enter(fault)
            self.report.spoil(self.source, at)
            return
        found = self.message.signals.get(signal)
        if found is None:
            kind = f"a signal of {self.message.name} ({self.shown}:{self.message.line})"
            hint = nearest(signal, self.message.signals)
            self.report.add("unknown-name", self.source, at, hint, kind=kind, name=repr(signal))
            return
        unfit = _unfit(found)
        if unfit:
            self.report.add("dbc-signal", self.source, at, bits=LARGEST_BITS, name=repr(signal),
                            got=unfit, file=self.shown, line=found.line)  # fmt: skip
            return
        factor, shift = 1.0, 0.0
        if name in CHANNELS and not self.counts_only:
            known = conversion(found.unit, QUANTITIES[name])
            if known is None:
                self.report.add("dbc-unit", self.source, at, own=QUANTITIES[name],
                                name=repr(signal), got=repr(found.unit), file=self.shown,
                                line=found.line)  # fmt: skip
                return
            factor, shift = known
        self.places.append(at)
        self.signals.append(
            Signal(
                name=name,
                start=found.start,
                length=found.length,
                signed=found.signed,
                order=found.order,
                scale=factor * found.scale,
                offset=factor * found.offset + shift,
                slot=slot,
            )
        )


def _in_slot(pattern: str, slot: int) -> str:
    """A signal's name in one slot.

    Examples
    --------
    >>> _in_slot("X_{slot+1}", 0), _in_slot("X_{slot}", 0)
    ('X_1', 'X_0')
    """
    return pattern.replace("{slot}", str(slot)).replace("{slot+1}", str(slot + 1))


def _unfit(signal: DbcSignal) -> str:
    """Why a signal cannot be a count; empty if it can."""
    if signal.is_float:
        return f"a float of {signal.length} bits"
    if signal.multiplexed:
        return "a multiplexed one"
    if not 1 <= signal.length <= LARGEST_BITS:
        return f"{signal.length} bits"
    return ""
