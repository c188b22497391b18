"""candump logs: what candump and python-can write is read, and what is written they read."""

from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tests.naive.logs as naive_logs
from bus import FRAME_DTYPE, LogError
from bus.errors import ChannelError
from bus.frame import CAN_ERR, CAN_RTR
from bus.logs import LogWriter, candump, read
from tests.fixtures.logs import (
    CANDUMP_WAYS,
    CHANNELS,
    check_candump,
    frames,
    from_messages,
    read_all,
    records,
    rows,
    write,
    write_by_pythoncan,
)

GOLDEN = Path(__file__).parents[2] / "golden" / "logs"
EXAMPLE = b"""\
(1436509052.249713) vcan0 123#1122334455667788
(1436509052.249714) can0 12345678#R
(1436509052.249715) can0 123#R8_9 T
(1436509052.249716) can0 124##5112233 R
(1436509052.249717)  vcan0 20000080#0000000000000000
(1436509052.249717)\tcan0\t7ff#DEadbeef00000000_f\x20
\t
(0.5) slcan0 001#\r
\r
(9223372035.999999999) can0 12345678##f\x20
"""


def of_bytes(text, tmp_path, **options):
    """Read a log, and how it ended."""
    path = tmp_path / "some.log"
    path.write_bytes(text)
    log = read(path, strict=False, **options)
    found = [batch.frames.copy() for batch in log]
    return np.concatenate(found) if found else np.zeros(0, FRAME_DTYPE), log


def named(found, log):
    """Rows with the interface's name in place of the bus."""
    names = [name.encode() for name in log.channels]
    return [(*row[:5], names[row[5]], row[6]) for row in rows(found)]


