"""The formats read through python-can, and the choice among all by suffix."""

import gzip
import os
import sqlite3

import pytest

from bus import LogError
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, ECHO, FD_BRS, FD_FDF
from bus.logs import read
from tests.fixtures.logs import messages, read_all, records, rows, write_by_pythoncan

FIRST_NS = 1_700_000_000_000_000_000
ROWS = [
    (FIRST_NS, 0x123, 3, 0, 0, 0, b"\1\2\3"),
    (FIRST_NS + 1_000_000, 0x1ABCDEF | CAN_EFF, 8, 0, 0, 0, bytes(range(8))),
    (FIRST_NS + 2_000_000, 0x7FF, 0, 0, 0, 0, b""),
]
ASC = """\
date Sat Sep 30 15:06:13.191 2017
base hex  timestamps absolute
internal events logged
// version 9.0.0
Begin Triggerblock Sat Sep 30 15:06:13.191 2017
   0.000000 Start of measurement
   0.001000 1  123             Rx   d 3 01 02 03
   0.002000 CANFD   1 Tx        7FF                                  1 0 9 12 00 01 02 03 04 05 06 \
07 08 09 0A 0B 0 0 3000 0 0 0 0 0
   0.003000 2  1ABCDEFx        Rx   r 5
   0.004000 1  ErrorFrame
   0.005000 1  Statistic: D 1 R 0 XD 0 XR 0 E 0 O 0 B 0.02%
   0.006000 CANFD   1 Rx        123  Named                          0 0 3 3 01 02 03 0 0 0 0 0 0 0 0
   0.007000 CANFD   1 Rx        124                                 0 0 0 0  0 0 1000 0 0 0 0 0
End TriggerBlock
"""
ASC_ROWS = [
    (1_000_000, 0x123, 3, 0, 0, 0, b"\1\2\3"),
    (2_000_000, 0x7FF, 12, FD_FDF | FD_BRS, ECHO, 0, bytes(range(12))),
    (3_000_000, 0x1ABCDEF | CAN_EFF | CAN_RTR, 5, 0, 0, 1, b""),
    (4_000_000, CAN_ERR | 0x80, 8, 0, 0, 0, bytes(8)),
    (6_000_000, 0x123, 3, 0, 0, 0, b"\1\2\3"),
    (7_000_000, 0x124, 0, FD_FDF, 0, 0, b""),
]
TRC = """\
;$FILEVERSION=2.1
;$STARTTIME=43008.5
;$COLUMNS=N,O,T,B,I,d,R,L,D
;
      1      1000.000 DT  1     0123 Rx -  3    01 02 03
      2      1500.000 FB  2 01ABCDEF Tx -  9    00 01 02 03 04 05 06 07 08 09 0A 0B
      3      1600.000 ST  1        - Rx -  4    00 00 00 00
      4      1700.000 RR  1     0123 Rx -  5
"""
TRC_START_NS = (43008 - 25569) * 86_400_000_000_000 + 43_200_000_000_000
TRC_ROWS = [
    (TRC_START_NS + 1_000_000_000, 0x123, 3, 0, 0, 0, b"\1\2\3"),
    (TRC_START_NS + 1_500_000_000, 0x1ABCDEF | CAN_EFF, 12, FD_FDF | FD_BRS, ECHO, 1,
     bytes(range(12))),
    (TRC_START_NS + 1_700_000_000, 0x123 | CAN_RTR, 5, 0, 0, 0, b""),
]  # fmt: skip


def write_sqlite(path, found):
    """Write the table that python-can's reader expects."""
    connection = sqlite3.connect(path)
    connection.execute(
        "CREATE TABLE messages (ts REAL, arbitration_id INTEGER, extended INTEGER, "
        "remote INTEGER, error INTEGER, dlc INTEGER, data BLOB)"
    )
    connection.executemany(
        "INSERT INTO messages VALUES (?, ?, ?, ?, ?, ?, ?)",
        [
            (m.timestamp, m.arbitration_id, m.is_extended_id, m.is_remote_frame,
             m.is_error_frame, m.dlc, bytes(m.data))
            for m in messages(found)
        ],
    )  # fmt: skip
    connection.commit()
    connection.close()


@pytest.mark.parametrize("suffix", [".asc", ".csv", ".trc", ".db"])
def test_frames_that_pythoncan_writes_are_read(suffix, tmp_path):
    path = tmp_path / f"a.run{suffix}"
    (write_sqlite if suffix == ".db" else write_by_pythoncan)(path, records(*ROWS))
    begin = FIRST_NS if suffix == ".asc" else 0
    expected = [(row[0] - begin, *row[1:]) for row in ROWS]
    assert rows(read_all(path)) == expected
    if suffix == ".asc":
        packed = path.with_suffix(f"{suffix}.gz")
        packed.write_bytes(gzip.compress(path.read_bytes()))
        assert rows(read_all(packed, batch=2)) == expected


@pytest.mark.parametrize(
    ("suffix", "text", "expected"), [(".asc", ASC, ASC_ROWS), (".trc", TRC, TRC_ROWS)]
)
def test_text_is_read_with_all_its_kinds(suffix, text, expected, tmp_path):
    path = tmp_path / f"some{suffix}"
    path.write_text(text)
    assert rows(read_all(path)) == expected
    log = read(path, buses={"can1": 4})
    found = [row for batch in log for row in rows(batch.frames)]
    assert found == [(*row[:5], 4, row[6]) for row in expected if row[5] == 1]
    assert log.skipped == {"frame of can0": len(expected) - 1}


@pytest.mark.parametrize(
    ("name", "content", "wrong"),
    [
        ("cut.csv", b"timestamp,arbitration_id,extended,remote,error,dlc,data\n1,2\n", "csv log"),
        ("cut.db", b"SQLite format 3\0" + bytes(99), "whole .db log; got: DatabaseError"),
        ("long.trc", TRC.encode() + b"5 1 DT 1 0123 Rx - 3 " + b"01 " * 99, "trc log"),
        ("gone.asc.gz", gzip.compress(ASC.encode())[:-20], "asc log; got: EOFError"),
    ],
)
def test_damage_ends_a_log_behind_what_is_whole(name, content, wrong, tmp_path):
    path = tmp_path / name
    path.write_bytes(content)
    log = read(path, strict=False)
    found = [row for batch in log for row in rows(batch.frames)]
    assert found == {".trc": TRC_ROWS, ".gz": ASC_ROWS[: len(found)]}.get(path.suffix, [])
    assert wrong in str(log.damage)


def test_a_batch_that_is_full_is_given_at_once(tmp_path):
    path = tmp_path / "some.csv"
    write_by_pythoncan(path, records(*ROWS * 5))
    assert [len(batch) for batch in read(path, batch=4)] == [4, 4, 4, 3]
    batches = iter(read(path, batch=1))
    assert len(next(batches)) == 1
    batches.close()
    with pytest.raises(ValueError, match="batch: must be at least 1 frame; got 0"):
        read(path, batch=0)


@pytest.mark.parametrize("suffix", [".log", ".blf", ".asc", ".log.gz", ".db"])
def test_what_is_no_regular_file_is_refused_at_once(suffix, tmp_path):
    pipe = tmp_path / f"pipe{suffix}"
    os.mkfifo(pipe)
    device = tmp_path / f"zero{suffix}"
    device.symlink_to("/dev/zero")
    for path, got in ((pipe, "a FIFO"), (device, "a device"), (f"{'n' * 300}{suffix}", "File nam")):
        with pytest.raises(LogError, match=f"must be a readable file; got: {got}"):
            read(path)
