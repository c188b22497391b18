"""Simulated boards: what stands in their frames, and how they answer, on one bus and on several."""

from __future__ import annotations

import struct
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.errors import BusClosedError
from bus.frame import CAN_ERR, ECHO, FRAME_DTYPE, FrameBatch
from bus.memory import MemoryTransport
from skin.errors import SkinError
from skin.sim.node import RECENT, Served, SimulatedUnits
from skin.sim.scenes.load import open_scene
from tests.fixtures.datagram import datagram_pair
from tests.fixtures.patience import LONG_S
from topology import Topology, load

SYNC = 0x080
PALM, STRIP, HAND = load("palm"), load("strip"), load("hand")


def sync(counter: int, **fields: int) -> np.ndarray:
    record = np.zeros(1, FRAME_DTYPE)
    record["id"], record["length"] = SYNC, 1
    record["data"][0, 0] = counter & 0xFF
    for name, value in fields.items():
        record[name] = value
    return record


def test_the_clock_of_the_faults_of_a_scene_is_that_of_its_cycles() -> None:
    nodes, (near, far) = SimulatedUnits(STRIP), MemoryTransport.pair()
    nodes.attach([far])
    told = []
    for number in (3, 4, 9, 255, 256, 300):
        near.send(sync(number, stamp_ns=1 + 10**9 * (number % 2)))
        told.append(nodes.time_ns())
    period_ns = 1e9 / STRIP.cycle_rate_hz
    assert told == [round(period_ns * cycle) for cycle in (3, 4, 9, 255, 256, 300)]


def free_running(topology: Topology) -> Topology:
    """The same skin without SYNC."""
    return replace(topology, sync_id=None)


def field(data: np.ndarray, start: int, length: int, signed: bool = False) -> int:
    """A little-endian bit field."""
    value = int.from_bytes(data.tobytes(), "little") >> start & (1 << length) - 1
    return value - (1 << length) if signed and value >> (length - 1) else value


def data_frames(frames: np.ndarray) -> np.ndarray:
    return frames[frames["id"] < 0x700]


def still_serving() -> list[str]:
    return [t.name for t in threading.enumerate() if t.name.startswith("units on ")]


def heartbeats(frames: np.ndarray) -> np.ndarray:
    return frames[frames["id"] >= 0x700]


# -- what stands in the frames ---------------------------------------------------------------------


def test_every_board_says_once_a_second_how_it_is() -> None:
    nodes, out = SimulatedUnits(HAND), FrameBatch(64)
    heard: dict[int, list[int]] = {}
    for cycle in range(500):
        for bus in range(2):
            out.clear()
            nodes.respond(sync(cycle), out, bus)
            for record in heartbeats(out.frames):
                state, uptime_s, firmware, serial, sent, received = struct.unpack(
                    "<BHBHBB", record["data"][: record["length"]].tobytes()
                )
                assert (state, firmware, sent, received) == (1, 1, 0, 0)
                assert uptime_s == cycle // 250
                assert record["flags"] == 0
                heard.setdefault(serial, []).append(cycle)
                assert serial == bus << 8 | record["id"] - 0x700
    boards = [int(np.sum(HAND.frames.bus == bus)) for bus in range(2)]
    assert sorted(heard) == [bus << 8 | k for bus in range(2) for k in range(1, boards[bus] + 1)]
    assert all(second - first == 250 for first, second in heard.values())
    assert len({first for first, _ in heard.values()}) == max(boards)


# -- SYNC ------------------------------------------------------------------------------------------


@settings(max_examples=10)
@given(start=st.integers(0, 255), steps=st.lists(st.integers(1, 200), min_size=1, max_size=10))
def test_the_counter_is_counted_on_without_wrapping(start: int, steps: list[int]) -> None:
    nodes, out = SimulatedUnits(STRIP), FrameBatch(4096)
    nodes.respond(sync(start), out)
    number = start
    assert nodes.truth.time_s == 0.0
    for step in steps:
        number += step
        out.clear()
        nodes.respond(sync(number), out)
        assert nodes.truth.time_s == pytest.approx((number - start) / 250.0)


