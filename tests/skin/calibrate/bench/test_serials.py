"""Serial numbers of BENCH beside those of heartbeats."""

from __future__ import annotations

import numpy as np

import topology
from bus.boards import Boards, compare_serials, of_boards
from bus.codec import Packer
from bus.frame import FrameBatch
from bus.heartbeat import FIRST_ID, LAYOUT
from bus.logs import LogWriter
from skin.calibrate.bench.series import read_counts
from skin.sim.bench import Lab, protocol

BENCH = {"pad/r0c0": "F3T-1000", "pad/r1c0": "F3T-1001"}


def beats(skin, *serials):
    """Boards that say these numbers, one node after the other."""
    batch, boards = FrameBatch(8), Boards(skin)
    for node, serial in enumerate(serials, 1):
        batch.append(FIRST_ID + node, LAYOUT.pack(1, 5, 1, serial, 0, 0))
    boards.hear(batch.frames, np.zeros(len(batch.frames)))
    return boards


def test_the_log_of_a_bus_tells_the_serial_numbers_of_its_boards(tmp_path):
    skin, batch = Lab(2).nominal, FrameBatch(8)
    counts = Lab(2).counts(protocol(("tare",), 0.1))
    packer = Packer(skin)
    with LogWriter(tmp_path / "run.log") as log:
        for k, cycle in enumerate(counts[:20]):
            batch.clear()
            stamp_ns = 10**9 + k * 20_000_000
            batch.append(skin.sync_id, bytes([k % 256]), stamp_ns=stamp_ns)
            packer(cycle, batch, sequence=k, stamp_ns=stamp_ns)
            if k == 3:
                beat = LAYOUT.pack(1, 5, 1, 1001, 0, 0)
                batch.append(FIRST_ID + 2, beat, stamp_ns=stamp_ns)
            log.write(batch)
    found = read_counts(skin, tmp_path / "run.log")
    assert found.serials == {"pad/r1c0": "1001"}


def test_a_unit_of_a_board_with_several_has_its_place_behind():
    skin = topology.load("palm")
    told = of_boards(skin, beats(skin, 77))
    assert len(told) > 1
    assert list(told.values()) == [f"77/{place}" for place in range(1, len(told) + 1)]
    # a number alone may be the unit's own
    assert compare_serials(dict.fromkeys(told, "F3T-5"), told, {}, "BENCH") == {}
    first = next(iter(told))
    assert compare_serials({first: "78/1"}, told, {}, "BENCH") == {
        first: "serial number: must be 78/1, as BENCH has it; got 77/1 in heartbeats"
    }


def test_units_that_are_exchanged_are_named():
    heard = of_boards(Lab(2).nominal, beats(Lab(2).nominal, 1001, 1000))
    assert compare_serials(BENCH, heard, BENCH, "BENCH") == {
        "pad/r0c0": "serial number: must be F3T-1000, as BENCH has it; got 1001 in heartbeats, "
        "which BENCH has as pad/r1c0",
        "pad/r1c0": "serial number: must be F3T-1001, as BENCH has it; got 1000 in heartbeats, "
        "which BENCH has as pad/r0c0",
    }


def test_another_unit_is_named_and_the_right_one_is_not():
    heard = of_boards(Lab(2).nominal, beats(Lab(2).nominal, 1000, 9))
    assert compare_serials(BENCH, heard, BENCH, "BENCH") == {
        "pad/r0c0": "",
        "pad/r1c0": "serial number: must be F3T-1001, as BENCH has it; got 9 in heartbeats",
    }
    given = {"pad/r0c0": "", "pad/r1c0": "F3T-0009"}
    assert compare_serials(given, heard, {}, "BENCH") == {"pad/r1c0": ""}
