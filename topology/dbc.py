"""Wire layouts from a message of a DBC file: its signals that exist, and that fit a count.

cantools reads the file; this is the only file of the project that imports it.
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

from topology.errors import Report
from topology.files import missing
from topology.read import read_text, show
from topology.schema import Layout
from topology.source import Key, Source
from topology.wire import CHANNELS, FRAME_FIELDS, QUANTITIES, UNIT_FIELDS, Signal, WireLayout

__all__ = ["conversion", "from_dbc", "read_dbc"]

LARGEST_MB = 8
"""Larger files are refused before they are parsed; those of whole cars are a few MB."""
LONGEST_REASON = 200
"""Characters of a message of cantools, which quotes a line of any length."""
LARGEST_BITS = 16
"""Of a signal: counts are int16."""

_UNITS = {
    "µA": {"A": 1e6, "mA": 1e3, "uA": 1.0, "nA": 1e-3},
    "Hz": {"MHz": 1e6, "kHz": 1e3, "Hz": 1.0, "1/s": 1.0},
    "µT": {"T": 1e6, "mT": 1e3, "uT": 1.0, "nT": 1e-3, "G": 100.0, "mG": 0.1, "gauss": 100.0},
    "°C": {"C": 1.0, "K": 1.0, "F": 5 / 9},
}
"""Factor of each unit of a file, to our own."""
_ZEROS = {"K": -273.15, "F": -160 / 9}
"""What is added besides."""


def conversion(unit: str, own: str) -> tuple[float, float] | None:
    """Factor and offset from a unit of a DBC file to one of `topology.wire.QUANTITIES`.

    An empty text is our own unit. None for an unknown one, and for one of another quantity.

    Examples
    --------
    >>> conversion("mT", "µT"), conversion("deg C", "°C"), conversion("MHz", "µT")
    ((1000.0, 0.0), (1.0, 0.0), None)
    """
    text = re.sub(r"[µμ]", "u", unit.replace(" ", ""))
    if not text:
        return 1.0, 0.0
    if own == "°C":
        text = re.sub("^(°|deg_?)", "", text)
    factor = _UNITS[own].get(text)
    return None if factor is None else (factor, _ZEROS.get(text, 0.0))


def read_dbc(path: Path, shown: str, report: Report) -> list[Any] | None:
    """Messages of a DBC file, as cantools has them; None where it cannot be read, and reported.

    Parameters
    ----------
    path : Path
        An existing file.
    shown : str
        Its name in messages.
    report : Report
        Collects the faults.
    """
    raw = read_text(path, shown, report, LARGEST_MB)
    if raw is None:
        return None
    try:
        database: Any = import_module("cantools.database")
    except ImportError as error:
        expected = "read by the library of the extra 'dbc' (pip install 'f3t-skin[dbc]')"
        report.about_file(shown, expected, error)
        return None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:  # the format names no encoding
        text = raw.decode("latin-1")
    try:
        found = database.load_string(text, database_format="dbc", strict=False, sort_signals=None)
    except Exception as error:  # a damaged file may raise anything
        reason = " ".join(str(error).removeprefix("DBC: ").split()) or type(error).__name__
        line = re.search(r"at line (\d+)", reason)
        reason = reason if len(reason) <= LONGEST_REASON else f"{reason[:LONGEST_REASON]}..."
        report.about_file(shown, "a DBC file", reason, line=int(line[1]) if line else 0)
        return None
    return list(found.messages)


def from_dbc(
    layout: Layout, key: Key, source: Source, files: dict[Path, list[Any] | None]
) -> tuple[WireLayout, list[Key]] | None:
    """Make a wire layout of a DBC's message.

    Parameters
    ----------
    layout : Layout
        Its table, with a `dbc`.
    key : Key
        Its place in `source`.
    source : Source
    files : dict of Path to list of messages
        DBC files read for other layouts; this one's is added.

    Returns
    -------
    (WireLayout, list of Key) or None
        The layout, and the place of each of its signals; None where one of them is wrong.
    """
    before = len(source.report.issues)
    for name in ("size", "parts", "pages", "signals"):
        if name in source.data["layouts"][key[1]]:
            source.fault((*key, name), "absent, as the DBC says it", "one")
    if layout.message is None:
        source.lacks(key, "message", "the name of a message in the DBC file")
        return None
    path, shown = source.named_file(str(layout.dbc))
    if missing(path):
        source.fault((*key, "dbc"), "an existing file", f"none at {shown}")
        return None
    if path not in files:
        files[path] = read_dbc(path, shown, source.report)
    messages, at = files[path], (*key, "message")
    if messages is None:
        return None
    names = [message.name for message in messages]
    if not source.refer(layout.message, f"a message of {shown}", names, at):
        return None
    message = messages[names.index(layout.message)]
    if names.count(message.name) > 1:
        source.fault(at, f"a name used once in {shown}", repr(message.name))
    signals: list[Signal] = []
    places: list[Key] = []
    for name, given in layout.dbc_signals.items():
        for slot, (signal, place) in enumerate(_names(name, given, layout, key, source)):
            if found := _signal(name, signal, slot, message, shown, layout, place, source):
                signals.append(found)
                places.append(place)
    if len(source.report.issues) > before:
        return None
    is_fd = bool(message.is_fd) or message.length > 8
    fd = is_fd if layout.fd is None else layout.fd
    wire = layout.wire(size=message.length, fd=fd, signals=tuple(signals))
    return wire, places


def _names(
    name: str, given: str | tuple[str, ...], layout: Layout, key: Key, source: Source
) -> list[tuple[str, Key]]:
    """The signal of a channel or field in each slot, and its place in the file; none if wrong."""
    at = (*key, "dbc_signals", name)
    if not source.refer(name, "a channel or field", (*CHANNELS, *UNIT_FIELDS, *FRAME_FIELDS), at):
        return []
    if name in FRAME_FIELDS:
        if isinstance(given, str):
            return [(given, at)]
        expected = "the name of one signal"
    elif isinstance(given, tuple):
        if len(given) == layout.units:
            return [(signal, (*at, slot)) for slot, signal in enumerate(given)]
        expected = f"a list of {layout.units} names, one for each unit"
    else:
        slots = range(layout.units)
        named = [given.replace("{slot}", f"{k}").replace("{slot+1}", f"{k + 1}") for k in slots]
        if len(set(named)) == len(named):
            return [(signal, at) for signal in named]
        expected = f"a name with {{slot}} or {{slot+1}} in it, or a list of {layout.units}"
    source.fault(at, expected, show(given))
    return []


def _signal(
    name: str, of_dbc: str, slot: int, message: Any, shown: str, layout: Layout, at: Key,
    source: Source,
) -> Signal | None:  # fmt: skip
    """A signal of the message as one of a layout; None where it cannot be one, and reported."""
    names = [signal.name for signal in message.signals]
    if not source.refer(of_dbc, f"a signal of {message.name} ({shown})", names, at):
        return None
    found, unfit = message.signals[names.index(of_dbc)], ""
    if names.count(of_dbc) > 1:
        unfit = "one of several of that name"
    elif found.is_float:
        unfit = f"a float of {found.length} bits"
    elif found.multiplexer_ids:
        unfit = "a multiplexed one"
    elif not 1 <= found.length <= LARGEST_BITS:
        unfit = f"{found.length} bits"
    got = f"signal {of_dbc!r} of message {message.name!r} in {shown}"
    if unfit:
        expected = f"an integer of at most {LARGEST_BITS} bits that is in every frame"
        source.fault(at, expected, f"{got}, {unfit}")
        return None
    unit = (1.0, 0.0)
    if name in CHANNELS and not layout.counts_only:
        unit = conversion(found.unit or "", QUANTITIES[name])
        if unit is None:
            expected = f"in {QUANTITIES[name]}, or in a unit that is converted to it"
            source.fault(at, expected, f"{got}, in {found.unit!r}")
            return None
    return Signal(
        name=name,
        start=found.start,
        length=found.length,
        signed=found.is_signed,
        order="little" if found.byte_order == "little_endian" else "big",
        scale=unit[0] * found.scale,
        offset=unit[0] * found.offset + unit[1],
        slot=slot,
    )
