"""BLF logs: every kind of object, any damage, and python-can as the other reader and writer."""

import itertools
import struct
import zlib
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import FRAME_DTYPE, LogError
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, ECHO
from bus.logs import blf, read
from tests.fixtures.cases import long_after_first
from tests.fixtures.logs import (
    CHANNELS,
    blf_container,
    blf_file,
    blf_object,
    can_message,
    frames,
    read_all,
    rows,
    write_by_pythoncan,
)

START_NS = int(datetime(2024, 2, 29, 12, 30, 15, 250_000, UTC).timestamp() * 1000) * 1_000_000
DATA = bytes(range(1, 65))
INFLATERS = sorted({blf.inflating, zlib}, key=lambda module: module.__name__)


def of_bytes(content, folder, **options):
    """Read a file, and how it ended."""
    path = folder / "some.blf"
    path.write_bytes(content)
    log = read(path, strict=False, **options)
    found = [batch.frames.copy() for batch in log]
    return np.concatenate(found) if found else np.zeros(0, FRAME_DTYPE), log


def fd_message(*, length=12, flags=0, bits=7, data=DATA, code=9):
    head = struct.pack("<HBBLLBBB5x", 2, flags, code, 0x1234 | CAN_EFF, 0, 0, bits, length)
    return blf_object(100, head + data[:length])


def fd_message_64(*, length=12, there=None, bits=0x7000, sent=0, more=0, tail=b"", code=9):
    head = struct.pack(
        "<BBBBLLLLLLLHBBL", 2, code, length, 0, 0x123, 0, bits, 0, 0, 0, 0, 0, sent, more, 0
    )
    return blf_object(101, head + DATA[: length if there is None else there] + tail)


def error_ext(*, flags=0, ecc=0, position=0, length=0, can_id=0x24, data=DATA[:8]):
    contents = struct.pack(
        "<HHLBBBxLLH2x8s", 3, 0, flags, ecc, position, len(data), length, can_id, 0, data
    )
    return blf_object(73, contents)


def fd_error_64(*, flags=0, ecc=0):
    contents = struct.pack("<BBBBHHHBxLLLLLLLHH", 3, 0, 0, ecc, flags, 0, 0, 0, *[0] * 9)
    return blf_object(104, contents)


def error(details=b"", kind=0x80):
    return CAN_ERR | kind, 8, 0, 0, details.ljust(8, b"\0")


KINDS = {
    "classic": (can_message(), (0x123, 3, 0, 0, b"\1\2\3")),
    "classic, second type": (can_message(kind=86), (0x123, 3, 0, 0, b"\1\2\3")),
    "extended": (can_message(0x123 | CAN_EFF), (0x123 | CAN_EFF, 3, 0, 0, b"\1\2\3")),
    "extended by its number": (can_message(0x800), (0x800 | CAN_EFF, 3, 0, 0, b"\1\2\3")),
    "sent": (can_message(flags=1), (0x123, 3, 0, ECHO, b"\1\2\3")),
    "remote": (can_message(flags=0x80, data=bytes(5)), (0x123 | CAN_RTR, 5, 0, 0, b"")),
    "length code above 8": (
        blf_object(1, struct.pack("<HBBL8s", 1, 0, 15, 0x123, DATA)),
        (0x123, 8, 0, 0, DATA[:8]),
    ),
    "fd": (fd_message(), (0x1234 | CAN_EFF, 12, 7, 0, DATA[:12])),
    "fd without switch": (fd_message(bits=1, length=64), (0x1234 | CAN_EFF, 64, 4, 0, DATA)),
    "fd sent": (fd_message(flags=1), (0x1234 | CAN_EFF, 12, 7, ECHO, DATA[:12])),
    "classic in fd": (fd_message(bits=0, length=8), (0x1234 | CAN_EFF, 8, 0, 0, DATA[:8])),
    "remote in fd": (
        fd_message(bits=0, flags=0x80, length=0, code=4),
        (0x1234 | CAN_EFF | CAN_RTR, 4, 0, 0, b""),
    ),
    "fd 64": (fd_message_64(), (0x123, 12, 7, 0, DATA[:12])),
    "fd 64 without switch": (fd_message_64(bits=0x1000, length=64), (0x123, 64, 4, 0, DATA)),
    "fd 64 sent": (fd_message_64(sent=1), (0x123, 12, 7, ECHO, DATA[:12])),
    "fd 64 with more behind": (
        fd_message_64(more=32 + 40 + 12, tail=b"x" * 12),
        (0x123, 12, 7, 0, DATA[:12]),
    ),
    "fd 64 with less than told": (fd_message_64(there=5), (0x123, 12, 7, 0, DATA[:5] + bytes(7))),
    "fd 64 with less than told before more": (
        fd_message_64(more=32 + 40 + 5, there=5, tail=b"x" * 9),
        (0x123, 12, 7, 0, DATA[:5] + bytes(7)),
    ),
    "fd 64 with nonsense for more": (fd_message_64(more=3), (0x123, 12, 7, 0, bytes(12))),
    "classic in fd 64": (fd_message_64(bits=0, length=8), (0x123, 8, 0, 0, DATA[:8])),
    "remote in fd 64": (
        fd_message_64(bits=0x10, length=0, code=4),
        (0x123 | CAN_RTR, 4, 0, 0, b""),
    ),
    "error": (blf_object(2, struct.pack("<HHL", 3, 0, 0)), error()),
    "error by SocketCAN": (error_ext(), error(DATA[:8], 0x24)),
    "error by SocketCAN without class": (error_ext(can_id=0, data=b"\7"), error(b"\7")),
    "error with nothing known": (error_ext(length=9), error()),
    "bit error sent": (error_ext(flags=1, ecc=0x0A), error(b"\0\0\x81\x0a", 0x88)),
    "form error received": (error_ext(flags=5, ecc=0x78), error(b"\0\0\x02\x18", 0x88)),
    "stuff error received": (error_ext(flags=1, ecc=0xA2), error(b"\0\0\x04\x02", 0x88)),
    "other error received": (error_ext(flags=1, ecc=0xE0), error(b"\0\0\x00\x00", 0x88)),
    "fd error": (fd_error_64(ecc=0x0A), error()),
    "fd error with code": (fd_error_64(flags=1, ecc=0x0A), error(b"\0\0\x81\x0a", 0x88)),
    "overload": (blf_object(3, struct.pack("<HHL", 3, 0, 0)), error(b"\0\0\x20", 0x08)),
}
OTHERS = [
    blf_object(4, bytes(16)),
    blf_object(31, bytes(8)),
    blf_object(96, b"a marker" * 9),
    blf_object(300, b"?"),
    blf_object(115, b""),
]
EXAMPLE = [part for part, _ in KINDS.values()] + OTHERS


