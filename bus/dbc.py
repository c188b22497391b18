"""DBC files: the messages of a bus, for other CAN tools.

One file a bus, since identifiers are unique per bus only. Names are C identifiers of at most 32
characters, and those of signals are unique in a file: the unit's, and the channel's. The text is
plain ASCII, in the subset that common tools read.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bus.frame import CAN_EFF
from bus.heartbeat import FIELDS, FIRST_ID, LAYOUT, PERIOD_S, STATES, heartbeat_nodes
from topology import CHANNELS, Signal, Topology, WireLayout
from topology.files import check_over, marked, whole_file
from topology.wire import FRAME_FIELDS, QUANTITIES

__all__ = ["DbcFile", "dbc_text", "write_dbc"]

LONGEST = 32
HOST = "host"

_FRAME_FORMATS = (
    "StandardCAN", "ExtendedCAN", "reserved", "J1939PG", *10 * ("reserved",),
    "StandardCAN_FD", "ExtendedCAN_FD",
)  # fmt: skip
_SEND_TYPES = ("Cyclic", "Triggered")
_CRC = (
    "A crc is CRC-16/CCITT-FALSE over the identifier (two bytes, low first) and then every byte of "
    "the frame but its own"
)


@dataclass(frozen=True)
class DbcFile:
    """A written file.

    Attributes
    ----------
    path : Path
    bus : str
    messages, signals : int
    """

    path: Path
    bus: str
    messages: int
    signals: int


@dataclass(frozen=True)
class _Signal:
    name: str
    start: int
    length: int
    order: str = "little"
    signed: bool = False
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""
    values: dict[int, str] = field(default_factory=dict)
    page: str = ""

    def line(self, receivers: str) -> str:
        order = {"little": "1", "big": "0"}[self.order]
        sign = "-" if self.signed else "+"
        low = -(1 << (self.length - 1)) if self.signed else 0
        ends = (low, low + (1 << self.length) - 1)
        low, high = sorted(self.scale * end + self.offset for end in ends)
        page = f" {self.page}" if self.page else ""
        return (
            f" SG_ {self.name}{page} : {self.start}|{self.length}@{order}{sign} "
            f"({_number(self.scale)},{_number(self.offset)}) [{_number(low)}|{_number(high)}] "
            f'"{self.unit}" {receivers}'
        )


@dataclass(frozen=True)
class _Message:
    name: str
    can_id: int
    size: int
    fd: bool
    sender: str
    receivers: str
    comment: str
    cycle_ms: int
    """0: not periodic, or more often than each millisecond."""
    signals: list[_Signal]


def write_dbc(topology: Topology, folder: str | os.PathLike[str] = ".") -> list[DbcFile]:
    """Write one DBC file for each bus, named after the skin and the bus: "palm-main.dbc".

    Each file is written under a temporary name and renamed, so that none is ever incomplete.

    Parameters
    ----------
    topology : Topology
    folder : str or path
        Destination; made if it does not exist.

    Returns
    -------
    list of DbcFile
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    places = []
    for bus in topology.buses:
        mark = f'CM_ "Bus {bus.name} of {topology.name}.'
        own = marked("the DBC file of this bus", mark.encode("ascii"))
        places.append((folder / f"{topology.name}-{bus.name}.dbc", own))
        check_over(*places[-1])
    written = []
    for index, bus in enumerate(topology.buses):
        messages = _messages(topology, index)
        path, own = places[index]
        with whole_file(path, "w", over=own, encoding="ascii", newline="\n") as file:
            file.write(_text(topology, index, messages))
        signals = sum(len(message.signals) for message in messages)
        written.append(DbcFile(path, bus.name, len(messages), signals))
    return written


def dbc_text(topology: Topology, bus: int = 0) -> str:
    """The DBC file of one bus.

    Parameters
    ----------
    topology : Topology
    bus : int
        Index of the bus.

    Examples
    --------
    >>> from topology import load
    >>> [line for line in dbc_text(load("palm")).splitlines() if line.startswith("BO_ 256 ")]
    ['BO_ 256 palm_board_1: 64 board_1']
    """
    return _text(topology, bus, _messages(topology, bus))