def test_only_a_sync_is_answered() -> None:
    nodes, out = SimulatedUnits(PALM), FrameBatch(64)
    for other in (
        sync(0, id=0x100), sync(0, length=0), sync(0, origin=ECHO), sync(0, id=SYNC | CAN_ERR),
    ):  # fmt: skip
        assert nodes.respond(other, out) == 0
    assert out.count == 0
    assert nodes.served.cycles == 0


# -- truth -----------------------------------------------------------------------------------------


def test_the_truth_is_that_of_the_latest_cycle_and_stays() -> None:
    nodes, out, scene = SimulatedUnits(PALM), FrameBatch(64), open_scene("demo", PALM)
    for cycle in range(300):
        out.clear()
        nodes.respond(sync(cycle), out)
        told, before = scene.at(cycle / 250.0), nodes.truth
        np.testing.assert_array_equal(before.force, told.force)
    nodes.respond(sync(320), out)
    np.testing.assert_array_equal(before.force, told.force)
    assert nodes.truth.time_s > before.time_s


def test_there_is_no_truth_before_the_first_cycle() -> None:
    with pytest.raises(SkinError, match="must be asked for after the first cycle"):
        _ = SimulatedUnits(PALM).truth


# -- transports ------------------------------------------------------------------------------------


def test_attached_units_without_sync_send_at_their_own_pace() -> None:
    near, far = MemoryTransport.pair()
    nodes, batch = SimulatedUnits(free_running(STRIP)), FrameBatch(8192)
    nodes.attach([far])
    try:
        while len(data_frames(batch.frames)) < 50:
            assert near.receive(batch, timeout_s=LONG_S) > 0
    finally:
        nodes.close()
    frames = data_frames(batch.frames)
    first = frames[frames["id"] == frames["id"][0]]
    sequence = [field(record["data"], 59, 4) for record in first]
    assert sequence[0] == 0
    assert len(sequence) >= 5
    assert nodes.served.skipped > 0 or np.all(np.diff(sequence) % 16 == 1)


def test_units_on_a_machine_that_is_late_leave_out_the_cycles_that_are_over(monkeypatch) -> None:
    """It takes ten and a half periods for each."""
    nodes, done = SimulatedUnits(free_running(STRIP)), threading.Event()
    seen: list[int] = []

    def tick(cycle: int, *_: object) -> None:
        seen.append(cycle)
        if len(seen) == 5:
            done.set()

    late = SimpleNamespace(monotonic=lambda: 10.5 / STRIP.cycle_rate_hz * len(seen))
    monkeypatch.setattr("skin.sim.node.time", late)
    monkeypatch.setattr(nodes, "tick", tick)
    nodes.attach([MemoryTransport.pair()[1]])
    assert done.wait(LONG_S)
    nodes.close()
    assert seen[:5] == [0, 10, 21, 31, 42]


def four_buses(folder: Path) -> Topology:
    """Eight units on each of four buses, at 1 kHz."""
    lines = ["format = 1", 'name = "four"', "cycle_rate_hz = 1000", "sync_id = 0x080"]
    for i in range(4):
        lines += [
            "[[buses]]", f'name = "bus{i}"', 'interface = "memory"', f'channel = "b{i}"',
            "data_bitrate = 5_000_000",
            "[[patches]]", f'name = "tile{i}"', 'kind = "grid"', "rows = 1", "columns = 8",
            "pitch_m = 0.012", f'bus = "bus{i}"', 'layout = "f3t-fd64"', "first_id = 0x100",
            f"pose = {{ xyz_m = [0.0, {0.012 * i}, 0.0] }}",
        ]  # fmt: skip
    path = folder / "four.toml"
    path.write_text("\n".join(lines))
    return load(path)


