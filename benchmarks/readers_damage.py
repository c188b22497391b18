"""Damaged logs whose truth is known: what each file still says, whoever reads it.

Bytes are changed only in ways that leave no other well-formed log behind, since a reader cannot
know of those: text gets bytes that no line has, loses or gains half a byte or a whole one beside
its length, and whole lines; the contents of containers and blocks with checksums are flipped, those
without only where they hold structure. Heads of texts, which say how all lines are read, stay.
"""

from __future__ import annotations

import os
import random
import re
import struct
import zlib
from collections.abc import Callable, Iterator

__all__ = ["LINES", "WAYS", "damaged"]

Frames = list[int]
"""Numbers of the frames of a seed that a file has, in order."""
LINES = {
    "log": rb"\(", "asc": rb"\s*\d+\.\d+ (\d+ +[\dA-F]+ +Rx|CANFD)", "trc": rb"\s*\d+ ",
}  # fmt: skip
"""Beginning of a line that is a frame."""
FOREIGN = {
    "log": [b"DROPCOUNT: dropped 12 CAN frames on 'can0' socket (total drops 12)\n", b"\n",
            b"\tcontroller-problem{rx-error-warning}\n", b"(1700000000.5) can\n", b"\xff\xfe\n",
            b"read: Network is down\n", bytes(64) + b"\n"],
    "asc": [b"   0.5 1  Statistic: D 1 R 0 XD 0 XR 0 E 0 O 0 B 0.02%\n", b"// a remark\n", b"\n",
            b"   0.5 CANFD   1 Statistic: D 1 R 0 XD 0 XR 0 E 0 O 0\n", bytes(64) + b"\n",
            b"   0.5 CAN 1 Status:chip status error active\n", b"   0.5 1  100  Rx   d 8 01\n",
            b"   0.5 1  100             TxRq d 1 01\n", b"   0.5 CANFD   1 Rx\n"],
    "trc": [b"      7         0.500 ST  1        - Rx -  4    00 00 00 08\n", b";\n", b"\n",
            b"      7         0.500 DT  1     0100 Rx -  8    01\n", bytes(64) + b"\n",
            b"      7         0.500 DT  1\n",
            b"      7         0.500 EC  1        - Rx -  2    00 00\n"],
}  # fmt: skip
"""Lines that are no frames: of the format, of the program that writes it, and of nobody."""


def damaged(suffix: str, raw: bytes, count: int) -> Iterator[tuple[str, bytes, Frames]]:
    """About `count` damaged files of a seed: the way of each, its bytes, and its frames."""
    chance = random.Random(suffix + os.environ.get("READERS_SEED", ""))
    ways = WAYS[suffix]
    for i in range(count):
        way = list(ways)[i % len(ways)]
        yield way, *ways[way](suffix, raw, chance)


def _lines(suffix: str, raw: bytes) -> tuple[list[bytes], list[int], int]:
    """Lines, those of them that are frames, and where the first one begins."""
    lines = raw.splitlines(keepends=True)
    frames = [i for i, line in enumerate(lines) if re.match(LINES[suffix], line)]
    return lines, frames, sum(map(len, lines[: frames[0]]))


def _cut(suffix: str, raw: bytes, chance: random.Random) -> tuple[bytes, Frames]:
    lines, frames, body = _lines(suffix, raw)
    at = chance.randrange(body, len(raw))
    begin = raw.rfind(b"\n", 0, at) + 1
    begun = sum(raw[:begin].count(b"\n") > i for i in frames)
    if raw[begin:at].strip():
        begun += bool(re.match(LINES[suffix], lines[raw[:begin].count(b"\n")]))
    return raw[:at], list(range(begun))


def _bytes_of_text(change: Callable[[bytes, random.Random], bytes]) -> Callable[..., object]:
    def way(suffix: str, raw: bytes, chance: random.Random) -> tuple[bytes, Frames]:
        _, frames, body = _lines(suffix, raw)
        at = chance.randrange(body, len(raw) - 1)
        piece = change(raw[at:], chance)
        return raw[:at] + piece, list(range(len(frames)))

    return way


def _line(
    change: Callable[[str, bytes, random.Random], bytes], times: int = 1
) -> Callable[..., object]:
    """A way that changes one line of a frame, which is then there `times` times."""

    def way(suffix: str, raw: bytes, chance: random.Random) -> tuple[bytes, Frames]:
        lines, frames, _ = _lines(suffix, raw)
        k = chance.randrange(len(frames) - 1)
        lines[frames[k]] = change(suffix, lines[frames[k]], chance)
        return b"".join(lines), [*range(k), *[k] * times, *range(k + 1, len(frames))]

    return way