def _text(topology: Topology, index: int, messages: list[_Message]) -> str:
    bus = topology.buses[index]
    nodes = [HOST, *(f"board_{k + 1}" for k in range(len(_boards(topology, index))))]
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", ""]
    lines += ["BU_: " + " ".join(nodes), ""]
    for message in messages:
        lines.append(f"BO_ {message.can_id} {message.name}: {message.size} {message.sender}")
        lines += [signal.line(message.receivers) for signal in message.signals]
        lines.append("")
    lines.append(f'CM_ "Bus {bus.name} of {topology.name}. {_CRC}";')
    lines += [f'CM_ BO_ {m.can_id} "{m.comment}";' for m in messages]
    lines += [
        'BA_DEF_ "DBName" STRING ;',
        'BA_DEF_ "BusType" STRING ;',
        'BA_DEF_ "Baudrate" INT 0 100000000;',
        'BA_DEF_ "BaudrateCANFD" INT 0 100000000;',
        f'BA_DEF_ BO_ "VFrameFormat" ENUM {_enum(_FRAME_FORMATS)};',
        'BA_DEF_ BO_ "CANFD_BRS" ENUM "0","1";',
        'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 3600000;',
        f'BA_DEF_ BO_ "GenMsgSendType" ENUM {_enum(_SEND_TYPES)};',
        'BA_DEF_DEF_ "DBName" "";',
        'BA_DEF_DEF_ "BusType" "CAN";',
        'BA_DEF_DEF_ "Baudrate" 1000000;',
        'BA_DEF_DEF_ "BaudrateCANFD" 0;',
        'BA_DEF_DEF_ "VFrameFormat" "StandardCAN";',
        'BA_DEF_DEF_ "CANFD_BRS" "0";',
        'BA_DEF_DEF_ "GenMsgCycleTime" 0;',
        'BA_DEF_DEF_ "GenMsgSendType" "Cyclic";',
        f'BA_ "DBName" "{bus.name}";',
        f'BA_ "BusType" "{"CAN FD" if bus.fd else "CAN"}";',
        f'BA_ "Baudrate" {bus.bitrate};',
    ]
    if bus.fd:
        lines.append(f'BA_ "BaudrateCANFD" {bus.data_bitrate};')
    for m in messages:
        kind = 14 * m.fd + bool(m.can_id & CAN_EFF)
        lines += [
            f'BA_ "VFrameFormat" BO_ {m.can_id} {kind};',
            f'BA_ "CANFD_BRS" BO_ {m.can_id} {int(m.fd)};',
            f'BA_ "GenMsgCycleTime" BO_ {m.can_id} {m.cycle_ms};',
            f'BA_ "GenMsgSendType" BO_ {m.can_id} {int(m.cycle_ms == 0)};',
        ]
    for m in messages:
        for signal in m.signals:
            if signal.values:
                table = " ".join(f'{value} "{word}"' for value, word in signal.values.items())
                lines.append(f"VAL_ {m.can_id} {signal.name} {table} ;")
    return "\n".join(lines) + "\n"


def _messages(topology: Topology, index: int) -> list[_Message]:
    """SYNC, data frames and heartbeats of a bus."""
    boards = _boards(topology, index)
    names = _Names()
    messages = []
    period_ms = _whole_ms(1e3 / topology.cycle_rate_hz)
    if topology.sync_id is not None:
        everybody = ",".join(f"board_{k + 1}" for k in range(len(boards))) or HOST
        counter = _Signal(names.signal("SYNC", "counter"), 0, 8)
        comment = f"Units sample when it comes; {topology.cycle_rate_hz:g} Hz"
        messages.append(
            _Message(names.message("SYNC"), topology.sync_id, 1, False, HOST, everybody, comment,
                     period_ms, [counter])
        )  # fmt: skip
    data_ms = 0 if topology.sync_id is not None else period_ms
    prefixes = {unit: names.unit(topology.unit_names[unit]) for unit in _units(topology, index)}
    for k, first in enumerate(boards):
        messages += _data(topology, first, k + 1, data_ms, prefixes, names)
    for node in heartbeat_nodes(topology, index):
        messages.append(_heartbeat(node, names))
    return messages


def _boards(topology: Topology, index: int) -> np.ndarray:
    """Rows of `Topology.frames` that start a set, on one bus."""
    return np.flatnonzero((topology.frames.bus == index) & (topology.frames.part == 0))


def _units(topology: Topology, index: int) -> list[int]:
    carried = topology.frames.units[topology.frames.bus == index]
    return np.unique(carried[carried >= 0]).tolist()


def _data(
    topology: Topology,
    first: int,
    node: int,
    cycle_ms: int,
    prefixes: dict[int, str],
    names: _Names,
) -> Iterator[_Message]:
    """The messages of one board: one for each part of its layout, or one with pages."""
    frames = topology.frames
    layout = topology.layouts[frames.layout[first]]
    units = [int(unit) for unit in frames.units[first]][: layout.units]
    carried = [unit for unit in units if unit >= 0]
    comment = "Unit " if len(carried) == 1 else "Units "
    comment += ", ".join(topology.unit_names[unit] for unit in carried)
    if layout.counts_only:
        comment += f"; counts of another sensor ({layout.name}), not F3T"
    if layout.units == 1:
        owner, tail = prefixes[carried[0]], ""
    else:
        owner, tail = topology.patch_names[topology.patch[carried[0]]], f"_board_{node}"
    for message in range(layout.ids):
        name = names.message(owner, tail if layout.ids == 1 else f"{tail}_part_{message + 1}")
        signals: list[_Signal] = []
        if layout.pages:
            signals.append(_Signal(names.signal(name, "page"), 0, 8, page="M"))
        for part in range(layout.parts) if layout.pages else [message]:
            page = f"m{layout.pages[part]}" if layout.pages else ""
            signals += _signals(topology, layout, part, units, page, name, prefixes, names)
        can_id = int(frames.can_id[first + message])
        yield _Message(name, can_id, layout.size, layout.fd, f"board_{node}", HOST, comment,
                       cycle_ms, signals)  # fmt: skip