def padded(objects):
    """Put objects one after the other as Vector's tools pad them."""
    return b"".join(part + bytes(len(part) % 4) for part in objects)


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_object_is_read(kind, tmp_path):
    part, wanted = KINDS[kind]
    found, log = of_bytes(blf_file(blf_container(part)), tmp_path)
    assert log.damage is None
    assert [row[1:5] + row[6:] for row in rows(found)] == [wanted]
    channel = 1 if kind.startswith(("classic", "extended", "sent", "remote", "length")) else 2
    channel = 2 if "fd" in kind else channel
    channel = 3 if "error" in kind or kind == "overload" else channel
    assert log.channels == {f"can{channel - 1}": 0}
    assert log.skipped == {}


@pytest.mark.parametrize("pad", range(8))
@pytest.mark.parametrize("inside", [True, False])
def test_any_padding_and_what_is_no_frame_is_passed_over(pad, inside, tmp_path):
    body = b"".join(part + bytes(pad) for part in EXAMPLE)
    body = body[: len(body) - pad]
    found, log = of_bytes(blf_file(blf_container(body) if inside else body), tmp_path)
    assert log.damage is None
    assert len(found) == len(KINDS)
    kinds = (4, 31, 96, 115, 255)
    assert log.skipped == {f"object of type {kind}": 1 for kind in kinds}


@pytest.mark.parametrize("packed", [True, False])
@given(sizes=st.lists(st.integers(1, 999), max_size=9), loose=st.booleans())
def test_how_objects_are_spread_over_containers_does_not_show(
    packed, sizes, loose, tmp_path_factory
):
    body = padded(EXAMPLE)
    bounds = [0, *np.minimum(np.cumsum(sizes), len(body)).astype(int), len(body)]
    parts = [blf_container(body[a:b], packed=packed) for a, b in itertools.pairwise(bounds)]
    if loose:
        parts.append(can_message(0x7))
    found, log = of_bytes(blf_file(*parts), tmp_path_factory.getbasetemp())
    assert log.damage is None
    expected, _ = of_bytes(blf_file(body), tmp_path_factory.getbasetemp())
    assert rows(found)[: len(KINDS)] == rows(expected)
    assert len(found) == len(KINDS) + loose