def _split(suffix: str, line: bytes, chance: random.Random) -> bytes:
    at = chance.choice([found.start() for found in re.finditer(rb"(?<=\S) +\S", line)])
    return line[:at] + b"\n" + line[at:]


def _shorter(suffix: str, line: bytes, chance: random.Random) -> bytes:
    """Without a byte of the data, or of candump, which tells no length, a digit."""
    if suffix == "log":
        return line.rstrip()[:-1] + b"\n"
    behind = re.compile(rb" [\dA-F]{2}(?=[ \r\n])").search(line, _length(suffix, line)[1])
    assert behind is not None
    return line[: behind.start()] + line[behind.end() :]


def _longer(suffix: str, line: bytes, chance: random.Random) -> bytes:
    at = len(line.rstrip()) if suffix in ("log", "trc") else _length(suffix, line)[1]
    return line[:at] + (b"5" if suffix == "log" else b" 55") + line[at:]


def _other_length(suffix: str, line: bytes, chance: random.Random) -> bytes:
    if suffix == "log":  # it has none; more than its frames can have
        return line[:-1] + b"00" * 65 + b"\n"
    begin, end = _length(suffix, line)
    others = [n for n in (0, 3, 7, 12) if n != int(line[begin:end])]
    return line[:begin] + b"%2d" % chance.choice(others) + line[end:]


def _length(suffix: str, line: bytes) -> tuple[int, int]:
    """Where the length of a line stands."""
    how = rb"Rx -\s+(\d+)" if suffix == "trc" else rb"(?:d|[01] [01] [\da-f]) +(\d+)(?= )"
    found = re.search(how, line)
    assert found is not None
    return found.span(1)


TEXT_WAYS: dict[str, Callable[..., tuple[bytes, Frames]]] = {
    "cut": _cut,
    "NUL block": _bytes_of_text(
        lambda rest, c: bytes(n := min(c.choice((8, 64, 300)), len(rest))) + rest[n:]
    ),
    "flipped byte": _bytes_of_text(lambda rest, _: bytes([rest[0] ^ 0x80]) + rest[1:]),
    "line left out": _line(lambda *_: b"", 0),
    "line twice": _line(lambda _, line, __: 2 * line, 2),
    "foreign line": _line(lambda suffix, line, c: c.choice(FOREIGN[suffix]) + line),
    "lines joined": _line(lambda _, line, __: line[:-1]),
    "line split": _line(_split),
    "byte lost": _line(_shorter),
    "byte more": _line(_longer),
    "other length": _line(_other_length),
}  # fmt: skip


def _whole(change: Callable[[bytes, random.Random], bytes]) -> Callable[..., tuple[bytes, Frames]]:
    """A way after which a file ought to hold all frames of its seed."""
    return lambda suffix, raw, chance: (change(raw, chance), list(range(FRAMES)))


FRAMES = 72
_SIZES = (0, 5, 15, 33, 1 << 16, (1 << 31) - 1)


def _flipped(raw: bytes, at: int, chance: random.Random) -> bytes:
    return raw[:at] + bytes([raw[at] ^ 1 << chance.randrange(8)]) + raw[at + 1 :]


def _put(raw: bytes, at: int, value: bytes) -> bytes:
    return raw[:at] + value + raw[at + len(value) :]


def _containers(raw: bytes) -> list[tuple[int, int]]:
    """Begin and length of the containers of a BLF file."""
    found, at = [], struct.unpack_from("<L", raw, 4)[0]
    while at < len(raw):
        size = struct.unpack_from("<L", raw, at + 8)[0]
        found.append((at, size))
        at += size + size % 4
    return found


def _blf_payload(raw: bytes, chance: random.Random) -> bytes:
    at, size = chance.choice(_containers(raw))
    return _flipped(raw, chance.randrange(at + 32, at + size), chance)


def _blf_head(raw: bytes, chance: random.Random) -> bytes:
    at, size = chance.choice(_containers(raw))
    value = chance.choice((*_SIZES, size - 1, size + 1, size - 9, size + 40))
    return _put(raw, at + 8, struct.pack("<L", value)) if chance.random() < 0.6 else \
        _put(raw, at + chance.choice((0, 3, 16)), b"\x07")  # fmt: skip


def _nul(raw: bytes, chance: random.Random) -> bytes:
    at, size = chance.randrange(144, len(raw) - 300), chance.choice((16, 64, 300))
    return _put(raw, at, bytes(size))