@given(found=frames(), packed=st.booleans())
def test_what_is_written_is_read_again(found, packed, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / ("own.log" + ".gz" * packed)
    assert write(path, found) == found.size
    found["origin"] = 0
    assert rows(read_all(path, buses=CHANNELS)) == rows(found)


@given(found=frames())
def test_pythoncan_reads_what_is_written(found, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "for-pythoncan.log"
    write(path, found)
    found["origin"] = 0
    with can.LogReader(path) as reader:
        read_by_other = from_messages(reader)
    # It tells nothing about error frames of another class, and no data of a bus error.
    errors = found["id"] & CAN_ERR > 0
    assert (read_by_other["id"] & CAN_ERR > 0)[errors & (found["id"] & 0x80 > 0)].all()
    assert rows(read_by_other[~errors]) == rows(found[~errors])


@given(found=frames(errors=False))
def test_what_pythoncan_writes_is_read(found, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "by-pythoncan.log"
    write_by_pythoncan(path, found)
    found["length"][found["id"] & CAN_RTR > 0] = 0  # it leaves the length out
    assert rows(read_all(path, buses=CHANNELS)) == rows(found)


def test_error_frames_of_pythoncan_are_read(tmp_path):
    path = tmp_path / "by-pythoncan.log"
    with can.Logger(path) as logger:
        logger(can.Message(timestamp=1.5, is_error_frame=True, channel=1))
    assert rows(read_all(path)) == [(1_500_000_000, CAN_ERR | 0x80, 0, 0, 0, 0, b"")]


@pytest.mark.parametrize("way", CANDUMP_WAYS)
def test_each_way_of_candump_is_read_as_what_was_sent(way):
    check_candump(read_all(GOLDEN / f"kinds-{way}.log"), way)


@pytest.mark.parametrize("name", ["kinds-L", "strip-vcan", "palm-vcan"])
def test_what_candump_wrote_is_written_again_byte_by_byte(name, tmp_path):
    copy, found = tmp_path / "copy.log", read(GOLDEN / f"{name}.log")
    assert write(copy, found, channels=["vcan0"]) == found.count > 0
    assert found.channels == {"vcan0": 0}
    assert copy.read_bytes() == found.path.read_bytes()


def test_an_example_of_each_kind_is_read(tmp_path):
    found, log = of_bytes(EXAMPLE, tmp_path)
    assert log.damage is None
    expected, bad = naive_logs.candump(EXAMPLE)
    assert bad == []
    assert named(found, log) == expected
    assert log.channels == {"vcan0": 0, "can0": 1, "slcan0": 2}
    assert log.count == len(expected) == 8


@given(data=st.data())
def test_a_damaged_log_is_read_as_far_as_it_is_good(data, tmp_path_factory):
    text = bytearray(EXAMPLE)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(text) - 1))
        byte = data.draw(st.sampled_from(b"0189AFafRrTt#_() .[]{}\r\n\t\0\xff"))
        if data.draw(st.booleans()):
            text[place] = byte
        else:
            text.insert(place, byte)
    del text[data.draw(st.integers(0, len(text))) :]
    expected, bad = naive_logs.candump(bytes(text))
    found, log = of_bytes(text, tmp_path_factory.getbasetemp())
    names = list(log.channels)
    assert [(*row[:5], names[row[5]], row[6]) for row in rows(found)] == [
        (*row[:5], row[5].decode("utf-8", "backslashreplace"), row[6]) for row in expected
    ]
    line = [] if log.damage is None else [int(str(log.damage).split(":")[1])]
    assert line == bad[:1]
    assert log.damage is None or f"; {len(bad)} line" in str(log.damage)


@given(chunk=st.integers(100, 300), batch=st.integers(1, 9))
def test_neither_chunks_nor_batches_show(chunk, batch, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp()
    whole = rows(of_bytes(EXAMPLE, folder)[0])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candump, "CHUNK_BYTES", chunk)
        found, log = of_bytes(EXAMPLE, folder, batch=batch)
        sizes = [len(part) for part in log]
    assert log.damage is None
    assert rows(found) == whole
    assert set(sizes[:-1]) <= {batch}
    assert sum(sizes) == len(whole)


def test_a_line_longer_than_a_chunk_is_refused(tmp_path):
    line = b"(1.0) can0 123#" + b" " * (1 << 20)
    found, log = of_bytes(b"(1.0) can0 123#11\n" + line, tmp_path)
    assert len(found) == 1
    assert "some.log:2: must be a whole line" in str(log.damage)


def test_a_last_line_without_its_end_is_not_taken(tmp_path):
    text = b"(1.0) can0 123#1122\n(1.1) can0 123#1122"
    found, log = of_bytes(text, tmp_path)
    assert [row[0] for row in rows(found)] == [10**9]
    assert ":2: must be a whole line" in str(log.damage)
    assert of_bytes(text[:20] + b" \t", tmp_path)[1].damage is None
    assert of_bytes(b"", tmp_path)[1].damage is None


def test_channels_asked_for_are_read_and_others_left_out(tmp_path):
    text = b"".join(b"(%d.0) can%d 123#\n" % (i, i % 3) for i in range(30))
    found, log = of_bytes(text, tmp_path, buses={"can2": 0, "can1": 7})
    assert [(row[0] // 10**9, row[5]) for row in rows(found)] == [
        (i, {1: 7, 2: 0}[i % 3]) for i in range(30) if i % 3
    ]
    assert log.channels == {"can0": -1, "can1": 7, "can2": 0}
    assert log.skipped == {"frame of can0": 10}
    assert log.count == 20
    with pytest.raises(ChannelError, match="of 'vcan0'; got 'can0', 'can1', 'can2' alone: --map"):
        of_bytes(text, tmp_path, buses={"vcan0": 0})
    assert of_bytes(b"", tmp_path, buses={"vcan0": 0})[1].damage is None


def test_a_log_is_read_from_its_beginning_each_time(tmp_path):
    path = tmp_path / "some.log"
    path.write_bytes(b"(1.0) can0 123#11\nbad\n")
    log = read(path, strict=False)
    for _ in range(2):
        assert [len(batch) for batch in log] == [1]
        assert log.count == 1
        assert log.damage is not None
    with pytest.raises(LogError, match=":2: column 1"):
        read_all(path)


def test_damaged_compression_ends_a_log(tmp_path):
    path = tmp_path / "some.log.gz"
    found = records(*((1000 * i, i % 2048, 1, 0, 0, 0, bytes([i % 251])) for i in range(30_000)))
    write(path, found)
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:-4], whole[: len(whole) // 2] + b"x" * 99):
        path.write_bytes(damaged)
        log = read(path, strict=False)
        read_rows = [row for batch in log for row in rows(batch.frames)]
        assert read_rows == rows(found[: len(read_rows)])
        assert len(read_rows) > 10_000
        assert "must be readable to its end" in str(log.damage)
    path.write_bytes(b"(1.0) can0 123#11\n")
    assert "must be readable to its end" in str(_damage(path))


def _damage(path):
    log = read(path, strict=False)
    assert sum(len(batch) for batch in log) == 0
    return log.damage


@pytest.mark.parametrize("name", ["", "can 0", "c" * 64, "can\n"])
def test_a_channel_that_cannot_be_read_again_is_refused(name, tmp_path):
    with pytest.raises(ValueError, match=r"channels\[1\]: must be a name of 1 to 63 bytes"):
        LogWriter(tmp_path / "some.log", channels=["can0", name])
