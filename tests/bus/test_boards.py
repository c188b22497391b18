"""What the doctor makes of heartbeats: each trouble provoked, alone, in words that are kept."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import Assembler, FrameCounters
from bus.diagnose import diagnose
from bus.diagnose_bus import identities
from bus.discover import Survey
from bus.frame import CAN_EFF, CAN_RTR, ECHO, FD_FDF
from bus.heartbeat import (
    COMMAND_ID,
    FIRST_ID,
    LAST_ID,
    LAYOUT,
    STATES,
    heartbeat_nodes,
    node_numbers,
)
from tests.fixtures.bus import PERIOD_NS, data_frames, frame, join, make_topology, sync
from tests.topology.test_messages import check_golden
from topology import LAYOUTS, WireLayout, load

START_NS = 1_700_000_000_000_000_000
SECOND_NS = 1_000_000_000
OWN = WireLayout(name="own", size=8, signals=LAYOUTS["f3t-classic"].signals)


def data_of(skin, seconds, *, without=()):
    """SYNC and data of a healthy bus, but for some (bus, identifier)."""
    parts = []
    for number in range(round(seconds * 1e9 / PERIOD_NS)):
        stamp_ns = START_NS + number * PERIOD_NS
        parts += [sync(number, bus=b, stamp_ns=stamp_ns) for b in range(len(skin.buses))]
        parts.append(data_frames(skin, number, number & 0xFF, stamp_ns=stamp_ns + 1000))
    whole = join(*parts)
    keys = zip(whole["bus"].tolist(), whole["id"].tolist(), strict=True)
    return whole[[key not in without for key in keys]]


def beats(node, *, bus=0, serial=None, state="running", seconds=4, late_ns=0,
          firmware=1):  # fmt: skip
    """The heartbeats of a node, once a second."""
    serial = bus << 8 | node if serial is None else serial
    return join(
        *(
            frame(
                FIRST_ID + node,
                LAYOUT.pack(STATES.index(state), second, firmware, serial, 0, 0),
                bus=bus,
                stamp_ns=START_NS + second * SECOND_NS + late_ns,
            )
            for second in range(seconds)
        )
    )


def all_beats(skin, *, but=()):
    """The heartbeats of every board of a skin, but for some (bus, node)."""
    return join(
        *(
            beats(node, bus=b)
            for b in range(len(skin.buses))
            for node in heartbeat_nodes(skin, b)
            if (b, node) not in but
        )
    )


def found_in(skin, *parts):
    return diagnose(found_with(skin, join(*parts)))


def found_with(skin, records):
    survey = Survey(skin)
    for batch in np.array_split(records[np.argsort(records["stamp_ns"], kind="stable")], 7):
        survey.feed(batch)
    survey.finish()
    return survey


def cases():
    """Name, skin and frames of every trouble, alone."""
    skin = make_topology("f3t-fd64", 20, buses=2)  # two boards on each bus
    data, others = data_of(skin, 4), all_beats(skin, but=[(0, 2)])
    dead = data_of(skin, 4, without=[(1, 0x101)])
    faulty = beats(2, bus=1, state="fault")
    for name, *parts in (
        ("missing-heartbeat, never", data, others),
        ("missing-heartbeat, stopped", data, others, beats(2, seconds=1)),
        ("missing-heartbeat, of all", data, all_beats(skin, but=[(0, 1), (0, 2)])),
        ("missing-heartbeat, another node", data, others, beats(77, serial=2)),
        ("missing-unit of a board that beats", dead, all_beats(skin)),
        ("missing-unit of a dead board", dead, all_beats(skin, but=[(1, 2)])),
        ("unknown-board", data, all_beats(skin), beats(0xDF, serial=9)),
        ("duplicate-node", data, all_beats(skin), beats(2, serial=50, late_ns=300)),
        ("board-fault", data, all_beats(skin, but=[(1, 2)]), faulty),
    ):
        yield name, skin, *parts
    one = make_topology("f3t-fd64", 20)
    ids = [(0, 0x102), (0, 0x103)]
    yield "silent-branch of boards that beat", one, data_of(one, 4, without=ids), all_beats(one)
    four = make_topology("f3t-classic", 4)
    others = join(beats(77, serial=77), beats(78, serial=78), all_beats(four, but=[(0, 2), (0, 3)]))
    yield "unknown-board, two of other numbers", four, data_of(four, 4), others
    known = with_serials("F3T-0001", "F3T-0002", "F3T-0003", "")
    swapped = join(*(beats(n, serial=s) for n, s in enumerate([2, 1, 9, 4], 1)))
    yield "other-serial", known, data_of(known, 4), swapped


def with_serials(*serials):
    """Units with boards of their own, whose calibration files have serial numbers."""
    return dataclasses.replace(make_topology("f3t-classic", len(serials)), serials=serials)


def test_every_trouble_of_a_board_is_found_and_nothing_else():
    lines = []
    for name, skin, *records in cases():
        found = found_in(skin, *records)
        lines += [f"[{name}]", *(f"{finding.code}: {finding}" for finding in found), ""]
    check_golden("doctor-boards", "".join(f"{line}\n" for line in lines[:-1]))


def test_serial_numbers_are_compared_where_both_sides_have_them():
    skin = with_serials("F3T-0001", "no number", "", "7")
    survey = found_with(skin, join(data_of(skin, 0.1), *(beats(n, serial=n) for n in (1, 2, 3))))
    assert identities(survey) == {"patch/0": ""}


@pytest.mark.parametrize("layout", ["f3t-classic", "f3t-fd64", "icub-skin"])
def test_of_boards_that_all_beat_nothing_is_found(layout):
    skin = make_topology(layout, 24)
    assert found_in(skin, data_of(skin, 4), all_beats(skin)) == []


def test_buses_that_are_read_in_turns_do_not_make_time_run_faster():
    skin = make_topology("f3t-fd64", 40, buses=4)
    records = join(data_of(skin, 3.5), all_beats(skin))
    records = records[np.argsort(records["stamp_ns"], kind="stable")]
    survey = Survey(skin)
    for batch in np.array_split(records, 70):
        survey.feed(batch[np.argsort(batch["bus"], kind="stable")])
    survey.finish()
    np.testing.assert_allclose(survey.listened_s, 3.5, atol=0.02)
    assert "missing-heartbeat" not in {finding.code for finding in diagnose(survey)}


def test_nothing_is_missed_before_its_time():
    skin = make_topology("f3t-fd16", 2)
    assert found_in(skin, data_of(skin, 2.4)) == []
    assert {f.code for f in found_in(skin, data_of(skin, 2.6))} == {"missing-heartbeat"}


def test_of_foreign_firmware_heartbeats_are_only_expected_once_they_came():
    skin = make_topology(OWN, 2)
    assert found_in(skin, data_of(skin, 4)) == []
    (finding,) = found_in(skin, data_of(skin, 4), beats(1, seconds=1), beats(2))
    assert finding.subject == "node 1 (0x701) on bus 'bus0'"


def test_what_is_no_heartbeat_says_nothing_of_boards():
    skin = make_topology("f3t-fd16", 2, first_id=0x701)  # its data have these identifiers
    beat = beats(1, seconds=1)
    strange = [beat.copy() for _ in range(5)]
    strange[0]["length"] = 1  # as CANopen's are
    strange[1]["id"] |= CAN_EFF
    strange[2]["id"] |= CAN_RTR
    strange[3]["flags"] = FD_FDF
    strange[4]["origin"] = ECHO
    survey = Survey(make_topology("f3t-fd16", 2))
    survey.feed(join(*strange))
    assert survey.boards.heard == {}
    taken = Survey(skin)
    taken.feed(join(beat, frame(FIRST_ID, bytes(8)), frame(LAST_ID + 1, bytes(8))))
    assert taken.boards.heard == {}


@given(st.integers(0x6F0, 0x7FF))
def test_heartbeats_are_counted_up_to_the_last_node(can_id):
    assembler = Assembler(make_topology("f3t-fd16", 2))
    list(assembler.feed(frame(can_id, bytes(8))))
    assert assembler.counters.heartbeat == (FIRST_ID <= can_id <= LAST_ID)
    assert assembler.counters.configuration == (can_id == LAST_ID + 1)


def test_commands_to_boards_are_not_foreign():
    assembler, record = Assembler(make_topology("f3t-fd16", 2)), frame(COMMAND_ID, bytes(8))
    list(assembler.feed(record))
    record["origin"] = ECHO
    list(assembler.feed(record))
    assert assembler.counters == FrameCounters(configuration=1, echo=1)


def test_boards_are_numbered_on_each_bus():
    hand = load("hand")
    for bus in range(2):
        here = hand.frames.bus == bus
        np.testing.assert_array_equal(node_numbers(hand)[here], np.arange(1, here.sum() + 1))
