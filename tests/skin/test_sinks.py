"""Sinks: they see what the loop sees, cost it nothing where they are slow, and end alone."""

from __future__ import annotations

import itertools
import threading
import time

import numpy as np
import pytest

import skin
from bus.frame import FRAME_DTYPE
from bus.logs import read
from bus.memory import MemoryTransport
from skin.errors import OptionError, SkinError
from skin.sinks import LEAST_WAITING, WAITING_S, Ending
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import over
from tests.fixtures.patience import LONG_S


class Keeper(skin.Sink):
    """Keeps all that it is given."""

    def __init__(self):
        self.given, self.stops = [], 0

    def frames(self, frames):
        self.given.append(("frames", frames))

    def closing(self, event, elapsed_ns):
        self.given.append(("closing", (event, elapsed_ns)))

    def moved(self, position, rotation):
        self.given.append(("moved", (position, rotation)))

    def state(self, state):
        self.given.append(("state", state))

    def stop(self):
        self.stops += 1

    def of(self, moment):
        return [value for name, value in self.given if name == moment]


class Stuck(skin.Sink):
    """Waits in its first state until it may go on."""

    def __init__(self):
        self.entered, self.may_go_on, self.cycles = threading.Event(), threading.Event(), []

    def state(self, state):
        self.entered.set()
        assert self.may_go_on.wait(LONG_S)
        self.cycles.append(state.cycle)


class Failing(skin.Sink):
    """Raises in its third state."""

    def __init__(self):
        self.count, self.stops = 0, 0

    def state(self, state):
        self.count += 1
        if self.count == 3:
            raise ValueError("the third")

    def stop(self):
        self.stops += 1


class FailingInline(Failing):
    inline = True


class Counter(skin.Sink):
    inline = True
    count = 0

    def state(self, state):
        self.count += 1


def same(states, others):
    assert len(states) == len(others) > 0
    for one, other in zip(states, others, strict=True):
        assert one.cycle == other.cycle
        assert abs(one.stamp_ns - other.stamp_ns) < 1000  # a log has microseconds
        np.testing.assert_array_equal(one.units.force, other.units.force)
        np.testing.assert_array_equal(one.wrench, other.wrench)
        assert [c.id for c in one.contacts] == [c.id for c in other.contacts]


def test_a_sink_sees_the_states_of_the_loop_and_the_frames_of_the_log(tmp_path):
    log = tmp_path / "run.log"
    with skin.open("strip", simulate="press", pace=False, record=log) as strip:
        keeper = strip.attach(Keeper())
        states = list(itertools.islice(strip, 300))
    same(keeper.of("state"), states)
    assert any(state.contacts for state in states)
    frames = np.concatenate(keeper.of("frames"))
    written = np.concatenate([batch.frames.copy() for batch in read(log)])
    assert frames.dtype == FRAME_DTYPE
    for name in ("id", "length", "data"):
        np.testing.assert_array_equal(frames[name], written[name])
    assert keeper.stops == 1
    assert strip.sinks == [(keeper, 0, None)]


@long_after_first("way", ["states", "blocks", "replay"])
def test_a_sink_sees_the_cycles_of_a_log_and_stops_at_its_end(way, tmp_path):
    log = tmp_path / "run.log"
    with skin.open("strip", simulate="press", pace=False, record=log) as strip:
        live = list(itertools.islice(strip, 60))
    source = skin.replay(log, "strip") if way == "replay" else skin.decode_log("strip", log)
    keeper = source.attach(Keeper())
    for _ in source.blocks() if way == "blocks" else source:
        pass
    same(keeper.of("state"), live)
    written = np.concatenate([batch.frames.copy() for batch in read(log)])
    np.testing.assert_array_equal(np.concatenate(keeper.of("frames"))["data"], written["data"])
    assert keeper.stops == 1


def test_cycles_that_the_clock_ends_are_seen_before_their_states():
    near, far = MemoryTransport.pair()
    with far, over("strip", [near], sync="bus") as strip:
        keeper = strip.attach(Keeper())
        list(itertools.islice(strip, 3))
    moments = [name for name, _ in keeper.given]
    assert moments == ["closing"] + ["closing", "state"] * 3  # the first begins to measure
    assert keeper.of("closing")[0] == (Ending.SILENT, 0)
    assert all(event == Ending.SILENT and ns > 0 for event, ns in keeper.of("closing")[1:])


