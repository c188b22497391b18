"""DBC files: their messages and signals, as far as a wire layout needs them.

The reader handles messages (BO_) and their signals (SG_) with their units, float signals
(SIG_VALTYPE_) and CAN FD frames (the attribute VFrameFormat). Everything else is ignored. A line
that cannot be read is a fault of its message only.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Literal

from topology.errors import MESSAGES, Issue
from topology.read import read_text
from topology.report import Report

__all__ = ["DbcMessage", "DbcSignal", "conversion", "read_dbc"]

LARGEST_MB, MOST_LINES = 16, 400_000
"""Larger files are refused before they are parsed; those of whole cars are a few MB."""

_COMMENT = re.compile(
    r'^[ \t]*+CM_[ \t](?:.|\n)*?(?:(?<!\\)"[ \t]*+;[ \t]*+$'
    r"|^(?=[ \t]*+(?:CM|BA|BA_DEF\w*|VAL|EV_DATA|SIG_\w+|SG_MUL_VAL)_[ \t]))",
    re.M,
)
"""Other statements end one without an end: quotes within comments are not always escaped."""
_NAME = r"""[^\s:|@"]+"""
_NUMBER = r"[-+]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][-+]?\d++)?"
_MESSAGE = re.compile(
    rf"\s*BO_\s+(?P<id>\d{{1,10}})\s+(?P<name>{_NAME})\s*:\s*(?P<size>\d{{1,5}})(?:\s|$)", re.ASCII
)
_SIGNAL = re.compile(
    rf"\s*SG_\s+(?P<name>{_NAME})(?:\s+(?P<multiplex>M|m\d+M?))?\s*:"
    r"\s*(?P<start>\d{1,5})\s*\|\s*(?P<length>\d{1,5})\s*@\s*(?P<order>[01])\s*(?P<sign>[-+])"
    rf"\s*\(\s*(?P<scale>{_NUMBER})\s*,\s*(?P<offset>{_NUMBER})\s*\)"
    r'\s*\[[^|\]]*\|[^|\]]*\]\s*"(?P<unit>[^"]*)"',
    re.ASCII,
)
_EXPECTED = {
    "BO_": "a message, `BO_ id name: bytes sender`",
    "SG_": 'a signal, `SG_ name : start|bits@order sign (scale,offset) [low|high] "unit" receiver`',
}
_NAMED = re.compile(rf"\s*(?:BO_(?:\s+\d\S*)?|SG_)\s+({_NAME})")
"""The name in a line that is not valid."""
_FLOAT = re.compile(rf"^[ \t]*+SIG_VALTYPE_\s+(\d{{1,10}})\s+({_NAME})\s*:?\s*([12])\s*;", re.M)
_FORMATS = re.compile(r'^[ \t]*+BA_DEF_\s++BO_\s++"VFrameFormat"\s++ENUM\s++([^;]{0,1024}+);', re.M)
_USUAL_FORMAT = re.compile(r'^[ \t]*+BA_DEF_DEF_\s++"VFrameFormat"\s+"?(\w+)"?\s*;', re.M)
_FORMAT = re.compile(r'^[ \t]*+BA_\s++"VFrameFormat"\s++BO_\s++(\d{1,10})\s+"?(\w+)"?\s*;', re.M)
_FD_FORMATS = {"14", "15", "StandardCAN_FD", "ExtendedCAN_FD"}

UNUSED = "VECTOR__INDEPENDENT_SIG_MSG"
"""Message of some tools for signals without a message."""

_PREFIXES = {
    "p": (-12, "pico"), "n": (-9, "nano"), "u": (-6, "μ", "micro"), "m": (-3, "milli"),
    "": (0,), "k": (3, "kilo"), "M": (6, "mega"), "G": (9, "giga"),
}  # fmt: skip
_BASES = {
    "µA": (("pnum", 6, ("A", "amp", "amps", "ampere", "amperes")),),
    "Hz": (("mkMG", 0, ("Hz", "hertz", "1/s", "s-1", "s^-1")),),
    "µT": (("pnum", 6, ("T", "tesla")), ("unmk", 2, ("G", "Gs", "gauss", "Oe", "oersted"))),
    "°C": (("m", 0, ("C", "celsius")),),
}
"""Of each unit of our own: prefixes, power of ten without a prefix, and spellings. An oersted in
air is a gauss."""
_SCALES = {
    "K": (1.0, -273.15), "kelvin": (1.0, -273.15), "mK": (1e-3, -273.15),
    "F": (5 / 9, -160 / 9), "fahrenheit": (5 / 9, -160 / 9),
}  # fmt: skip
"""Other temperatures: factor and offset."""


def _spellings() -> dict[str, dict[str, tuple[float, float]]]:
    """Factor and offset by spelling, for each unit of our own."""
    known: dict[str, dict[str, tuple[float, float]]] = {own: {} for own in _BASES}
    known["°C"] |= _SCALES
    for own, kinds in _BASES.items():
        for prefixes, power, names in kinds:
            for prefix, name in product(["", *prefixes], names):
                exponent, *words = _PREFIXES[prefix]
                factor = 10.0 ** (exponent + power)
                known[own] |= {f"{word}{name}": (factor, 0.0) for word in (prefix, *words)}
    return known


_KNOWN = _spellings()


def conversion(unit: str, own: str) -> tuple[float, float] | None:
    """Factor and offset from a unit of a DBC file to one of `topology.wire.QUANTITIES`.

    Upper and lower case may be mixed up where that leaves one meaning; `g` is a gram. An empty text
    is our own unit. None for an unknown one, and for one of another quantity.

    Examples
    --------
    >>> conversion("mT", "µT"), conversion("deg C", "°C"), conversion("MHz", "µT")
    ((1000.0, 0.0), (1.0, 0.0), None)
    """
    if not unit.strip():
        return 1.0, 0.0
    # mojibake of UTF-8 first; NFKC makes one letter of both micro signs, and °C of ℃
    text = unit.replace("Â", "").replace("Î¼", "μ").replace("¡æ", "C").replace("º", "°")
    text = re.sub(r"[\s_.()\[\]]", "", unicodedata.normalize("NFKC", text))
    known = _KNOWN[own]
    if own == "°C":
        text = re.sub("°|deg(rees?)?", "", text, flags=re.I)
    if text in known:
        return known[text]
    folded = {value for name, value in known.items() if name.casefold() == text.casefold()}
    is_gram = own == "µT" and text.endswith("g")
    return folded.pop() if len(folded) == 1 and not is_gram else None


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
    unit : str
        As in the file; see `conversion`.
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
    unit: str


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
    faults : dict of str to Issue
        Signals whose lines are not valid; "" for the message itself.
    """

    name: str
    line: int
    can_id: int
    size: int
    fd: bool
    signals: dict[str, DbcSignal] = field(default_factory=dict)
    faults: dict[str, Issue] = field(default_factory=dict)


def read_dbc(path: Path, shown: str, report: Report) -> dict[str, DbcMessage] | None:
    """Messages of a DBC file by name, or None where it cannot be read, and reported.

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
    text = _decoded(raw).replace("\r\n", "\n").replace("\r", "\n")
    text = _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text)
    floats = {(int(m[1]), m[2]) for m in _FLOAT.finditer(text)}
    fd_ids, fd_usually = _fd_messages(text)
    messages: dict[str, DbcMessage] = {}
    message = DbcMessage(UNUSED, 0, 0, 0, False)

    def fault(code: str, line: int, **values: object) -> Issue:
        return Issue(code, shown, line, "", MESSAGES[code].format(**values))

    for number, row in enumerate(text.split("\n"), 1):
        word = (row.split(maxsplit=1) or [""])[0]
        if word not in _EXPECTED:
            continue
        found = (_MESSAGE if word == "BO_" else _SIGNAL).match(row)
        named = _NAMED.match(row)
        name = found["name"] if found else named[1] if named else ""
        wrong = None
        if found is None:
            wrong = fault("dbc-line", number, expected=_EXPECTED[word], got=_short(row))
        if word == "BO_":
            can_id, size = (int(found["id"]), int(found["size"])) if found else (0, 0)
            message = DbcMessage(name, number, can_id, size, fd_ids.get(can_id, fd_usually))
            first = messages.setdefault(name, message)
            if wrong is None and first is not message:
                wrong = fault("dbc-twice", number, name=repr(name), first=first.line)
            if wrong is not None:
                first.faults.setdefault("", wrong)
            continue
        if found is not None:
            signal = _signal(found, number, (message.can_id, name) in floats)
            first = message.signals.setdefault(name, signal)
            if first is not signal:
                wrong = fault("dbc-twice", number, name=repr(name), first=first.line)
        if wrong is not None:
            message.faults.setdefault(name, wrong)
    messages.pop(UNUSED, None)
    return messages


def _decoded(raw: bytes) -> str:
    """Text of a file; the format names no encoding."""
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", "replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _signal(found: re.Match[str], line: int, is_float: bool) -> DbcSignal:
    return DbcSignal(
        name=found["name"],
        line=line,
        start=int(found["start"]),
        length=int(found["length"]),
        order="little" if found["order"] == "1" else "big",
        signed=found["sign"] == "-",
        scale=float(found["scale"]),
        offset=float(found["offset"]),
        multiplexed=(found["multiplex"] or "M") != "M",
        is_float=is_float,
        unit=found["unit"],
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
