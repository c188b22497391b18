"""The live skin: cycles from buses, units that fall silent, options that are refused."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest

import bus
import skin
import skin.sim
import topology
from bus import BusClosedError, FrameBatch
from bus.frame import FRAME_DTYPE
from bus.memory import MemoryTransport
from bus.status import Status
from skin.errors import SkinError
from skin.live import SYNC_BITS
from skin.sim.node import SimulatedUnits
from skin.state import WANTS
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import frames_of, over
from tests.fixtures.logs import read_all

STRIP = topology.load("strip")


def take(opened, count):
    return list(itertools.islice(opened, count))


def topology_of(tmp_path, *changes, base="strip"):
    """A ready-made topology with lines of its file replaced."""
    text = topology.load(base).path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file = tmp_path / f"{base}.toml"
    file.write_text(text)
    return topology.load(file)


@long_after_first("name", ["palm", "fingertip", "hand", "strip"])
def test_every_ready_made_skin_runs_simulated(name):
    with skin.open(name, simulate=True, pace=False) as opened:
        for number, state in enumerate(itertools.islice(opened, 20)):
            assert state.cycle == number
            assert state.closed_by == "complete"
            assert state.units.valid.all()
            assert state.coverage == pytest.approx(1.0)
        assert opened.counters.lost == 0
        assert opened.counters.data == 20 * len(opened.topology.frames)
        assert opened.trouble(state) == {}


def test_a_bus_within_the_process_that_need_not_wait_has_a_time_of_its_own():
    """So that neither faults nor forces hang on how fast this machine is."""
    loaded = topology.load("strip")
    nodes = SimulatedUnits(loaded)
    with over(loaded, nodes.in_process(), pace=False) as opened:
        stamps_ns = [state.stamp_ns for state in take(opened, 50)]
    period_ns = round(1e9 / loaded.cycle_rate_hz)
    assert np.diff(stamps_ns).tolist() == [period_ns] * 49


def test_pace_keeps_the_cycle_rate():
    with skin.open("strip", simulate=True) as strip:
        states = iter(strip)
        started = time.monotonic()  # before the first is due, so that no late one shortens it
        for _ in itertools.islice(states, 31):
            pass
        seconds = time.monotonic() - started
    assert seconds >= 30 / strip.topology.cycle_rate_hz


BROUGHT_ALONG = {
    "contacts": {"displacement", "temperature"},
    "slip": {"displacement", "temperature", "contacts"},
    "shocks": {"displacement", "temperature", "contacts"},
}


@long_after_first("wanted", WANTS)
@pytest.mark.usefixtures("interpreted")
def test_what_is_not_wanted_is_not_there(wanted):
    with skin.open("strip", simulate=True, pace=False, want={wanted}) as strip:
        (state,) = take(strip, 1)
    units = {"temperature": "temperature", "tangential": "tangential", "theta": "theta",
             "displacement": "displacement_mm"}  # fmt: skip
    array = {name: name for name in ("wrench", "centroid", "contacts", "slip")}
    for record, names in ((state.units, units), (state, array)):
        for name, attribute in names.items():
            expected = name == wanted or name in BROUGHT_ALONG.get(wanted, ())
            assert hasattr(record, attribute) == expected, name


def test_silent_bus_is_not_no_touch():
    near, _ = MemoryTransport.pair()
    with over("strip", [near], pace=False) as strip:
        for state in itertools.islice(strip, 8):
            assert not state.units.valid.any()
            assert np.isnan(state.units.force).all()
            assert state.coverage == 0.0
            assert np.isnan(state.centroid).all()
        assert len(strip.trouble(state)) == strip.topology.n


def test_unit_that_dies_ages_and_is_left_out():
    loaded = topology.load("strip")
    near, far = MemoryTransport.pair()
    nodes = SimulatedUnits(loaded, seed=1)
    nodes.attach([far])
    dead = int(loaded.frames.can_id[3])
    unit = int(loaded.frames.units[3, 0])
    answer = far.listener

    with over(loaded, [near], pace=False, options=skin.Options(sweeps=0, ambient=False)) as strip:
        states = iter(strip)
        for _ in range(5):
            state = next(states)
        assert state.units.status[unit] == Status.UNCALIBRATED | Status.UNTARED
        last = state.units.force[:, unit].copy()
        send = far.send
        far.send = lambda records: send(records[records["id"] != dead])
        flags = [Status(int(next(states).units.status[unit])) for _ in range(10)]
        state = next(states)
        assert flags[0] == Status.LATE | Status.UNCALIBRATED | Status.UNTARED
        assert Status.STALE in flags[-1]
        assert state.units.force[:, unit] == pytest.approx(last, abs=1e-3)
        assert not state.units.valid[unit]
        assert 0.0 < state.coverage < 1.0
        far.send = send
        for _ in range(3):
            state = next(states)
        assert state.units.valid.all()
    assert callable(answer)


def test_free_running_units_make_one_cycle_a_period(tmp_path):
    loaded = topology_of(tmp_path, ("sync_id = 0x080\n", ""))
    started = time.monotonic()
    with skin.open(loaded, simulate=True) as strip:
        states = []
        for state in itertools.islice(strip, 10_000):
            states.append(state)
            if len(states) >= 25 and strip.counters.data:  # the units may have to compile first
                break
        periods = (time.monotonic() - started) * loaded.cycle_rate_hz
        assert strip.counters.data > 0
    numbers = [state.cycle for state in states]
    assert numbers == sorted(set(numbers))  # a busy machine may leave some out, never repeat one
    assert numbers[-1] <= periods


def test_listener_takes_the_sync_of_another_host(monkeypatch):
    loaded = topology.load("strip")
    host, ears, far = (MemoryTransport("live-listener") for _ in range(3))
    SimulatedUnits(loaded).attach([far])
    receive = ears.receive
    with (
        far,
        over(loaded, [host], pace=False) as leader,
        over(loaded, [ears], sync="bus") as listener,
    ):
        led = iter(leader)

        def receive_led(batch, timeout_s=0.0):
            next(led)
            return receive(batch, timeout_s)

        monkeypatch.setattr(ears, "receive", receive_led)
        for number, state in enumerate(itertools.islice(listener, 10)):
            assert state.cycle == number
            assert state.closed_by == "complete"
            assert state.units.valid.all()
        assert (host.counters.sent, ears.counters.sent) == (10, 0)


def test_listener_without_a_host_says_that_all_is_silent():
    near, far = MemoryTransport.pair()
    with far, over("strip", [near], sync="bus") as strip:
        state = take(strip, 1)[0]
        assert not state.units.valid.any()


@pytest.mark.parametrize("periods", [3, 8])
def test_host_that_is_slow_leaves_out_syncs_and_counts_them(periods):
    with skin.open("strip", simulate=True) as strip:
        states = iter(strip)
        next(states)
        time.sleep((periods + 0.5) / strip.topology.cycle_rate_hz)
        assert next(states).overruns >= periods - 1
        assert strip.timing.overruns >= periods - 1
        assert strip.counters.lost == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sync": "hots"}, "sync: must be one of 'host', 'bus'; got 'hots'"),
        ({"want": {"wrnch"}}, "wrench"),
        ({"options": "sine"}, "options: must be "),
        ({"record": "run.txt"}, "record: run.txt: must end in one of .mcap, .log, .log.gz"),
        ({"sync": "bus"}, "sync: must be 'host' with simulate; got 'bus'"),
        ({"simulate": "pres"}, r"a ready-made scene .*nearest: 'press'"),
        ({"simulate": 2}, "simulate: must be True, a scene, or the name or file of one; got 2"),
    ],
)
def test_wrong_option_is_refused(options, message):
    with pytest.raises(SkinError, match=message):
        skin.open("strip", **{"simulate": True, **options})


@long_after_first("simulate", [False, None, "", 0])
def test_what_is_false_opens_the_buses_and_invents_no_forces(simulate):
    with skin.open("strip", simulate=simulate) as opened:
        assert opened.nodes is None
        assert not opened.simulated
        assert repr(opened) == "<Skin 'strip': 10 units>"


def test_a_skin_has_a_transport_for_each_bus():
    with pytest.raises(SkinError, match="transports: must be one for each of 1 buses; got 0"):
        over("strip", [])
    with pytest.raises(SkinError, match=r"deadline_s: must be a number from 1e-06 to 3600; got 0"):
        over("strip", [], deadline_s=0.0)


@pytest.mark.long
def test_a_scene_that_ends_ends_the_loop_and_one_that_repeats_does_not(tmp_path):
    scene = tmp_path / "press.toml"
    scene.write_text("format = 1\nseconds = 0.1\n")
    rate = int(topology.load("strip").cycle_rate_hz)
    with skin.open("strip", simulate=scene, pace=False) as strip:
        assert len(list(strip)) == rate // 10
        assert list(strip) == []  # and the next loop, too
    scene.write_text("format = 1\nseconds = 0.1\nrepeat = true\n")
    with skin.open("strip", simulate=scene, pace=False) as strip:
        assert len(list(itertools.islice(strip, rate))) == rate


def test_a_scene_of_units_that_send_freely_ends_the_loop_too(tmp_path):
    scene = tmp_path / "short.toml"
    scene.write_text("format = 1\nseconds = 0.2\n")
    with skin.open(topology_of(tmp_path, ("sync_id = 0x080\n", "")), simulate=scene) as strip:
        assert sum(1 for _ in strip) > 0


def test_a_bus_without_anybody_else_is_said_to_be_one(caplog):
    with skin.open("gripper", want="force") as gripper:
        next(iter(gripper))
    assert [text for text in caplog.messages if "nobody" in text] == [
        "nobody can answer: gripper: buses[0] 'main': interface: must be one that other processes "
        "can reach, or units must be simulated (simulate=True, --simulate); got 'memory'"
    ]
    caplog.clear()
    loaded = topology.load("strip")
    with MemoryTransport(loaded.buses[0].channel), skin.open(loaded, want="force") as strip:
        next(iter(strip))
    assert "nobody" not in caplog.text


def test_a_bus_on_which_nobody_can_answer_ends_the_loop(monkeypatch):
    monkeypatch.setattr("skin.live.QUIET_S", 0.01)
    with (
        skin.open("gripper", want="force") as gripper,
        pytest.raises(
            SkinError, match=r"^nobody can answer: gripper: buses\[0\] 'main': interface"
        ),
    ):
        for _ in gripper:
            pass


def test_units_that_never_answer_are_said_to_be_silent_less_and_less_often(monkeypatch, caplog):
    monkeypatch.setattr("skin.live.QUIET_S", 0.01)
    near, far = MemoryTransport.pair()
    with far, over("strip", [near], want="force") as strip:
        while (count := caplog.text.count("no unit has answered for")) < 3:
            next(iter(strip))
        assert strip._quiet_s == pytest.approx(0.01 * 2**count)
    caplog.clear()
    with skin.open("strip", want="force", simulate=True) as strip:
        take(strip, 20)
        assert strip._quiet_s == 0.0
    assert "answered" not in caplog.text


def test_a_closed_skin_is_no_empty_one():
    with skin.open("strip", simulate=True, pace=False) as strip:
        started = iter(strip)
        next(started)
    with pytest.raises(
        SkinError, match=r"iter\(skin\): must be an open skin; got one that is closed"
    ):
        iter(strip)
    strip.close()
    assert list(started) == [], "a loop that runs ends"
    position, rotation = strip.topology.position, strip.topology.rotation
    for method, given in (
        (strip.move, (position, rotation)),
        (strip.move_joints, ({},)),
        (strip.turn, (np.eye(3),)),
        (strip.retake_zeros, ()),
    ):
        with pytest.raises(SkinError, match=f"{method.__name__}: must be an open skin"):
            method(*given)


class Pulled(MemoryTransport):
    """An adapter that is pulled out."""

    closing = False

    def receive(self, batch, timeout_s=0.0):
        if self.closing:
            raise BusClosedError("bus 'main': no such device")
        return super().receive(batch, timeout_s)

    def close(self):
        super().close()
        if self.closing:
            raise OSError("handle")


@pytest.mark.parametrize("pulled", [(0,), (1,), (0, 1)])
def test_of_an_adapter_that_is_pulled_out_everything_else_is_closed_and_kept(tmp_path, pulled):
    loaded = topology.load("hand")
    nodes = SimulatedUnits(loaded)
    ends = nodes.in_process()
    log = tmp_path / "run.log"
    opened = over(loaded, ends, record=log, pace=False)
    seen = []
    for at in pulled:
        ends[at].__class__, ends[at].closing = Pulled, False

    def run():
        with opened:
            for state in opened:
                seen.append(state.cycle)
                if len(seen) == 400:
                    for at in pulled:
                        ends[at].closing = True

    with pytest.raises(BusClosedError, match="bus 'main': no such device") as error:
        run()
    assert error.value.__notes__ == ["OSError on closing: handle"]
    assert len(seen) == 400
    for end in ends:
        with pytest.raises(BusClosedError):
            end.send(np.zeros(0, FRAME_DTYPE))
    assert np.count_nonzero(read_all(log)["id"] == 0x80) >= 400


@pytest.mark.parametrize("jump_s", [1.7e9, -5.0])
def test_stamps_that_jump_are_said_to_and_stay_those_of_the_system(tmp_path, caplog, jump_s):
    """As those of the kernel do, of units that send freely, where NTP sets the clock."""
    free = topology_of(tmp_path, ("sync_id = 0x080\n", ""))
    near, far = MemoryTransport.pair()
    near.keeps_stamps = False
    nodes, out = SimulatedUnits(free), FrameBatch(256)
    with far, over(free, [near], want="force") as strip:
        for cycle, state in zip(range(40), strip, strict=False):
            out.clear()
            now_ns = time.time_ns() + round(1e9 * jump_s) * (cycle >= 20)
            nodes.tick(cycle, out, stamp_ns=now_ns)
            far.send(out.frames)
            assert strip.realtime_ns(state.stamp_ns) == state.stamp_ns
    (said,) = [text for text in caplog.messages if "jump" in text]
    assert said.startswith(f"bus 'main': stamps jump by {'+' if jump_s > 0 else '-'}")
    assert said.endswith(": a clock was set")


def test_refused_skin_closes_its_buses(monkeypatch):
    near, far = MemoryTransport.pair()
    monkeypatch.setattr("skin.opening.open_transport", lambda _bus, _i: near)
    with pytest.raises(SkinError):
        skin.open("strip", record="run.txt")
    with pytest.raises(bus.BusClosedError):
        near.receive(bus.FrameBatch(1))
    far.close()


def test_poses_are_checked_where_no_contacts_are_wanted_too():
    with skin.open("strip", simulate=True, want={"force"}) as strip:
        here = strip.topology
        strip.move(here.position, here.rotation)
        with pytest.raises(SkinError, match=r"rotation: must be orthonormal .*, of unit 0"):
            strip.move(here.position, 2.0 * here.rotation)
        with pytest.raises(SkinError, match="position, rotation: must have shapes"):
            strip.move(here.position[:, 1:], here.rotation)
        with pytest.raises(SkinError, match="translation: must be within 1000 m; got nan"):
            strip.move_patch(here.patch_names[0], np.eye(3), np.full(3, np.nan))


@long_after_first("sync", ["host", "bus"])
def test_a_second_loop_goes_on_with_the_cycles_of_the_first(sync):
    """No cycle is invented, and no frame that the first loop left in its batch is lost."""
    near, host = MemoryTransport.pair()
    ends = SimulatedUnits(STRIP).in_process() if sync == "host" else [near]
    with host, over(STRIP, ends, sync=sync, pace=False) as strip:
        if sync == "bus":
            host.send(frames_of("strip", "press", 13))
        numbers = [state.cycle for _ in range(4) for state in itertools.islice(strip, 3)]
        assert numbers == list(range(12))
        assert strip.counters.lost == 0


def test_two_live_iterators_are_refused():
    with skin.open("strip", simulate=True, pace=False) as strip:
        first = iter(strip)
        next(first)
        with pytest.raises(SkinError, match="must be the only live iterator of a skin; got a sec"):
            next(iter(strip))
        assert next(first).cycle == 1
        first.close()
        assert next(iter(strip)).cycle == 2


def test_a_bus_that_is_gone_is_told_in_every_loop():
    with skin.open("strip", simulate=True, pace=False) as strip:
        assert next(iter(strip)).cycle == 0
        strip.transports[0].close()
        for _ in range(2):
            with pytest.raises(bus.BusClosedError):
                next(iter(strip))


def test_a_bus_that_takes_no_frames_is_counted_and_told():
    near, far = MemoryTransport.pair()
    with far, over("strip", [near], pace=False, deadline_s=0.001) as strip:
        states = iter(strip)
        next(states)
        assert strip.timing.unsent == 0
        near.send = lambda records: 0
        for _ in range(3):
            next(states)
        assert strip.timing.unsent == 3


def test_the_stamp_of_a_sync_is_its_end_on_the_wire():
    """57 bits at the rate of the bus, which units that are simulated here have not."""
    with skin.open("strip", simulate=True) as strip:
        assert not strip._wire_ns.any()
        assert strip.clocks == {bus.name: {"by": "kernel"} for bus in strip.topology.buses}
        state = next(iter(strip))
        assert (state.sampled_ns[state.units.valid] == state.stamp_ns).all()
        assert abs(strip.realtime_ns(state.stamp_ns) - time.time_ns()) < 5_000_000_000
    buses = topology.load("strip").buses
    ends = [MemoryTransport.pair(index=i)[0] for i in range(len(buses))]
    with over("strip", ends) as strip:
        assert strip._wire_ns.tolist() == [round(SYNC_BITS * 1e9 / bus.bitrate) for bus in buses]