@pytest.mark.parametrize(
    ("fields", "since_ns"),
    [
        ({"resolution": 2, "stamp": 123_456_789}, 123_456_789),
        ({"resolution": 1, "stamp": 123_456}, 1_234_560_000),
        ({"resolution": 2, "stamp": 5, "version": 2}, 5),
        ({"resolution": 0, "stamp": 7}, 7),
    ],
)
def test_stamps_count_from_the_date_in_the_head(fields, since_ns, tmp_path):
    part = can_message(**fields)
    assert of_bytes(blf_file(part), tmp_path)[0]["stamp_ns"].tolist() == [START_NS + since_ns]
    for none in ((0,) * 8, (2024, 13, 0, 1, 0, 0, 0, 0), (9999, 12, 0, 31, 0, 0, 0, 0)):
        found, _ = of_bytes(blf_file(part, date=none), tmp_path)
        assert found["stamp_ns"].tolist() == [since_ns]


def example_file(packed):
    """Make a small file with everything in it, and the place where each object begins."""
    half = len(EXAMPLE) // 2
    inside = padded(EXAMPLE[:half])
    parts = [blf_container(inside[:700], packed=packed), blf_container(inside[700:], packed=packed)]
    return blf_file(*parts, padded(EXAMPLE[half:]), objects=len(EXAMPLE))


@long_after_first("packed", [True, False])
def test_a_file_cut_anywhere_is_read_as_far_as_it_goes(packed, tmp_path):
    content = example_file(packed)
    whole, log = of_bytes(content, tmp_path)
    assert log.damage is None
    last = 0
    for size in range(0, len(content), 7):
        found, log = of_bytes(content[:size], tmp_path)
        assert (found == whole[: len(found)]).all()
        assert last <= len(found) <= len(whole)
        assert log.damage is not None
        last = len(found)
        if size >= 144:
            assert f"of {len(EXAMPLE)} objects, up to the last " in str(log.damage)
    assert last >= len(whole) - 2


@pytest.mark.parametrize("inflating", INFLATERS, ids=lambda module: module.__name__)
def test_a_damaged_container_gives_none_of_its_frames(inflating, tmp_path, monkeypatch):
    monkeypatch.setattr(blf, "inflating", inflating)
    bodies = [padded(can_message(100 * k + i) for i in range(90)) for k in range(3)]
    parts = [blf_container(body) for body in bodies]
    places = np.cumsum([144] + [len(part) for part in parts])
    content = bytearray(blf_file(*parts))
    for place in range(places[1] + 34, places[2] - 3, 31):
        content[place] ^= 0x10
        found, log = of_bytes(content, tmp_path)
        assert found["id"].tolist() == list(range(90))
        assert f"byte {places[1]}: " in str(log.damage)
        assert "(read: 90 objects, up to the last " in str(log.damage)
        content[place] ^= 0x10


@given(data=st.data())
def test_any_damage_ends_a_log_and_no_more(data, tmp_path_factory):
    content = bytearray(example_file(data.draw(st.booleans())))
    for _ in range(data.draw(st.integers(1, 5))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] = data.draw(st.sampled_from([0, 1, 2, 10, 0x7F, 0x80, 0xFF]))
    log = of_bytes(bytes(content), tmp_path_factory.getbasetemp())[1]
    assert log.damage is None or isinstance(log.damage, LogError)


@pytest.mark.parametrize("lies", [{"size": 0}, {"size": 15}, {"size": 0xFFFFFFFF}, {"head": 31},
                                  {"head": 60000}, {"stamp": 2**63}, {"stamp": 2**63 - 1},
                                  {"resolution": 1, "stamp": 2**60}])  # fmt: skip
def test_an_object_that_lies_ends_a_log(lies, tmp_path):
    for wrap in (bytes, blf_container):
        body = wrap(can_message(1) + can_message(2, **lies) + can_message(3))
        found, log = of_bytes(blf_file(body), tmp_path)
        assert found["id"].tolist() == [1]
        assert ("byte 48 of contents: " if wrap is blf_container else "byte 192: ") in str(
            log.damage
        )


@pytest.mark.parametrize("kind", sorted({1, 2, 3, 73, 86, 100, 101, 104}))
def test_an_object_shorter_than_its_type_ends_a_log(kind, tmp_path):
    found, log = of_bytes(blf_file(blf_object(kind, b"")), tmp_path)
    assert len(found) == 0
    assert "must be an object as long as its type demands" in str(log.damage)


@given(found=frames())
def test_what_pythoncan_writes_is_read(found, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "by-pythoncan.blf"
    found["stamp_ns"] += 10**18  # before 1990 it writes no date
    write_by_pythoncan(path, found)
    read_again = read_all(path, buses=CHANNELS)
    # Its stamps pass through floats on the way.
    assert (np.abs(read_again["stamp_ns"] - found["stamp_ns"]) < 1500).all()
    read_again["stamp_ns"] = found["stamp_ns"]
    assert rows(read_again) == rows(found)
