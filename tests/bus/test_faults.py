"""Fault injection: what was put in is what is counted, and no wrong value gets through."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bus.open
import topology
from bus import Assembler, FrameBatch, MemoryTransport, Status
from bus.errors import FaultScriptError
from bus.faults import FaultScript, FaultyTransport, Injector, load_script
from bus.faults import script as kinds
from bus.frame import CAN_ERR, CAN_RTR, ECHO, FRAME_DTYPE
from bus.state import BusState
from skin.cli import main
from tests.bus.transport_contract import CHECKS
from tests.fixtures.bus import counts_of, data_frames, frame, join, make_topology, sync
from tests.fixtures.patience import LONG_S
from tests.topology.test_messages import check_golden

PERIOD_NS = 10_000_000
LAYOUTS = ["f3t-classic", "f3t-fd16", "f3t-fd64"]


def cycles_of(skin, count, start=0):
    """SYNC and data of `count` cycles, with counts that differ from cycle to cycle."""
    parts = []
    for number in range(start, start + count):
        stamp_ns = 1_000_000_000 + number * PERIOD_NS
        parts.append(sync(number, stamp_ns=stamp_ns))
        parts.append(data_frames(skin, number, number & 0xFF, stamp_ns=stamp_ns + 1000))
    return join(*parts)


def inject(fault, records, skin=None, seed=0):
    """Frames past one fault, and how often it struck."""
    injector = Injector(FaultScript(faults=(fault,)), seed, skin)
    out = injector(records)
    (count,) = injector.injected.values()
    return out, count


def assemble(skin, records):
    """Copies of the cycles of these frames, and the counters."""
    assembler = Assembler(skin)
    cycles = [
        (c.number, c.counts.copy(), c.valid.copy(), c.status.copy())
        for c in assembler.feed(records)
    ]
    return cycles, assembler.counters


# -- what is put in is what is counted -------------------------------------------------------------

SOME = {"probability": 0.1, "from_s": 0.05, "to_s": 0.4}
ONE = {"units": ("patch/3",), "from_s": 0.1}
COUNTED = [
    # layout, fault, what counts it, and what flags its units in the end
    ("f3t-fd64", kinds.Drop(**SOME), "lost", Status.OK),
    ("f3t-classic", kinds.Drop(**SOME), "lost", Status.OK),
    ("f3t-fd64", kinds.Kill(**ONE, to_s=0.15), "lost", Status.OK),
    ("f3t-fd64", kinds.Delay(delay_s=0.012, **SOME), "late", Status.OK),
    ("f3t-fd64", kinds.Corrupt(**SOME), "crc", Status.OK),
    ("f3t-fd64", kinds.Corrupt(bits=3, **SOME), "crc", Status.OK),
    ("f3t-fd64", kinds.Truncate(**SOME), "short", Status.OK),
    ("f3t-classic", kinds.Truncate(**SOME), "short", Status.OK),
    ("f3t-fd64", kinds.Babble(id=0x7F1, **SOME), "foreign", Status.OK),
    ("f3t-fd64", kinds.Duplicate(**ONE), "repeated", Status.DUPLICATE),
    ("f3t-fd64", kinds.Duplicate(first=True, **ONE), "repeated", Status.DUPLICATE),
    ("f3t-fd64", kinds.Error(**SOME), "error", Status.OK),
    ("f3t-fd64", kinds.Error(what="overflow", **SOME), "controller_overflow", Status.OK),
    ("f3t-classic", kinds.Kill(**ONE), None, Status.STALE),
    ("f3t-fd64", kinds.Freeze(**ONE), None, Status.FROZEN),
]


@pytest.mark.parametrize(("layout", "fault", "counter", "flag"), COUNTED)
def test_every_fault_is_counted_and_no_wrong_value_gets_through(layout, fault, counter, flag):
    skin = make_topology(layout, 10, frozen_cycles=5)
    records, count = inject(fault, cycles_of(skin, 60), skin, 1)
    cycles, counters = assemble(skin, records)
    if counter is not None:
        assert getattr(counters, counter) == count > 0
    hit = np.zeros(skin.n, bool)
    carried = [skin.layouts[0].carries(name) for name in topology.CHANNELS]
    for number, counts, valid, _ in cycles:
        wrong = (counts != counts_of(skin, number))[carried].any(axis=0) & valid
        hit |= wrong
        assert flag & (Status.DUPLICATE | Status.FROZEN) or not wrong.any()
    assert ((cycles[-1][3] & int(flag)) != 0)[hit].all()
    assert (flag == Status.OK) or (cycles[-1][3][3] & int(flag))


SEEN_AT_ONCE = st.one_of(
    st.builds(kinds.Drop, probability=st.floats(0.01, 0.5)),
    st.builds(kinds.Kill, at_s=st.floats(0, 0.5), count=st.integers(1, 40)),
    st.builds(kinds.Delay, delay_s=st.floats(1e-4, 0.1), probability=st.floats(0.01, 0.5)),
    st.builds(kinds.Corrupt, bits=st.integers(1, 3), probability=st.floats(0.01, 0.5)),
    st.builds(kinds.Truncate, probability=st.floats(0.01, 0.5)),
    st.builds(kinds.Babble, id=st.integers(0x200, 0x7FF), every=st.integers(1, 9)),
    st.builds(kinds.Error, what=st.sampled_from(sorted(kinds.ERRORS)), every=st.integers(1, 9)),
    st.builds(kinds.Drop, ids=st.just((0x80,)), probability=st.floats(0.01, 0.3)),
)


@given(st.lists(SEEN_AT_ONCE, min_size=1, max_size=5), st.integers(0, 2**32))
def test_whatever_befalls_the_frames_a_valid_value_is_the_one_that_was_sent(faults, seed):
    skin = make_topology("f3t-fd64", 10)
    script = FaultScript(faults=tuple(faults))
    records = Injector(script, seed, skin)(cycles_of(skin, 60))
    cycles, counters = assemble(skin, records)
    for number, counts, valid, _ in cycles:
        assert (counts[:, valid] == counts_of(skin, number)[:, valid]).all()
    of_frames = {
        k: v for k, v in vars(counters).items() if k not in ("lost", "controller_overflow")
    }
    assert sum(of_frames.values()) == records.size, "every frame is counted once"


# -- a transport like any other --------------------------------------------------------------------


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_without_faults_the_wrapper_keeps_the_contract(check):
    ends = [FaultyTransport(end, FaultScript()) for end in MemoryTransport.pair(index=3)]
    with ends[0], ends[1]:
        check(*ends)


def test_a_script_goes_by_the_clock_that_it_is_given_and_not_by_stamps():
    """Stamps of a host that was late, or hung for a minute: the same frames are lost."""
    rng, lost = np.random.default_rng(4), []
    fault = kinds.Drop(from_s=0.2, to_s=0.5, every=3)
    for hung_ns in (0, 3_000_000, 60_000_000_000):
        now = [0]
        script = Injector(FaultScript(faults=(fault,)), clock=lambda now=now: now[0])
        stamp_ns, kept = 10**18, []
        for number in range(80):
            now[0] = number * PERIOD_NS
            stamp_ns += PERIOD_NS + int(rng.integers(0, hung_ns + 1))
            kept += [number] if script(frame(0x100, stamp_ns=stamp_ns)).size else []
        lost.append(sorted(set(range(80)) - set(kept)))
    assert lost == [list(range(22, 50, 3))] * 3


def test_error_frames_put_in_change_the_state():
    script = FaultScript(faults=(kinds.Error(what="bus-off", at_s=0.0),))
    near, far = MemoryTransport.pair()
    with near, FaultyTransport(far, script) as host:
        batch = FrameBatch(4)
        near.send(frame(0x1, stamp_ns=1))
        host.receive(batch)
        assert host.state is BusState.BUS_OFF
        near.send(frame(0x1, stamp_ns=2))
        host.receive(batch)
        assert host.state is BusState.ACTIVE
        assert [change.state for change in host.changes] == [BusState.BUS_OFF, BusState.ACTIVE]
        assert (host.counters.error_frames, host.counters.ring_overflows) == (1, 0)
        near.send(np.repeat(frame(0x1), 9000))
        assert host.counters.ring_overflows == far.counters.ring_overflows > 0


def test_a_bus_that_goes_away_is_told_through_the_wrapper():
    near, far = MemoryTransport.pair()
    with near, FaultyTransport(far, FaultScript()) as host:
        far._enter(BusState.GONE, "unplugged")
        host.receive(FrameBatch(1))
        assert host.state is BusState.GONE


def test_a_direction_that_is_none_is_refused():
    near, far = MemoryTransport.pair()
    with near, far, pytest.raises(ValueError, match="'receive' or 'send'; got 'both'"):
        FaultyTransport(far, FaultScript(), direction="both")


# -- which frames ----------------------------------------------------------------------------------


@given(st.lists(SEEN_AT_ONCE, min_size=1, max_size=4), st.integers(0, 99), st.data())
def test_the_seed_and_the_frames_decide_not_the_batches(faults, seed, data):
    skin = make_topology("f3t-fd16", 3)
    script, records = FaultScript(seed=seed, faults=tuple(faults)), cycles_of(skin, 25)
    whole = Injector(script, topology=skin)(records)
    cuts = sorted(data.draw(st.lists(st.integers(0, records.size), max_size=4)))
    pieces = Injector(script, topology=skin)
    parts = [pieces(part) for part in np.split(records, cuts)]
    assert (np.concatenate(parts) == whole).all()


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (kinds.Drop(every=3), [2, 5, 8]),
        (kinds.Drop(every=3, count=2), [2, 5]),
        (kinds.Drop(from_s=0.2, to_s=0.5), [2, 3, 4]),
        (kinds.Drop(at_s=0.65), [7]),
        (kinds.Drop(at_s=0.65, count=2), [7, 8]),
        (kinds.Drop(ids=(0x124,)), []),
        (kinds.Drop(ids=(0x123,), probability=1.0), list(range(10))),
    ],
)
def test_frames_are_hit_when_the_script_says(fault, expected):
    records = join(*(frame(0x123, [i], stamp_ns=10**9 + i * 10**8) for i in range(10)))
    left, count = inject(fault, records)
    assert sorted(set(range(10)) - {int(r["data"][0]) for r in left}) == expected
    assert count == len(expected)


def test_only_data_frames_of_others_are_hit():
    records = join(frame(CAN_ERR | 4, b"\0\1"), frame(CAN_RTR | 0x100), frame(0x100, origin=ECHO))
    left, count = inject(kinds.Drop(), records)
    assert (left["id"] == records["id"]).all()
    assert count == 0


def test_units_and_patches_name_the_frames_that_carry_them():
    hand = topology.load("hand")
    ids = {}
    for name in ("palm/r0c0", "palm", "thumb"):
        for index in (0, 1):
            here = hand.frames.bus == index
            records = np.zeros(here.sum(), FRAME_DTYPE)
            records["id"], records["stamp_ns"] = hand.frames.can_id[here], 1
            script = FaultScript(faults=(kinds.Drop(units=(name,)),))
            injector = Injector(script, topology=hand, index=index)
            injector(records)
            ids[name, index] = injector.injected["drop"]
    assert ids == {("palm/r0c0", 0): 1, ("palm/r0c0", 1): 0, ("palm", 0): 13, ("palm", 1): 0,
                   ("thumb", 0): 0, ("thumb", 1): 3}  # fmt: skip


def test_a_bus_by_name_spares_the_others():
    hand = topology.load("hand")
    script = FaultScript(faults=(kinds.Drop(bus="fingers"),))
    records = frame(int(hand.frames.can_id[0]), stamp_ns=1)
    assert Injector(script, topology=hand, index=0)(records).size == 1
    assert Injector(script, topology=hand, index=1)(records).size == 0


# -- what each kind does ---------------------------------------------------------------------------


@pytest.mark.parametrize("layout", [*LAYOUTS, "xela-uskin", "icub-skin"])
def test_a_frozen_unit_holds_its_counts_alone_under_a_running_sequence(layout):
    units = 12 if layout == "icub-skin" else 5
    skin = make_topology(layout, units)
    records, count = inject(
        kinds.Freeze(units=("patch/1",), from_s=0.025), cycles_of(skin, 8), skin
    )
    cycles, counters = assemble(skin, records)
    assert counters.crc == counters.repeated == counters.lost == 0
    assert count == 5
    others = np.arange(units) != 1
    truth, _ = assemble(skin, cycles_of(skin, 8))
    for (number, counts, valid, _), (_, sent, _, _) in zip(cycles, truth, strict=True):
        assert valid.all()
        assert (counts[:, others] == sent[:, others]).all()
        assert (counts[:, 1] == truth[min(number, 2)][1][:, 1]).all()


def wrong_counts(sent, fault):
    """What a fault makes of the counts of a channel, shape (t,), from the numbers alone."""
    if isinstance(fault, kinds.Gain):
        return np.clip(np.round(fault.gain * sent.astype(float)), -32768, 32767)
    if isinstance(fault, kinds.Offset):
        return np.clip(sent.astype(int) + fault.counts, -32768, 32767)
    return np.full(sent.shape, fault.counts)


@pytest.mark.parametrize("channel", ["bx", None])
@pytest.mark.parametrize(
    ("kind", "how"),
    [
        (kinds.Gain, {"gain": -1000.0}),
        (kinds.Offset, {"counts": 65535}),
        (kinds.Stuck, {"counts": 123}),
    ],
)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_wrong_channel_comes_whole_and_on_time(layout, kind, how, channel):
    skin, order = make_topology(layout, 5), kind(units=("patch/1",), channel=channel, **how)
    records, count = inject(order, cycles_of(skin, 8), skin)
    cycles, counters = assemble(skin, records)
    truth, _ = assemble(skin, cycles_of(skin, 8))
    assert 8 <= count <= 8 * skin.layouts[0].parts
    assert counters.crc == counters.repeated == counters.lost == counters.torn == 0
    shown = np.stack([counts for _, counts, _, _ in cycles])
    sent = np.stack([counts for _, counts, _, _ in truth])
    assert all(valid.all() for _, _, valid, _ in cycles)
    for row, name in enumerate(topology.CHANNELS):
        carried = any(s.name == name for s in skin.layouts[0].signals)
        expected = sent[:, row].copy()
        if carried and channel in (None, name):
            low, high = next(s.rails for s in skin.layouts[0].signals if s.name == name)
            expected[:, 1] = np.clip(wrong_counts(sent[:, row, 1], order), low, high)
        np.testing.assert_array_equal(shown[:, row], expected)


def test_a_wrong_channel_needs_a_topology():
    with pytest.raises(FaultScriptError, match="without need of a topology"):
        Injector(FaultScript(faults=(kinds.Gain(gain=2.0),)))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_second_sender_has_other_counts_and_a_fitting_crc(layout):
    skin = make_topology(layout, 5)
    records, count = inject(kinds.Duplicate(first=True), cycles_of(skin, 5), skin)
    cycles, counters = assemble(skin, records)
    assert counters.crc == 0
    assert counters.repeated == count == 5 * len(skin.frames)
    for number, counts, _, _ in cycles:
        wired = [0, 1, 2, 3, 4] + [5] * (layout != "f3t-classic")
        assert (counts != counts_of(skin, number))[wired].all()


def test_a_delayed_frame_comes_with_the_first_traffic_after_its_time():
    records = join(*(frame(0x100 + i, stamp_ns=10**9 + i * 1000) for i in range(5)))
    late, _ = inject(kinds.Delay(ids=(0x101,), delay_s=1.5e-6), records)
    assert late["id"].tolist() == [0x100, 0x102, 0x101, 0x103, 0x104]
    assert late["stamp_ns"][2] == 10**9 + 2500


@given(st.binary(max_size=64), st.integers(0, 64), st.integers(0, 255), st.integers(0, 2**32 - 1))
def test_no_frame_of_any_content_raises(data, length, origin, can_id):
    record = frame(can_id, data, stamp_ns=-(2**63), origin=origin)
    record["length"] = length
    skin = make_topology("f3t-fd16", 2)
    faults = (kinds.Corrupt(), kinds.Truncate(), kinds.Freeze(), kinds.Duplicate())
    faults += (kinds.Delay(delay_s=1.0), kinds.Babble(id=5))
    injector = Injector(FaultScript(faults=faults), topology=skin)
    injector(join(record, record, frame(0x100, data, stamp_ns=2**63 - 1)))


# -- scripts ---------------------------------------------------------------------------------------


def test_a_script_from_a_file_is_the_one_in_python(tmp_path):
    path = tmp_path / "faults.toml"
    path.write_text(
        'format = 1\nseed = 7\n[[faults]]\nkind = "drop"\nprobability = 0.01\n'
        '[[faults]]\nkind = "freeze"\nunits = ["palm/r0c3"]\nfrom_s = 2\nto_s = 5.0\n'
    )
    palm = topology.load("palm")
    expected = FaultScript(
        seed=7,
        faults=(
            kinds.Drop(probability=0.01),
            kinds.Freeze(units=("palm/r0c3",), from_s=2.0, to_s=5.0),
        ),
    )
    assert load_script(path, palm) == expected
    near, far = MemoryTransport.pair()
    with near, FaultyTransport(far, path, topology=palm) as host:
        assert host.injected == {"drop": 0, "freeze": 0}


BROKEN = {
    "keys": 'format = 2\nsead = 1\n[[faults]]\nkind = "dorp"\n[[faults]]\nkind = "delay"\n'
    '[[faults]]\nkind = "error"\nwhat = "overfow"\n[[faults]]\nkind = "drop"\nprobability = 1.5\n',
    "names": '[[faults]]\nkind = "drop"\nunits = ["palm/r0c33", "plam"]\nbus = "mian"\n'
    '[[faults]]\nkind = "drop"\nevery = 2\nprobability = 0.5\nat_s = 1\nto_s = 2\n'
    '[[faults]]\nkind = "drop"\nfrom_s = 3\nto_s = 2\n'
    '[[faults]]\nkind = "babble"\nid = 5\nids = [5]\n',
    "syntax": "faults = [\n",
}


def test_a_wrong_script_is_refused_with_every_problem_and_its_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = []
    for name, broken in BROKEN.items():
        Path(f"{name}.toml").write_text(broken)
        with pytest.raises(FaultScriptError) as raised:
            load_script(f"{name}.toml", topology.load("palm"))
        text.append(str(raised.value))
    with pytest.raises(FaultScriptError) as raised:
        load_script("none.toml")
    text.append(str(raised.value))
    faults = (kinds.Freeze(), kinds.Drop(units=("palm",), bus="main"))
    with pytest.raises(FaultScriptError) as raised:
        Injector(FaultScript(faults=faults))
    text.append(str(raised.value))
    check_golden("faults", "".join(f"{each}\n" for each in text))


# -- skin sim --------------------------------------------------------------------------------------


def test_simulated_units_fail_as_their_scene_says(tmp_path, monkeypatch, capsys):
    scene = tmp_path / "lossy.toml"
    scene.write_text('format = 1\nseconds = 9.0\n[[faults]]\nkind = "drop"\nids = [0x100]\n'
                     '[[faults]]\nkind = "error"\n')  # fmt: skip
    near, far = MemoryTransport.pair()
    monkeypatch.setattr(bus.open, "open_transport", lambda _bus, _index: far)
    answers = FrameBatch(64)

    near.send(sync(0))  # waits until it is listened to
    arguments = ["sim", "palm", str(scene), "--bus", "socketcan", "--json"]
    assert main([*arguments, "--seconds", "1"]) == 0
    near.receive(answers, LONG_S)
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["faults"] == {"drop": 1, "error": 12}
    ids = answers.frames["id"]
    assert np.count_nonzero(ids < 0x700) == np.count_nonzero(ids & CAN_ERR) == 12
    assert 0x100 not in ids
    near.close()
