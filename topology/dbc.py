"""DBC files: their messages and signals, as far as a wire layout needs them.

The reader handles messages (BO_) and their signals (SG_), float signals (SIG_VALTYPE_) and CAN FD
frames (the attribute VFrameFormat). Everything else is ignored.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from topology.read import read_text
from topology.report import Report
from topology.wire import LARGEST_SCALE

__all__ = ["DbcMessage", "DbcSignal", "read_dbc"]

LARGEST_MB, MOST_LINES = 16, 400_000
"""Larger files are refused before they are parsed; those of whole cars are a few MB."""

_QUOTED = re.compile(r'"(?:[^"\\]++|\\"|\\)*"')
_NAME = r"[A-Za-z_]\w*"
_NUMBER = r"[-+]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][-+]?\d++)?"
_MESSAGE = re.compile(
    rf"\s*BO_\s+(?P<id>\d{{1,10}})\s+(?P<name>{_NAME})\s*:\s*(?P<size>\d{{1,5}})\s", re.ASCII
)
_SIGNAL = re.compile(
    rf"\s*SG_\s+(?P<name>{_NAME})(?:\s+(?P<multiplex>M|m\d+M?))?\s*:"
    r"\s*(?P<start>\d{1,5})\s*\|\s*(?P<length>\d{1,5})\s*@\s*(?P<order>[01])\s*(?P<sign>[-+])"
    rf"\s*\(\s*(?P<scale>{_NUMBER})\s*,\s*(?P<offset>{_NUMBER})\s*\)"
    r'\s*\[[^|\]]*\|[^|\]]*\]\s*"',
    re.ASCII,
)
_FLOAT = re.compile(rf"^[ \t]*+SIG_VALTYPE_\s+(\d{{1,10}})\s+({_NAME})\s*:?\s*([12])\s*;", re.M)
_FORMATS = re.compile(r'^[ \t]*+BA_DEF_\s++BO_\s++"VFrameFormat"\s++ENUM\s++([^;]{0,1024}+);', re.M)
_USUAL_FORMAT = re.compile(r'^[ \t]*+BA_DEF_DEF_\s++"VFrameFormat"\s+"?(\w+)"?\s*;', re.M)
_FORMAT = re.compile(r'^[ \t]*+BA_\s++"VFrameFormat"\s++BO_\s++(\d{1,10})\s+"?(\w+)"?\s*;', re.M)
_FD_FORMATS = {"14", "15", "StandardCAN_FD", "ExtendedCAN_FD"}

UNUSED = "VECTOR__INDEPENDENT_SIG_MSG"
"""Message of some tools for signals without a message."""


@dataclass(frozen=True)
class DbcSignal:
    """One signal; bits are numbered as in `topology.wire.Signal`.

    Attributes
    ----------
    name : str
    line : int
        Of the file, from 1.
    start, length : int
        Start bit, and number of bits.
    order : "little" or "big"
    signed, is_float : bool
    scale, offset : float
        Physical value = scale * integer + offset.
    multiplexed : bool
        Not in every frame of its message.
    """

    name: str
    line: int
    start: int
    length: int
    order: Literal["little", "big"]
    signed: bool
    scale: float
    offset: float
    multiplexed: bool
    is_float: bool


@dataclass
class DbcMessage:
    """One message.

    Attributes
    ----------
    name : str
    line : int
        Of the file, from 1.
    can_id : int
        Bit 31 set for a 29-bit identifier.
    size : int
        Bytes.
    fd : bool
        Its frames are CAN FD ones.
    signals : dict of str to DbcSignal
    """

    name: str
    line: int
    can_id: int
    size: int
    fd: bool
    signals: dict[str, DbcSignal] = field(default_factory=dict)


def read_dbc(path: Path, shown: str, report: Report) -> dict[str, DbcMessage] | None:
    """Messages of a DBC file by name, or None where it is wrong, and reported.

    Parameters
    ----------
    path : Path
        An existing file.
    shown : str
        Its name in messages.
    report : Report
        Collects the errors.
    """
    raw = read_text(path, shown, report, LARGEST_MB, MOST_LINES)
    if raw is None:
        return None
    # Names are ASCII; comments may be in any encoding, and are passed over.
    text = raw.decode("latin-1").replace("\r\n", "\n").removeprefix("ï»¿")
    after_last = max((quoted.end() for quoted in _QUOTED.finditer(text)), default=0)
    unclosed = text.find('"', after_last)
    if unclosed >= 0:
        return report.about_file("dbc-quote", shown, text.count("\n", 0, unclosed) + 1)
    text = _QUOTED.sub(_on_one_line, text)
    known = len(report.issues)
    messages: dict[str, DbcMessage] = {}
    for message in _messages(text, shown, report):
        if message.name == UNUSED:
            continue
        first = messages.setdefault(message.name, message)
        if first is not message:
            report.about_file("dbc-twice", shown, message.line, name=repr(message.name),
                              first=first.line)  # fmt: skip
    return messages if len(report.issues) == known else None


def _on_one_line(quoted: re.Match[str]) -> str:
    """A quoted text without its contents, if it has line ends: no line of it is parsed."""
    lines = quoted[0].count("\n")
    return '"' + "\n" * lines + '"' if lines else quoted[0]


def _messages(text: str, shown: str, report: Report) -> Iterator[DbcMessage]:
    """Messages with their signals; invalid lines are reported."""
    floats = {(int(m[1]), m[2]) for m in _FLOAT.finditer(text)}
    fd_ids, fd_usually = _fd_messages(text)
    message: DbcMessage | None = None
    for number, row in enumerate(text.split("\n"), 1):
        word = row.split(maxsplit=1)[:1]
        if word == ["BO_"]:
            if message is not None:
                yield message
            message = None
            found = _MESSAGE.match(row + " ")
            if found is None:
                expected = "a message, `BO_ id name: bytes sender`"
                report.about_file("dbc-line", shown, number, expected=expected, got=_short(row))
                continue
            can_id = int(found["id"])
            fd = fd_ids.get(can_id, fd_usually)
            message = DbcMessage(found["name"], number, can_id, int(found["size"]), fd)
        elif word == ["SG_"]:
            signal = _signal(row, number)
            if signal is None:
                expected = (
                    "a signal, `SG_ name : start|bits@order sign (scale,offset) [low|high] "
                    '"unit" receiver`'
                )
                report.about_file("dbc-line", shown, number, expected=expected, got=_short(row))
            elif message is not None:
                _enter(signal, message, floats, shown, report)
    if message is not None:
        yield message


def _enter(
    signal: DbcSignal, message: DbcMessage, floats: set[tuple[int, str]], shown: str, report: Report
) -> None:
    if (message.can_id, signal.name) in floats:
        signal = replace(signal, is_float=True)
    first = message.signals.setdefault(signal.name, signal)
    if first is not signal and message.name != UNUSED:
        report.about_file("dbc-twice", shown, signal.line, name=repr(signal.name),
                          first=first.line)  # fmt: skip


def _signal(row: str, number: int) -> DbcSignal | None:
    found = _SIGNAL.match(row)
    if found is None:
        return None
    scale, offset = float(found["scale"]), float(found["offset"])
    if not max(abs(scale), abs(offset)) <= LARGEST_SCALE:
        return None
    return DbcSignal(
        name=found["name"],
        line=number,
        start=int(found["start"]),
        length=int(found["length"]),
        order="little" if found["order"] == "1" else "big",
        signed=found["sign"] == "-",
        scale=scale,
        offset=offset,
        multiplexed=(found["multiplex"] or "M") != "M",
        is_float=False,
    )


def _fd_messages(text: str) -> tuple[dict[int, bool], bool]:
    """Whether messages, by identifier, are CAN FD frames; and the default."""
    defined = _FORMATS.search(text)
    names = re.findall(r'"([^"]*)"', defined[1]) if defined else []

    def is_fd(value: str) -> bool:
        known = len(value) < 4 and value.isdecimal() and int(value) < len(names)
        return (names[int(value)] if known else value) in _FD_FORMATS

    usual = _USUAL_FORMAT.search(text)
    given = {int(m[1]): is_fd(m[2]) for m in _FORMAT.finditer(text)}
    return given, usual is not None and is_fd(usual[1])


def _short(row: str) -> str:
    row = " ".join(row.split())
    return repr(row if len(row) <= 60 else row[:57] + "...")