def test_four_buses_that_can_be_polled_are_served_by_one_thread(tmp_path: Path) -> None:
    """300 cycles as fast as the host asks: every SYNC is answered, and nothing runs ahead."""
    topology = four_buses(tmp_path)
    pairs = [datagram_pair() for _ in topology.buses]
    nodes, stop, batch, served = (
        SimulatedUnits(topology, seed=1),
        threading.Event(),
        FrameBatch(64),
        [],
    )
    worker = threading.Thread(
        target=lambda: served.append(nodes.serve([far for _, far in pairs], stop=stop))
    )
    worker.start()
    try:
        for cycle in range(300):
            for near, _ in pairs:
                near.send(sync(cycle))
            for near, _ in pairs:
                batch.clear()
                while len(data_frames(batch.frames)) < 2:
                    assert near.receive(batch, timeout_s=LONG_S) > 0
                assert {int(n) for n in data_frames(batch.frames)["data"][:, 0]} == {cycle & 0xFF}
        assert still_serving() == ["units on several buses"]
    finally:
        stop.set()
        worker.join()
        for end in sum(pairs, ()):
            end.close()
    assert served[0].cycles == 300
    assert served[0].frames >= 4 * 2 * 300
    assert (served[0].send_failures, served[0].skipped) == (0, 0)


@pytest.mark.parametrize("behind", [1, RECENT + 1, 100, 200])
def test_a_bus_that_lags_answers_its_own_cycles_and_does_not_run_ahead(behind: int) -> None:
    nodes, out = SimulatedUnits(HAND, seed=1), FrameBatch(64)
    for cycle in range(3):
        for bus in (0, 1):
            nodes.respond(sync(cycle), out, bus)
            out.clear()
    for cycle in range(3, 3 + behind):
        nodes.respond(sync(cycle), out, 0)
        out.clear()
    assert nodes.served.cycles == 3 + behind
    for cycle in range(3, 3 + behind):
        assert nodes.respond(sync(cycle), out, 1) > 0
        assert {field(r["data"], 0, 8) for r in data_frames(out.frames)} == {cycle & 0xFF}
        out.clear()
    assert nodes.served.cycles == 3 + behind


def test_a_bus_whose_first_sync_comes_late_joins_the_others() -> None:
    nodes, out = SimulatedUnits(HAND, seed=1), FrameBatch(64)
    for cycle in range(3):
        nodes.respond(sync(cycle), out, 0)
        out.clear()
    nodes.respond(sync(1), out, 1)
    assert {field(r["data"], 0, 8) for r in data_frames(out.frames)} == {1}
    assert nodes.served.cycles == 3


def test_a_bus_that_was_silent_while_others_went_around_is_with_them_again() -> None:
    nodes, out = SimulatedUnits(HAND, seed=1), FrameBatch(64)
    for cycle in range(1000):
        if not 3 <= cycle < 900:
            nodes.respond(sync(cycle), out, 1)
        nodes.respond(sync(cycle), out, 0)
        out.clear()
    assert nodes.served.cycles == 1000


def test_serving_ends_when_it_is_told_and_tells_how_it_goes() -> None:
    near, far = MemoryTransport.pair()
    stop, told = threading.Event(), []

    def watch(served: Served) -> None:
        told.append(served.frames)
        stop.set()

    served = SimulatedUnits(free_running(STRIP)).serve([far], stop=stop, watch=watch)
    assert 0 < told[0] <= served.frames
    assert served.seconds >= 1.0
    batch = FrameBatch(16384)
    assert near.receive(batch) == served.frames
    assert data_frames(batch.frames).size == 10 * served.cycles
    assert not still_serving()


def test_serving_ends_on_time() -> None:
    _, far = MemoryTransport.pair()
    started = time.monotonic()
    served = SimulatedUnits(PALM).serve([far], seconds=0.1)
    assert time.monotonic() - started >= served.seconds >= 0.1
    assert served == Served(seconds=served.seconds)
    assert not still_serving()


def test_a_bus_that_goes_away_ends_the_serving() -> None:
    _, far = MemoryTransport.pair()
    far.close()
    with pytest.raises(BusClosedError):
        SimulatedUnits(PALM).serve([far])
    assert not still_serving()


def test_one_transport_for_each_bus_is_asked_for() -> None:
    _, far = MemoryTransport.pair()
    for use in (SimulatedUnits(HAND).attach, SimulatedUnits(HAND).serve):
        with pytest.raises(SkinError, match=r"^transports: must be one for each of 2 .*; got 1$"):
            use([far])