def test_a_log_that_ends_within_a_cycle_is_flushed(tmp_path):
    log = tmp_path / "run.log"
    with skin.open("strip", simulate="press", pace=False, record=log) as strip:
        list(itertools.islice(strip, 5))
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join(lines[: -len(lines) // 10]))  # half a cycle
    source = skin.decode_log("strip", log)
    keeper = source.attach(Keeper())
    last = list(source)[-1]
    assert last.closed_by == "end"
    assert [name for name, _ in keeper.given][-2:] == ["closing", "state"]
    assert keeper.of("closing")[-1] == (Ending.FLUSHED, 0)


def test_poses_are_seen_as_they_are_set():
    with skin.open("strip", simulate=True, pace=False) as strip:
        keeper = strip.attach(Keeper())
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        strip.move_patch(strip.topology.patch_names[0], turn, [0.1, 0.0, 0.0])
        at = strip.topology
    ((position, rotation),) = keeper.of("moved")
    np.testing.assert_allclose(position, turn @ at.position + [[0.1], [0.0], [0.0]], atol=1e-12)
    np.testing.assert_allclose(rotation[:, :, 3], turn @ at.rotation[:, :, 3], atol=1e-12)


@long_after_first("kind", [Failing, FailingInline])
def test_a_sink_that_raises_is_detached_and_the_run_goes_on(kind, caplog):
    with skin.open("strip", simulate=True, pace=False) as strip:
        failing, keeper = strip.attach(kind()), strip.attach(Keeper())
        states = list(itertools.islice(strip, 20))
    expected = (
        f"sink {kind.__name__}: state: must not raise; got ValueError: the third "
        "(it is detached, the run goes on)"
    )
    assert (failing.count, failing.stops) == (3, 1)
    assert [message for message in caplog.messages if "sink" in message] == [expected]
    assert strip.sinks == [(failing, 0, expected), (keeper, 0, None)]
    same(keeper.of("state"), states)


@long_after_first("detached", [False, True])
def test_a_sink_that_has_failed_is_waited_for_until_it_has_stopped(detached):
    class Slow(Failing):
        stopping = threading.Event()

        def stop(self):
            self.stopping.set()
            time.sleep(0.2)
            super().stop()

    with skin.open("strip", simulate=True, pace=False) as strip:
        slow = strip.attach(Slow())
        list(itertools.islice(strip, 3))
        assert Slow.stopping.wait(LONG_S)  # its own thread stops it
        if detached:
            strip.detach(slow)
            assert slow.stops == 1
    assert slow.stops == 1


def test_a_sink_that_raises_as_it_stops_hinders_no_other(caplog):
    class Bad(Keeper):
        def stop(self):
            raise OSError("no space")

    with skin.open("strip", simulate=True, pace=False) as strip:
        first, bad, last = (strip.attach(one) for one in (Keeper(), Bad(), Keeper()))
        list(itertools.islice(strip, 3))
    assert (first.stops, last.stops) == (1, 1)
    assert strip.sinks[1].failure == (
        "sink Bad: stop: must not raise; got OSError: no space (it is detached, the run goes on)"
    )
    assert strip.sinks[1].failure in caplog.messages
    assert bad.of("state")


def test_a_sink_that_waits_holds_no_cycle_up_and_what_it_misses_is_counted(caplog):
    stuck = Stuck()
    with skin.open("strip", simulate=True, pace=False) as strip:
        room = max(LEAST_WAITING, round(WAITING_S * strip.topology.cycle_rate_hz))
        strip.attach(stuck)
        states = iter(strip)
        next(states)
        assert stuck.entered.wait(LONG_S)
        assert len(list(itertools.islice(states, room + 7))) == room + 7
        assert strip.sinks == [(stuck, 7, None)]
        stuck.may_go_on.set()
    assert stuck.cycles == list(range(room + 1))  # what waited is taken before it stops
    warned = [message for message in caplog.messages if "sink" in message]
    assert warned == [
        f"sink Stuck: must keep up with 250 cycles a second; left out {count} calls {when}"
        for count, when in ((1, "so far"), (7, "in all"))
    ]


def test_a_sink_that_never_returns_is_left_behind(caplog, monkeypatch):
    monkeypatch.setattr("skin.sinks.STOPS_S", 0.05)
    stuck = Stuck()
    with skin.open("strip", simulate=True, pace=False) as strip:
        strip.attach(stuck)
        list(itertools.islice(strip, 3))
        assert stuck.entered.wait(LONG_S)
    assert "sink Stuck: must stop within 0.05 s; still runs with a backlog of" in caplog.text
    stuck.may_go_on.set()


def test_a_sink_that_is_detached_sees_no_more_and_may_come_again():
    with skin.open("strip", simulate=True, pace=False) as strip:
        keeper, states = strip.attach(Keeper()), iter(strip)
        list(itertools.islice(states, 3))
        strip.detach(keeper)
        strip.detach(keeper)
        list(itertools.islice(states, 3))
        assert [state.cycle for state in keeper.of("state")] == [0, 1, 2]
        assert keeper.stops == 1
        strip.attach(keeper)
        list(itertools.islice(states, 2))
    assert [state.cycle for state in keeper.of("state")] == [0, 1, 2, 6, 7]
    assert keeper.stops == 2
    assert len(strip.sinks) == 1


def test_a_sink_within_the_cycle_is_given_the_pipelines_own_arrays():
    class Inline(Keeper):
        inline = True

    with skin.open("strip", simulate=True, pace=False) as strip:
        inline = strip.attach(Inline())
        for count, _ in enumerate(itertools.islice(strip, 5), start=1):
            assert len(inline.of("state")) == count  # in the same cycle
    assert all(state is strip.pipeline.now for state in inline.of("state"))


def test_a_sink_may_detach_itself_and_another_be_attached_from_a_thread():
    class Once(Counter):
        def state(self, state):
            super().state(state)
            strip.detach(self)

    with skin.open("strip", simulate=True, pace=False) as strip:
        once, later = strip.attach(Once()), Counter()
        threading.Timer(0.01, strip.attach, (later,)).start()
        until = time.monotonic() + LONG_S
        for _ in strip:
            if later.count or time.monotonic() > until:
                break
    assert once.count == 1
    assert later.count


@pytest.mark.parametrize(
    ("sink", "message"),
    [
        (print, "sink: must be a Sink; got <built-in function print>"),
        (skin.Sink(), "sink: must have at least one of the methods frames, closing, moved, state, "
                      "stop; got Sink without any"),
    ],
)  # fmt: skip
def test_what_is_no_sink_is_refused(sink, message):
    with skin.open("strip", simulate=True, pace=False) as strip:
        with pytest.raises(SkinError) as told:
            strip.attach(sink)
    assert str(told.value).startswith(message)


def test_a_sink_is_attached_once():
    with skin.open("strip", simulate=True, pace=False) as strip:
        counter = strip.attach(Counter())
        with pytest.raises(OptionError, match="sink: must be attached once; got Counter again"):
            strip.attach(counter)
        list(itertools.islice(strip, 4))
    assert counter.count == 4
