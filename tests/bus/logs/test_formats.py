"""The formats read through python-can and asammdf, and the choice among all by suffix."""

import contextlib
import datetime
import gzip
import sqlite3
import sys
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given

from bus import LogError
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, ECHO, FD_BRS, FD_FDF
from bus.logs import mdf, read, read_all, write
from tests.fixtures.logs import CHANNELS, frames, messages, records, rows, write_by_pythoncan

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
End TriggerBlock
"""
ASC_ROWS = [
    (1_000_000, 0x123, 3, 0, 0, 0, b"\1\2\3"),
    (2_000_000, 0x7FF, 12, FD_FDF | FD_BRS, ECHO, 0, bytes(range(12))),
    (3_000_000, 0x1ABCDEF | CAN_EFF | CAN_RTR, 5, 0, 0, 1, b""),
    (4_000_000, CAN_ERR | 0x80, 8, 0, 0, 0, bytes(8)),
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


def of_text(text, path):
    """Read a text log, and how it ended."""
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    log = read(path, strict=False)
    return [row for batch in log for row in rows(batch.frames)], log


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


@pytest.mark.parametrize(
    ("statement", "told"),
    [
        ("DROP TABLE messages", "messages: must be a table; got none"),
        (
            "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) "
            "SELECT i AS ts, 1 AS arbitration_id, 0 AS extended, 0 AS remote, 0 AS error, "
            "1 AS dlc, x'00' AS data FROM n",
            "messages: must be a table; got view",
        ),
        ("UPDATE messages SET data = 1000000000000", "data: must be bytes; got int"),
        ("UPDATE messages SET ts = 'noon'", ""),
    ],
)
def test_a_database_without_end_or_of_other_types_is_refused(statement, told, tmp_path):
    path = tmp_path / "some.db"
    write_sqlite(path, records(*ROWS))
    with contextlib.closing(sqlite3.connect(path)) as database:
        if statement.startswith("CREATE"):
            database.execute("DROP TABLE messages")
        database.execute(statement)
        database.commit()
    with pytest.raises(LogError, match=f"some.db: row 1: must be a row .*{told}"):
        read_all(path)


@pytest.mark.parametrize("suffix", [".asc", ".csv", ".trc", ".db"])
def test_frames_that_pythoncan_writes_are_read(suffix, tmp_path):
    path = tmp_path / f"some{suffix}"
    if suffix == ".db":
        write_sqlite(path, records(*ROWS))
    else:
        write_by_pythoncan(path, records(*ROWS))
    begin = FIRST_NS if suffix == ".asc" else 0
    expected = [(row[0] - begin, *row[1:]) for row in ROWS]
    assert rows(read_all(path)) == expected
    if suffix != ".db":
        packed = path.with_suffix(f"{suffix}.gz")
        packed.write_bytes(gzip.compress(path.read_bytes()))
        assert rows(read_all(packed, batch=2)) == expected


@given(found=frames())
def test_frames_of_all_kinds_come_through_asc(found, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "some.asc"
    found = found[
        np.array([not (flags and not n) for flags, n in found[["flags", "length"]]], bool)
    ]
    found["stamp_ns"] += 10**18
    write_by_pythoncan(path, found)
    read_again = read_all(path, buses=CHANNELS)
    errors = found["id"] & CAN_ERR > 0
    found["id"][errors], found["data"][errors] = CAN_ERR | 0x80, 0  # it tells no more of them
    if found.size:
        found["stamp_ns"] -= found["stamp_ns"][0]
    assert (np.abs(read_again["stamp_ns"] - found["stamp_ns"]) <= 1000).all()
    read_again["stamp_ns"] = found["stamp_ns"]
    assert rows(read_again) == rows(found)


def test_asc_is_read_with_all_its_kinds(tmp_path):
    found, log = of_text(ASC, tmp_path / "some.asc")
    assert log.damage is None
    assert found == ASC_ROWS
    assert log.channels == {"can0": 0, "can1": 1}


@pytest.mark.parametrize("head", ["base hex  timestamps absolute\n", "// only a remark\n"
                                  "base dec  timestamps absolute\n"])  # fmt: skip
def test_no_frame_is_lost_behind_a_short_head(head, tmp_path):
    frame = "0.001000 1  12 Rx   d 1 10\n"
    found, log = of_text(head + 2 * frame, tmp_path / "some.asc")
    assert log.damage is None
    value = 10 if "dec" in head else 16
    assert [row[6] for row in found] == [bytes([value])] * 2


def test_an_fd_frame_without_data_is_no_remote_frame(tmp_path):
    line = "0.001 CANFD   1 Rx        7FF                                  0 0 0  0  0 0 1000\n"
    found, _ = of_text("base hex  timestamps absolute\n" + line, tmp_path / "some.asc")
    assert found == [(1_000_000, 0x7FF, 0, FD_FDF, 0, 0, b"")]


def test_trc_is_read_with_all_its_kinds(tmp_path):
    found, log = of_text(TRC, tmp_path / "some.trc")
    assert log.damage is None
    assert found == [
        (TRC_START_NS + 1_000_000_000, 0x123, 3, 0, 0, 0, b"\1\2\3"),
        (TRC_START_NS + 1_500_000_000, 0x1ABCDEF | CAN_EFF, 12, FD_FDF | FD_BRS, ECHO, 1,
         bytes(range(12))),
        (TRC_START_NS + 1_700_000_000, 0x123 | CAN_RTR, 5, 0, 0, 0, b""),
    ]  # fmt: skip
    assert log.channels == {"can0": 0, "can1": 1}
    assert log.skipped == {"line": 1}


def test_csv_and_sqlite_know_a_long_frame_as_can_fd(tmp_path):
    wanted = [(FIRST_NS, 0x123, 12, FD_FDF, 0, 0, bytes(12))]
    write_sqlite(tmp_path / "some.db", records(*wanted))
    write_by_pythoncan(tmp_path / "some.csv", records(*wanted))
    assert rows(read_all(tmp_path / "some.db")) == wanted
    assert rows(read_all(tmp_path / "some.csv")) == wanted


def test_channels_asked_for_are_read_and_others_left_out(tmp_path):
    path = tmp_path / "some.asc"
    path.write_text(ASC)
    log = read(path, buses={"can1": 4})
    assert [row for batch in log for row in rows(batch.frames)] == [(*ASC_ROWS[2][:5], 4, b"")]
    assert log.skipped["frame of can0"] == 3
    with pytest.raises(LogError, match=r"'can7'; got channel 1 \(can0\), channel 2 \(can1\)"):
        read_all(path, buses={"can7": 0})


@pytest.mark.parametrize(("suffix", "text"), [(".asc", ASC), (".trc", TRC)])
def test_a_text_cut_anywhere_gives_a_prefix(suffix, text, tmp_path):
    whole, _ = of_text(text, tmp_path / f"some{suffix}")
    for size in range(0, len(text), 7):
        found, log = of_text(text[:size], tmp_path / f"some{suffix}")
        assert found == whole[: len(found)]
        begin = text.rfind("\n", 0, size) + 1
        end = text.find("\n", size) + 1 if text[begin:size].strip() else begin
        wanted, _ = of_text(text[:end], tmp_path / f"some{suffix}")
        assert log.damage is not None or found == wanted


def test_damaged_compression_ends_a_log(tmp_path):
    path = tmp_path / "some.asc.gz"
    packed = gzip.compress(ASC.encode())
    for content in (packed[:40], packed[:-4], packed[:60] + b"???" + packed[63:]):
        path.write_bytes(content)
        log = read(path, strict=False)
        found = [row for batch in log for row in rows(batch.frames)]
        assert found == ASC_ROWS[: len(found)]
        assert log.damage is not None
    path.write_bytes(ASC.encode())
    with pytest.raises(LogError, match=r"some.asc.gz: must be readable to its end; got: Not a gz"):
        read_all(path)


def test_what_only_begins_as_a_database_is_refused(tmp_path):
    path = tmp_path / "some.db"
    path.write_bytes(b"SQLite format 3\0" + bytes(99))
    with pytest.raises(LogError, match=r"some\.db: row 1: must be a row of a \.db log; got "):
        read_all(path)


def test_a_file_that_cannot_be_opened_says_so(tmp_path, monkeypatch):
    path = tmp_path / "some.log.gz"
    path.write_bytes(b"")

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("bus.logs.reader.gzip.open", refuse)
    with pytest.raises(LogError, match=r"some\.log\.gz: must be a readable file; got: .*denied"):
        read_all(path)


def test_a_batch_that_is_full_is_given_at_once(tmp_path):
    path = tmp_path / "some.csv"
    write_by_pythoncan(path, records(*ROWS * 5))
    assert [len(batch) for batch in read(path, batch=4)] == [4, 4, 4, 3]
    with pytest.raises(ValueError, match="batch: must be at least 1 frame; got 0"):
        read(path, batch=0)


def test_a_reader_left_early_closes_its_file(tmp_path):
    path = tmp_path / "some.csv"
    write_by_pythoncan(path, records(*ROWS))
    batches = iter(read(path, batch=1))
    assert len(next(batches)) == 1
    batches.close()


def test_a_log_goes_from_any_format_to_another(tmp_path):
    write_by_pythoncan(tmp_path / "some.csv", records(*ROWS))
    assert write(tmp_path / "some.blf", read(tmp_path / "some.csv", batch=2)) == 3
    assert write(tmp_path / "some.log", read(tmp_path / "some.blf", batch=2)) == 3
    assert rows(read_all(tmp_path / "some.log")) == ROWS


def write_mf4(path, found):
    """Write MF4 by python-can; its frames begin with the present."""
    pytest.importorskip("asammdf", reason="needs asammdf: pip install 'f3t-skin[mdf]'")
    now_ns = int(datetime.datetime.now().timestamp()) * 10**9
    found["stamp_ns"] += now_ns - int(found["stamp_ns"].min())
    with can.MF4Writer(path) as writer:
        for message in messages(found):
            message.channel = int(message.channel.removeprefix("can"))
            writer(message)


@pytest.mark.filterwarnings("default")
def test_mf4_is_read_with_all_its_kinds(tmp_path, monkeypatch):
    wanted = records(
        (0, 0x123, 3, 0, 0, 0, b"\1\2\3"),
        (1_000_000, 0x123 | CAN_RTR, 5, 0, ECHO, 1, b""),
        (2_000_000, CAN_ERR | 0x24, 8, 0, 0, 2, bytes(range(8))),
        (3_000_000, 0x1ABCDEF | CAN_EFF, 64, FD_FDF | FD_BRS, ECHO, 0, bytes(range(64))),
        (4_000_000, 0x7FF, 8, 0, 0, 1, bytes(range(8))),
        *((5_000_000 + i, i, 1, 0, 0, i % 3, bytes([i])) for i in range(200)),
    )
    path = tmp_path / "some.mf4"
    write_mf4(path, wanted)
    monkeypatch.setattr(mdf, "_PIECE", 70)
    found = read_all(path, buses=CHANNELS, batch=64)
    assert (np.abs(found["stamp_ns"] - wanted["stamp_ns"]) < 1000).all()
    found["stamp_ns"] = wanted["stamp_ns"]
    assert rows(found) == rows(wanted)
    log = read(path, buses={"can1": 0})
    assert sum(len(batch) for batch in log) == 2 + 67
    assert log.skipped == {"frame of can0": 2 + 67, "frame of can2": 1 + 66}


@pytest.mark.filterwarnings("default")
def test_a_damaged_mf4_is_refused(tmp_path):
    path = tmp_path / "some.mf4"
    write_mf4(path, records(*ROWS))
    content = path.read_bytes()
    path.write_bytes(content[:200])
    with pytest.raises(LogError, match="must be a whole MDF 4 file; got: "):
        read_all(path)


@pytest.mark.parametrize(
    ("does", "told"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", "signal SIGSEGV"),
        ("os._exit(3)", "status 3"),
    ],
)
def test_a_crash_of_the_library_is_an_error_of_the_file(does, told, tmp_path, monkeypatch):
    """A stand-in ends its process in the midst of a file, as asammdf's C code does."""
    (tmp_path / "asammdf.py").write_text(
        f"import os, signal\n\ndef MDF(path):\n    print('noise', flush=True)\n    {does}\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "asammdf", raising=False)
    path = tmp_path / "some.mf4"
    path.write_bytes(b"MDF     4.10")
    with pytest.raises(LogError) as raised:
        read_all(path)
    assert str(raised.value) == (
        f"{path}: must be a whole MDF 4 file; got: the end of the process that reads it, {told}"
    )


def test_nothing_of_what_the_library_writes_is_unpickled(tmp_path, monkeypatch):
    """A stand-in writes a pickle that creates a file into whatever is open."""
    there = tmp_path / "unpickled"
    (tmp_path / "asammdf.py").write_text(
        f"""
import os, pickle

class Creates:
    def __reduce__(self):
        return os.mkdir, ({str(there)!r},)

def MDF(path):
    for file in range(3, 64):
        try:
            os.write(file, pickle.dumps(Creates()))
        except OSError:
            pass
    os._exit(0)
"""
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "asammdf", raising=False)
    path = tmp_path / "some.mf4"
    path.write_bytes(b"MDF     4.10")
    with pytest.raises(LogError, match="from the process that reads it, bytes that are no frames"):
        read_all(path)
    assert not there.exists()


@pytest.mark.filterwarnings("default")  # asammdf's own
@pytest.mark.parametrize(
    ("head", "got"),
    [
        (b"##DZ", "0 frames, where its groups have"),  # its data
        (b"CAN_DataFrame\0", "a channel without a name"),
    ],
)
def test_an_mf4_that_has_lost_its_data_or_a_name_is_refused(head, got, tmp_path):
    pytest.importorskip("asammdf", reason="needs asammdf: pip install 'f3t-skin[mdf]'")
    whole = (Path(__file__).parents[2] / "golden/logs/seeds/seed.mf4").read_bytes()
    path = tmp_path / "some.mf4"
    at = whole.index(head)
    path.write_bytes(whole[:at] + bytes(len(head)) + whole[at + len(head) :])
    with pytest.raises(LogError, match=got):
        list(read(path))


def test_a_file_that_keeps_its_reader_busy_is_refused(tmp_path, monkeypatch):
    (tmp_path / "asammdf.py").write_text("def MDF(path):\n    while True:\n        pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "asammdf", raising=False)
    monkeypatch.setattr(mdf, "_SECONDS", 0.5)
    path = tmp_path / "some.mf4"
    path.write_bytes(b"MDF     4.10")
    with pytest.raises(LogError, match="must be a whole MDF 4 file; got: more computing than"):
        list(read(path))


def test_mf4_without_asammdf_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    path = tmp_path / "some.mf4"
    path.write_bytes(b"MDF     4.10")
    with pytest.raises(LogError, match=r"pip install 'f3t-skin\[mdf\]'"):
        read_all(path)
