"""Every message about a log, as a user reads it.

They stand in `golden/messages/logs.txt`; `UPDATE_GOLDEN=1 pytest tests/test_bus_logs_messages.py`
writes them anew, for a look at the difference before it is committed.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from bus import FRAME_DTYPE, LogError
from bus.logs import LogWriter, blf, read
from bus.logs.candump_kernels import EXPECTED as CANDUMP_EXPECTED
from tests.fixtures.logs import (
    BAD_LINES,
    blf_container,
    blf_file,
    blf_object,
    can_message,
    read_all,
)

GOLDEN = Path(__file__).parents[2] / "golden" / "messages" / "logs.txt"
TWO = can_message(1) + can_message(2)
PACKED = blf_container(TWO)
BAD_FILES = {
    "empty.blf": b"",
    "text.blf": b"(1.0) can0 123#11\n",
    "short.blf": b"LOGG" + bytes(20),
    "head.blf": blf_file()[:100],
    "length.blf": b"LOGG" + bytes(140),
    "signature.blf": blf_file(TWO, b"no object", objects=3),
    "size.blf": blf_file(TWO, blf_object(1, b"", size=3)),
    "header.blf": blf_file(can_message(head=20)),
    "type.blf": blf_file(blf_object(100, bytes(10))),
    "late.blf": blf_file(can_message(stamp=2**63 - 1)),
    "data.blf": blf_file(blf_object(100, bytes(14) + b"\x41" + bytes(70))),
    "cut.blf": blf_file(TWO)[:-3],
    "loose.blf": blf_file(TWO, length=999),
    "inside.blf": blf_file(can_message(), blf_container(TWO + b"no object")),
    "last.blf": blf_file(blf_container(TWO[:-5], packed=False)),
    "nested.blf": blf_file(blf_container(TWO + blf_container(TWO))),
    "container.blf": blf_file(can_message(), blf_container(TWO), objects=3)[:-9],
    "container-head.blf": blf_file(blf_container(TWO))[:170],
    "container-size.blf": blf_file(blf_container(TWO, size=31)),
    "container-large.blf": blf_file(blf_container(TWO, size=1 << 31)),
    "method.blf": blf_file(blf_container(TWO, method=1)),
    "checksum.blf": blf_file(can_message(), PACKED[:-5] + b"?" + PACKED[-4:]),
    "endless.blf": blf_file(blf_container(TWO, packed=False, method=2)),
    "channels.blf": blf_file(*(can_message(channel=k) for k in range(1, 300))),
    "cut.log": b"(1.0) can0 123#11\n(1.1) can0 123#",
    "plain.log.gz": b"(1.0) can0 123#11\n",
    "other.asc": b"(1.0) can0 123#11\n",
    "other.csv": b"time,id\n1,2\n",
    "other.db": b"SQL",
    "other.trc": b"date\n",
    "relative.asc": b"date x\nbase hex  timestamps relative\n",
    "columns.csv": b"timestamp,arbitration_id,extended,remote,error,dlc,data\n1,2\n",
    "some.txt": b"",
    "some.lgo": b"",
    "some": b"",
    "some.db.gz": b"",
}


def damage(path, content, **options):
    path.write_bytes(content)
    try:
        read_all(path, **options)
    except LogError as error:
        return str(error)
    raise AssertionError(f"{path}: nothing is wrong with it")


def test_every_message_is_the_one_that_was_looked_at(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(blf, "inflating", blf.zlib)
    told = [damage(Path("some.log"), content) for content in BAD_LINES]
    wrong = {text for text in CANDUMP_EXPECTED.values() if not any(text in line for line in told)}
    assert wrong == set(), "no line brings these faults about"
    told += [damage(Path(name), content) for name, content in BAD_FILES.items()]
    told.append(damage(Path("some.log"), b"(1.0) can0 123#11\n", buses={"can1": 0}))
    for act in (
        lambda: read("none.log"),
        lambda: LogWriter("some.asc"),
        lambda: LogWriter("some.lgo"),
        lambda: _write(length=9),
        lambda: _write(flags=4, length=65),
        lambda: _write(flags=4, id=1 << 30),
        lambda: _write(bus=9),
        lambda: _write(stamp_ns=-1),
    ):
        with pytest.raises(LogError) as raised:
            act()
        told.append(str(raised.value))
    text = "".join(f"{line}\n" for line in told)
    if os.environ.get("UPDATE_GOLDEN"):
        GOLDEN.write_text(text, "utf-8")
    assert text == GOLDEN.read_text("utf-8")


def _write(**fields):
    record = np.zeros(1, FRAME_DTYPE)
    for name, value in fields.items():
        record[name] = value
    with LogWriter("written.log", channels=["can0"]) as writer:
        writer.write(record)
