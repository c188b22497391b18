"""The doctor's findings: each provoked, alone, and in words that are kept."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace as replace_bus

import topology
from bus import BusClosedError, FrameBatch, MemoryTransport
from bus.diagnose import MOST_REPORTED, diagnose, swapped_buses
from bus.discover import Survey, listen
from bus.faults import FaultScript, FaultyTransport, Injector
from bus.faults import script as kinds
from bus.faults.injector import Payloads
from bus.frame import CAN_EFF, CAN_ERR, ECHO, FD_FDF, FRAME_DTYPE
from bus.transport import Transport
from skin.sim.node import SimulatedUnits
from tests.fixtures.bus import SYNC_ID, data_frames, frame, join, make_topology, sync, with_data_ids
from tests.topology.test_messages import check_golden

PERIOD_NS = 10_000_000
START_NS = 1_700_000_000_000_000_000
HEARTBEATS = frame(0x701, bytes(8), stamp_ns=START_NS)


def traffic(skin, cycles=100, *, syncs=True, own=False, period_ns=PERIOD_NS):
    """A healthy bus: SYNC, if there is one, and data of every cycle."""
    parts = []
    for number in range(cycles):
        stamp_ns = START_NS + number * period_ns
        for b in range(len(skin.buses)):
            if skin.sync_id is not None and syncs:
                parts.append(sync(number, bus=b, stamp_ns=stamp_ns))
                parts[-1]["origin"] = ECHO * own
        parts.append(data_frames(skin, number, number & 0xFF, stamp_ns=stamp_ns + 1000))
    return join(*parts)


def hurt(skin, records, *faults):
    """Frames past some faults, bus by bus."""
    script, out = FaultScript(faults=faults), []
    for b in range(len(skin.buses)):
        out.append(Injector(script, 1, skin, index=b)(records[records["bus"] == b]))
    whole = join(*out)
    return whole[np.argsort(whole["stamp_ns"], kind="stable")]


def survey_of(skin, records, **options):
    survey = Survey(skin, **options)
    survey.feed(records)
    survey.finish()
    return survey


def on_boards(units=20, **options):
    """Boards of five units on CAN FD."""
    return make_topology("f3t-fd64", units, **options)


def cases():
    """Name, skin and frames of every trouble, alone."""
    fd16, boards, two = make_topology("f3t-fd16", 6), on_boards(), on_boards(buses=2)
    one, last = (0x100,), tuple(int(i) for i in boards.frames.can_id[2:])
    for name, fault in (
        ("missing-unit", kinds.Kill(units=("patch/2",))),
        ("missing-unit, later", kinds.Kill(units=("patch/2",), from_s=0.6)),
        ("bus-errors", kinds.Error(what="passive", every=50)),
        ("unknown-id, a babbling node", kinds.Babble(id=0x10, ids=one)),
        ("wrong-length", kinds.Truncate(length=8, ids=(0x101,))),
        ("wrong-length, some", kinds.Truncate(length=8, ids=(0x101,), every=4, to_s=0.9)),
        ("wrong-rate", kinds.Drop(every=2, ids=(0x104,))),
        ("duplicate-id", kinds.Duplicate(ids=(0x102,))),
        ("intermittent", kinds.Kill(ids=(0x103,), from_s=0.2, to_s=0.7)),
        ("sequence-gaps", kinds.Drop(probability=0.05, to_s=0.9)),
        ("sequence-gaps, one unit", kinds.Drop(probability=0.1, to_s=0.9, ids=one)),
        ("crc", kinds.Corrupt(probability=0.1, to_s=0.9, ids=(0x105,))),
        ("late", kinds.Delay(delay_s=0.012, every=9, to_s=0.9)),
        ("controller-overflow", kinds.Error(what="overflow", at_s=0.3)),
    ):
        yield name, fd16, hurt(fd16, traffic(fd16), fault)
    for name, start in (("silent-branch", {}), ("silent-branch, later", {"from_s": 0.5})):
        yield name, boards, hurt(boards, traffic(boards), kinds.Kill(ids=last, **start))
    hand = topology.load("hand")
    records = traffic(hand, 60, period_ns=4_000_000)
    yield "silent-branch, a patch", hand, hurt(hand, records, kinds.Kill(units=("index",)))
    swapped = traffic(hand, 40, period_ns=4_000_000)
    swapped["bus"] = 1 - swapped["bus"]
    yield "swapped-buses", hand, swapped
    yield "silent-bus", two, join(_without_data(two, traffic(two), 1), _on(HEARTBEATS, 1))
    nothing = np.zeros(0, FRAME_DTYPE)
    yield "no-traffic", fd16, nothing
    yield "no-traffic, another interface", _changed(fd16, interface="socketcan"), nothing
    yield "wrong-bitrate", fd16, np.repeat(frame(CAN_ERR | 0x88, bytes(8), stamp_ns=START_NS), 70)
    strange = join(*(frame(0x400, b"abc", stamp_ns=START_NS + i) for i in range(7)))
    strange = join(strange, frame(CAN_EFF | 0x1FFF, b"", stamp_ns=START_NS))
    yield "unknown-id", fd16, join(traffic(fd16), strange)
    records = traffic(fd16)
    records["id"][records["id"] == 0x103] = 0x123
    yield "unknown-id, a wrong address", fd16, records
    pair = with_data_ids(make_topology("f3t-fd16", 6, buses=2), [1, 2, 3, 4, 5, 6])
    records = traffic(pair)
    records["bus"][records["id"] == 2] = 1
    yield "unknown-id, a unit on the wrong bus", pair, records
    records = traffic(fd16)
    records["flags"] &= ~np.uint8(FD_FDF)
    records["length"] = np.minimum(records["length"], 8)
    yield "fd-mismatch", fd16, records
    classic = make_topology("f3t-classic", 3)
    records = traffic(classic)
    records["flags"][records["id"] == 0x101] = FD_FDF
    yield "fd-mismatch, one", classic, records
    free = make_topology("f3t-fd16", 3, sync_id=None)
    records = traffic(free, 400, period_ns=PERIOD_NS // 4)
    slow = records[(records["id"] != 0x101) | (np.arange(records.size) // 3 % 2 == 0)]
    mine = slow["id"] == 0x101
    slow[mine] = _renumbered(free, slow[mine])
    yield "wrong-rate, without SYNC", replace(free, cycle_rate_hz=400.0), slow
    yield "wrong-rate, SYNC", fd16, traffic(fd16, period_ns=PERIOD_NS * 2)
    yield "no-sync", fd16, traffic(fd16, syncs=False)
    twice = hurt(free, traffic(free), kinds.Duplicate(ids=(0x102,), offset=90))
    yield "duplicate-id, counting for themselves", free, twice
    skin = make_topology("f3t-fd16", 4, frozen_cycles=20)
    yield "frozen", skin, hurt(skin, traffic(skin), kinds.Freeze(ids=(0x101,), from_s=0.2))
    parts = []
    for n in range(50):
        stamp_ns = START_NS + n * PERIOD_NS
        codes = np.array([0, 0, 0, 9 if n > 10 else 0, 0, 0], np.uint8)
        parts += [sync(n, stamp_ns=stamp_ns),
                  data_frames(fd16, n, n, stamp_ns=stamp_ns, fault_code=codes)]  # fmt: skip
    yield "unit-fault", fd16, join(*parts)


def _on(records, bus):
    moved = records.copy()
    moved["bus"] = bus
    return moved


def _without_data(skin, records, bus):
    sync_id = skin.sync_id
    return records[(records["bus"] != bus) | (records["id"] == sync_id)]


def _changed(skin, **changes):
    return replace(skin, buses=tuple(replace_bus(bus, **changes) for bus in skin.buses))


def _renumbered(skin, records):
    """The same frames with sequence numbers that count on without a gap."""
    payloads, out = Payloads(skin, 0), records.copy()
    for n in range(out.size):
        payloads.rewrite(out[n : n + 1], lambda *given: given[-1], n - int(out["data"][n, 0]))
    return out


def test_every_trouble_is_found_and_nothing_else():
    lines = []
    for name, skin, records in cases():
        found = diagnose(survey_of(skin, records))
        lines += [f"[{name}]", *(f"{finding.code}: {finding}" for finding in found), ""]
    check_golden("doctor", "".join(f"{line}\n" for line in lines[:-1]))


@pytest.mark.parametrize("layout", ["f3t-classic", "f3t-fd16", "f3t-fd64", "icub-skin"])
@pytest.mark.parametrize("sync_id", [0x80, None])
def test_of_a_healthy_bus_nothing_is_found(layout, sync_id):
    skin = make_topology(layout, 24, sync_id=sync_id)
    assert diagnose(survey_of(skin, traffic(skin))) == []


def test_the_own_sync_and_disabled_units_are_no_finding():
    skin = make_topology("f3t-fd16", 4, enabled=[True, False, True, True])
    records = hurt(skin, traffic(skin, own=True), kinds.Kill(units=("patch/1",)))
    assert diagnose(survey_of(skin, records, sends_sync=True)) == []


@pytest.mark.parametrize("sends", [False, True])
def test_a_canopen_master_beside_ours_is_named_and_nothing_else(sends):
    skin = make_topology("f3t-fd16", 4)
    records = traffic(skin)
    is_ours = records["id"] == SYNC_ID
    records["origin"][is_ours] = ECHO * sends
    empty = records[is_ours].copy()
    empty["length"] = empty["origin"] = 0
    place = np.flatnonzero(is_ours)
    findings = diagnose(survey_of(skin, np.insert(records, place + 2, empty), sends_sync=sends))
    assert [finding.code for finding in findings] == ["foreign-sync"]
    assert findings[0].count == 100
    assert "CANopen master" in findings[0].likely_cause


def test_a_second_sender_of_sync_is_found():
    skin = make_topology("f3t-fd16", 4)
    (finding,) = diagnose(survey_of(skin, traffic(skin), sends_sync=True))
    assert finding.code == "second-sync"
    assert finding.count == 100


@pytest.mark.parametrize("wrong", [(), (0,), (0, 1), (0, 2)])
def test_only_buses_that_hear_each_other_are_swapped(wrong):
    """Four buses, of which some hear the next one's units, each besides a unit of its own gone."""
    skin = with_data_ids(make_topology("f3t-fd16", 12, buses=4), list(range(1, 13)))
    records = traffic(skin, 30)
    heard_on = {b: b for b in range(4)} | dict(zip(wrong, (*wrong[1:], *wrong[:1]), strict=True))
    records["bus"] = np.array([heard_on[b] for b in range(4)])[records["bus"]]
    records = records[(records["id"] % 3 != 0) | (records["id"] == 0x80)]
    survey = survey_of(skin, records)
    instead = {heard_on[b]: b for b in range(4) if heard_on[b] != b}
    assert swapped_buses(survey) == instead
    codes = [finding.code for finding in diagnose(survey)]
    assert codes.count("swapped-buses") == (len(wrong) > 1)
    assert codes.count("missing-unit") == 4 - len(instead)


