"""Recorded logs: the states are those of the live skin; what lacks is told."""

from __future__ import annotations

import itertools
import threading

import numpy as np
import pytest

import bus
import skin
import topology
from bus.memory import MemoryTransport
from skin.errors import OptionError
from skin.offline import prefetch
from tests.fixtures.live import frames_of, over
from tests.fixtures.logs import write


@pytest.fixture(scope="module")
def strip_frames():
    return frames_of("strip", "press", 40)


def told(state):
    contacts = [
        (contact.id, contact.load, contact.slip, contact.margin, *contact.centroid)
        for contact in state.contacts
    ]
    return state.cycle, state.counters, repr(contacts), repr([one.id for one in state.slips])


@pytest.mark.long
def test_states_of_a_log_are_those_felt_live(tmp_path):
    """Contacts, slip and counters included: the same frames, once from a bus, once from a file."""
    frames = frames_of("palm", "slide", 900)
    log = tmp_path / "palm.log"
    write(log, frames)
    near, host = MemoryTransport.pair()
    live = []
    with host, over("palm", [near], sync="bus", deadline_s=60.0) as palm:
        states = iter(palm)
        for cycle in np.split(frames, np.flatnonzero(frames["id"] == 0x80)[1:]):
            host.send(cycle)
            state = next(states)
            live.append((told(state), state.units.force.copy(), state.wrench.copy()))
    decoded = skin.decode_log("palm", log)
    count = 0
    for state, (words, force, wrench) in zip(decoded, live, strict=True):
        assert told(state) == words
        np.testing.assert_array_equal(state.units.force, force)
        np.testing.assert_array_equal(state.wrench, wrench)
        count += bool(state.slips)
    assert count
    assert decoded.faults == []
    assert decoded.counters == palm.counters


def test_a_log_without_sync_says_so(strip_frames, tmp_path):
    log = tmp_path / "strip.log"
    write(log, strip_frames[strip_frames["id"] != 0x80])
    decoded = skin.decode_log("strip", log)
    assert list(decoded) == []
    (fault,) = decoded.faults
    assert fault.startswith(f"{log}: bus 'main': must carry SYNC (0x080), which starts the cycles;")


@pytest.mark.parametrize("order", ["reversed", "step"])
def test_a_log_whose_time_runs_back_says_so(strip_frames, order, tmp_path):
    frames = strip_frames.copy()
    if order == "reversed":
        frames = frames[::-1]
    else:
        frames["stamp_ns"][frames.size // 2 :] -= 3_600_000_000_000
    log = tmp_path / "strip.log"
    write(log, frames)
    decoded = skin.decode_log("strip", log)
    for _ in decoded:
        pass
    fault, *_ = decoded.faults
    assert "must not be older than the frames before it on bus 'main'; got one" in fault
    if order == "step":
        assert f"{log}: frame {frames.size // 2 + 1}: " in fault


def test_jitter_of_a_logger_is_no_fault(strip_frames, tmp_path):
    frames = strip_frames.copy()
    frames["stamp_ns"] += np.random.default_rng(1).integers(0, 2_000_000, frames.size)
    write(tmp_path / "strip.log", frames)
    decoded = skin.decode_log("strip", tmp_path / "strip.log")
    assert len([state.cycle for state in decoded]) == 40
    assert decoded.faults == []


def test_options_and_files_are_checked_first(tmp_path):
    with pytest.raises(OptionError, match="want"):
        skin.decode_log("strip", tmp_path / "none.log", want={"wrnch"})
    with pytest.raises(bus.LogError, match="must be an existing file; got none"):
        skin.decode_log("strip", tmp_path / "none.log")
    with pytest.raises(topology.TopologyError):
        skin.decode_log("strp", tmp_path / "none.log")


def test_the_first_states_of_a_log_come_before_it_is_read_to_its_end(strip_frames, tmp_path):
    log = tmp_path / "strip.log"
    write(log, strip_frames)
    decoded = skin.decode_log("strip", log)
    assert [state.cycle for state in itertools.islice(decoded, 3)] == [0, 1, 2]


def test_what_a_thread_prefetches_is_in_order_with_its_error_and_the_thread_ends():
    def damaged():
        yield from range(6)
        raise ValueError("damaged")

    coming = prefetch(damaged())
    assert [next(coming) for _ in range(6)] == [*range(6)]
    with pytest.raises(ValueError, match="damaged"):
        next(coming)
    left = prefetch(itertools.count())
    assert next(left) == 0
    left.close()
    assert not [one for one in threading.enumerate() if one.name.startswith("skin-prefetch")]
