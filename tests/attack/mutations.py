"""Files broken at random: what an editor, a transfer or an attacker may do to them."""

from __future__ import annotations

import random
import re

__all__ = ["mutated"]

NUMBERS = (
    b"1e-320", b"1e300", b"-1e300", b"inf", b"nan", b"-1", b"0", b"2147483647",
    b"9223372036854775807", b"9" * 5000, b"0x" + b"f" * 400, b"1e99999", b"'1'", b"[1]", b"true",
)  # fmt: skip
JUNK = (
    b"\0", b"\xff", b'"', b"'", b"[", b"]]", b"{", b"}", b"=", b"\n", b"#", b".", b"\r", b"\x1b[2J",
    b"[[patches]]\n", b"[" * 200, b"a." * 200, b'"""', b"\xef\xbb\xbf", b"x" * 300, b"\n" * 3000,
)  # fmt: skip
_NUMBER = re.compile(rb"(?<![\w.])-?\d[\w.]*")
_LINE = re.compile(rb"[^\n]*\n")
_NAME = re.compile(rb"[a-z_]{3,}")


def mutated(raw: bytes, chance: random.Random) -> bytes:
    """The file with one to three things that are wrong with it."""
    for _ in range(chance.choice((1, 1, 2, 3))):
        raw = chance.choice(WAYS)(raw, chance)
    return raw


def _number(raw: bytes, chance: random.Random) -> bytes:
    return _instead(raw, chance, _NUMBER, chance.choice(NUMBERS))


def _name(raw: bytes, chance: random.Random) -> bytes:
    names = _NAME.findall(raw)
    return _instead(raw, chance, _NAME, chance.choice(names) if names else b"x")


def _instead(raw: bytes, chance: random.Random, what: re.Pattern[bytes], new: bytes) -> bytes:
    found = [match.span() for match in what.finditer(raw)]
    if not found:
        return raw + new
    start, end = chance.choice(found)
    return raw[:start] + new + raw[end:]


def _without_line(raw: bytes, chance: random.Random) -> bytes:
    return _instead(raw, chance, _LINE, b"")


def _line_again(raw: bytes, chance: random.Random) -> bytes:
    lines = _LINE.findall(raw)
    return _instead(raw, chance, _LINE, 2 * chance.choice(lines) if lines else b"")


def _junk(raw: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(raw) + 1)
    return raw[:at] + chance.choice(JUNK) + raw[at:]


def _cut(raw: bytes, chance: random.Random) -> bytes:
    return raw[: chance.randrange(len(raw) + 1)]


def _hole(raw: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(raw) + 1)
    return raw[:at] + raw[at + chance.randrange(40) :]


def _byte(raw: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(raw) + 1)
    return raw[:at] + bytes([chance.randrange(256)]) + raw[at + 1 :]


def _piece_again(raw: bytes, chance: random.Random) -> bytes:
    at, to = (chance.randrange(len(raw) + 1) for _ in range(2))
    return raw[:to] + raw[at : at + chance.randrange(200)] + raw[to:]


WAYS = (_number, _number, _number, _name, _without_line, _line_again, _junk, _cut, _hole, _byte,
        _piece_again)  # fmt: skip