def test_findings_are_counted_not_repeated():
    skin = make_topology("f3t-fd16", 6)
    strange = (frame(0x300 + i, b"", stamp_ns=START_NS) for i in range(500))
    found = diagnose(survey_of(skin, join(traffic(skin), *strange)))
    assert len(found) == MOST_REPORTED
    assert sum(finding.count for finding in found) == 500
    assert str(found[-1]).startswith("493 more: the same as above, 493 in all. Likely cause: ")


def test_a_survey_stays_small_whatever_comes():
    skin = make_topology("f3t-fd16", 2)
    survey = Survey(skin)
    records = np.zeros(20_000, FRAME_DTYPE)
    records["id"] = CAN_EFF | np.arange(20_000)
    errors = np.zeros(5000, FRAME_DTYPE)
    errors["id"] = CAN_ERR | np.arange(5000)
    survey.feed(join(records, errors))
    assert len(survey.heard) + survey.more_kinds == 20_000
    assert len(survey.heard) == 4096 >= len(survey.errors[0]) - 1
    assert sum(finding.count for finding in diagnose(survey) if finding.code == "unknown-id") == (
        20_000
    )


@given(st.data())
def test_no_frames_of_any_content_raise(data):
    skin = make_topology(data.draw(st.sampled_from(["f3t-classic", "f3t-fd16"])), 3, buses=2)
    raw = data.draw(st.binary(min_size=0, max_size=80 * 6))
    records = np.frombuffer(raw[: len(raw) // 80 * 80], FRAME_DTYPE).copy()
    ids = st.sampled_from([0x80, 0x100, 0x101, 0x701, CAN_ERR | 4])
    for record in records:
        if data.draw(st.booleans()):
            record["id"], record["bus"] = data.draw(ids), data.draw(st.integers(0, 2))
    survey = survey_of(skin, join(records, traffic(skin, 3), records))
    for finding in diagnose(survey):
        assert str(finding)


# -- live ------------------------------------------------------------------------------------------


def open_skin():
    """The host's ends of simulated units, and the nodes."""
    skin = topology.load("strip")
    nodes = SimulatedUnits(skin, seed=2)
    pairs = [MemoryTransport.pair(i) for i in range(len(skin.buses))]
    nodes.attach([far for _, far in pairs])
    return skin, nodes, [near for near, _ in pairs]


def test_live_units_that_work_give_no_finding():
    skin, nodes, ends = open_skin()
    survey, seconds = Survey(skin), 0.4
    while survey.cycles < 3:  # a busy machine takes longer
        survey = Survey(skin)
        listen(survey, ends, seconds)
        seconds *= 2.0
    nodes.close()
    assert [f for f in diagnose(survey, ends) if f.severity == "error"] == []


def test_a_live_listener_does_not_send_sync_unless_told():
    skin, nodes, ends = open_skin()
    survey = Survey(skin)
    listen(survey, ends, 0.1, sync="bus")
    nodes.close()
    assert ends[0].counters.sent == nodes.served.cycles == 0
    assert [finding.code for finding in diagnose(survey, ends)] == ["no-traffic"]


def test_losses_of_this_host_are_found():
    skin = make_topology("f3t-fd16", 4)
    near, far = MemoryTransport.pair(capacity=100)
    with near, far:
        near.send(traffic(skin))
        batch = FrameBatch(500)
        far.receive(batch)
        survey = survey_of(skin, batch.frames)
        found = {finding.code: finding for finding in diagnose(survey, [far])}
        assert found["host-overflow"].count == 400 == far.counters.ring_overflows


def test_a_bus_that_is_off_is_found():
    skin = make_topology("f3t-fd16", 4)
    script = FaultScript(faults=(kinds.Error(what="bus-off", at_s=0.985),))
    near, far = MemoryTransport.pair()
    with near, FaultyTransport(far, script, 1, skin) as host:
        records = traffic(skin)
        near.send(records[records["id"] != 0x103])
        batch = FrameBatch(1024)
        host.receive(batch)
        host.state = type(host.state).BUS_OFF
        found = {f.code: str(f) for f in diagnose(survey_of(skin, batch.frames), [host])}
    assert "bus-off" in found["bus-state"]


class _Unplugged(Transport):
    """An interface that goes away."""

    def receive(self, batch, timeout_s=0.0):
        raise BusClosedError("can0: unplugged")

    def send(self, records):
        return records.size

    def close(self):
        pass


class _Full(MemoryTransport):
    """An interface that has no room for what is sent."""

    def send(self, records):
        return 0


def test_a_sync_that_is_not_taken_is_a_finding_and_no_sync():
    skin = make_topology("f3t-fd16", 4)
    survey = Survey(skin)
    with _Full("full") as host:
        listen(survey, [host], 0.05)
    assert survey.unsent[0] >= 1
    assert survey.syncs[0] == 0
    (found,) = [str(f) for f in diagnose(survey) if f.code == "unsent-sync"]
    assert "not taken by the interface" in found


def test_an_interface_that_goes_away_is_a_finding():
    skin = make_topology("f3t-fd16", 4)
    survey = Survey(skin)
    listen(survey, [_Unplugged()], 5.0)
    assert "can0: unplugged" in str(diagnose(survey)[0])