def _signals(
    topology: Topology,
    layout: WireLayout,
    part: int,
    units: list[int],
    page: str,
    message: str,
    prefixes: dict[int, str],
    names: _Names,
) -> Iterator[_Signal]:
    for signal in layout.signals:
        of_frame = signal.name in FRAME_FIELDS
        unit = units[signal.slot]
        if signal.part != part or (unit < 0 and not of_frame):
            continue
        scale, offset, quantity = signal.scale, signal.offset, ""
        if signal.name in CHANNELS:
            row = CHANNELS.index(signal.name)
            scale = float(topology.scale[row, unit])
            offset = float(topology.offset[row, unit]) - scale * signal.bias
            quantity = "" if layout.counts_only else _ascii(QUANTITIES[signal.name])
        yield _Signal(
            name=names.signal(message if of_frame else prefixes[unit], signal.name),
            start=signal.start,
            length=signal.length,
            order=signal.order,
            signed=signal.signed,
            scale=scale,
            offset=offset,
            unit=quantity,
            values=_faults(signal),
            page=page,
        )


def _faults(signal: Signal) -> dict[int, str]:
    """Texts for the values of a status: 0 is healthy, and a single bit is just a fault."""
    if signal.name not in ("status", "unit_status"):
        return {}
    return {0: "ok", 1: "fault"} if signal.length == 1 else {0: "ok"}


def _heartbeat(node: int, names: _Names) -> _Message:
    name = names.message("heartbeat", f"_{node}")
    signals = _of_fields(name, FIELDS, {"state": dict(enumerate(STATES))}, names)
    return _Message(name, FIRST_ID + node, LAYOUT.size, False, f"board_{node}", HOST,
                    f"Heartbeat of board_{node}", _whole_ms(1e3 * PERIOD_S), signals)  # fmt: skip


def _of_fields(
    message: str,
    fields: tuple[tuple[str, int], ...],
    values: dict[str, dict[int, str]],
    names: _Names,
) -> list[_Signal]:
    """Signals of fields that lie one behind the other, and the words for some values."""
    starts = np.cumsum([0, *(bits for _, bits in fields)]).tolist()
    return [
        _Signal(names.signal(message, what), start, bits, values=values.get(what, {}),
                unit="s" if what.endswith("_s") else "")
        for (what, bits), start in zip(fields, starts, strict=False)
    ]  # fmt: skip


class _Names:
    """Makes names for a file: short, unique C identifiers."""

    def __init__(self) -> None:
        self._taken: set[str] = {HOST}
        self._signals: set[str] = set()
        self._units: set[str] = set()

    def message(self, owner: str, tail: str = "") -> str:
        """A message's name, with room for the name of a field after it; the owner is shortened."""
        room = LONGEST - 1 - max(map(len, FRAME_FIELDS))
        return _once(_identifier(owner)[: room - len(tail)] + tail, room, self._taken)

    def signal(self, owner: str, what: str) -> str:
        return _once(f"{owner}_{what}", LONGEST, self._signals)

    def unit(self, name: str) -> str:
        """A unit's name, with room for the name of a channel after it; the patch is shortened."""
        room = LONGEST - 1 - max(map(len, CHANNELS))
        patch, _, unit = _identifier(name.replace("/", "\0")).partition("\0")
        unit = unit[-(room - 4) :]
        return _once(f"{patch[: room - 1 - len(unit)]}_{unit}", room, self._units)


def _identifier(text: str) -> str:
    plain = re.sub(r"[^A-Za-z0-9_\0]", "_", text)
    return f"_{plain}" if plain[0].isdigit() else plain


def _once(name: str, room: int, taken: set[str]) -> str:
    """A name truncated to its room, and numbered if it is taken."""
    given, number = name[:room], 1
    while given.lower() in taken:
        number += 1
        tail = f"_{number}"
        given = name[: room - len(tail)] + tail
    taken.add(given.lower())
    return given


def _number(value: float) -> str:
    """A number with all digits, without a point if it is whole."""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _whole_ms(period_ms: float) -> int:
    return round(period_ms) if period_ms >= 1.0 else 0


def _enum(words: tuple[str, ...]) -> str:
    return ",".join(f'"{word}"' for word in words)


def _ascii(quantity: str) -> str:
    """A unit of measurement in ASCII, which all tools read alike."""
    return quantity.replace("µ", "u").replace("°", "deg")