def _blf_objects(
    change: Callable[[bytes, random.Random], bytes], times: int = 1
) -> Callable[..., tuple[bytes, Frames]]:
    """A way that changes an object of a file whose containers are not compressed."""

    def way(suffix: str, raw: bytes, chance: random.Random) -> tuple[bytes, Frames]:
        inside = b"".join(zlib.decompress(raw[at + 32 : at + n]) for at, n in _containers(raw))
        objects = [b"LOBJ" + one for one in inside.split(b"LOBJ")[1:]]
        k = chance.randrange(len(objects) - 1)
        objects[k] = change(objects[k], chance)
        inside = b"".join(objects)
        head = struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, 32 + len(inside), 10, 0, len(inside))
        told = _put(raw[:144], 16, struct.pack("<Q", 144 + 32 + len(inside)))
        return told + head + inside, [*range(k), *[k] * times, *range(k + 1, FRAMES)]

    return way


BLF_WAYS: dict[str, Callable[..., tuple[bytes, Frames]]] = {
    "cut": _whole(lambda raw, c: raw[: c.randrange(len(raw))]),
    "NUL block": _whole(_nul),
    "flipped bit": _whole(_blf_payload),
    "other length": _whole(_blf_head),
    "object left out": _blf_objects(lambda *_: b"", 0),
    "object twice": _blf_objects(lambda one, _: 2 * one, 2),
    "foreign object": _blf_objects(
        lambda one, c: _put(one, 12, struct.pack("<L", c.choice((6, 92, 500)))) + one
    ),
    "object cut": _blf_objects(lambda one, c: one[: -c.randrange(1, 40)]),
    "object of other length": _blf_objects(
        lambda one, c: _put(
            one, 8, struct.pack("<L", c.choice((*_SIZES, len(one) + 4, len(one) + 24)))
        )
    ),
    "NUL object": _blf_objects(lambda one, _: bytes(len(one))),
}  # fmt: skip


def _blocks(raw: bytes) -> list[int]:
    return [found.start() for found in re.finditer(rb"##(HD|DG|CG|CN|DZ|SI|TX)\0{4}", raw)]


def _mdf_link(raw: bytes, chance: random.Random) -> bytes:
    """A link that leads out of the file, or back to its own block."""
    at = chance.choice(
        [p for p in _blocks(raw) if raw[p + 2 : p + 4] in (b"HD", b"DG", b"CG", b"CN")]
    )
    links = [k for k in range(struct.unpack_from("<Q", raw, at + 16)[0])
             if struct.unpack_from("<Q", raw, at + 24 + 8 * k)[0]]  # fmt: skip
    where = chance.choice((at, len(raw) + 8, 1 << 40, at + 3))
    return _put(raw, at + 24 + 8 * chance.choice(links), struct.pack("<Q", where))


def _mdf_length(raw: bytes, chance: random.Random) -> bytes:
    at = chance.choice(_blocks(raw))
    size = struct.unpack_from("<Q", raw, at + 8)[0]
    value = chance.choice((0, 8, size - 8, size + 8, 1 << 40))
    return _put(raw, at + 8, struct.pack("<Q", value))


def _mdf_cycles(raw: bytes, chance: random.Random) -> bytes:
    at = next(p for p in _blocks(raw) if raw[p : p + 4] == b"##CG"
              and struct.unpack_from("<Q", raw, p + 80)[0] == FRAMES)  # fmt: skip
    return _put(
        raw,
        at + 80,
        struct.pack("<Q", chance.choice((0, 1, FRAMES - 1, FRAMES + 1, 10**6, 1 << 50))),
    )


def _mdf_payload(raw: bytes, chance: random.Random) -> bytes:
    at = raw.index(b"##DZ")
    return _flipped(
        raw, chance.randrange(at + 48, at + struct.unpack_from("<Q", raw, at + 8)[0]), chance
    )


MDF_WAYS: dict[str, Callable[..., tuple[bytes, Frames]]] = {
    "cut": _whole(lambda raw, c: raw[: c.randrange(len(raw))]),
    "NUL block": _whole(
        lambda raw, c: _put(raw, c.choice(_blocks(raw)), bytes(c.choice((4, 24, 64))))
    ),
    "flipped bit": _whole(_mdf_payload),
    "flipped name of a block": _whole(lambda raw, c: _flipped(raw, c.choice(_blocks(raw)) + 2, c)),
    "other length": _whole(_mdf_length),
    "other link": _whole(_mdf_link),
    "other count": _whole(_mdf_cycles),
    "bytes behind": _whole(lambda raw, c: raw + c.randbytes(c.randrange(1, 400))),
}  # fmt: skip
WAYS = {"log": TEXT_WAYS, "asc": TEXT_WAYS, "trc": TEXT_WAYS, "blf": BLF_WAYS, "mf4": MDF_WAYS}
"""Ways to damage a log, by suffix."""
