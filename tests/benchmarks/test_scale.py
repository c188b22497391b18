"""The benchmark of scale judges what the units sent in time, and counts what became of it."""

from __future__ import annotations

import json
import logging
import socket
import time

import numpy as np
import pytest

from bus.linux import has_batches

if not has_batches():
    pytest.skip("needs a 64-bit Linux", allow_module_level=True)

from benchmarks import scale
from benchmarks.scale_units import (
    LAP,
    PLAYED,
    Player,
    frame_ns,
    most_rows,
    on_fewest_buses,
    simulate,
    strip,
)
from bus.datagram import DatagramTransport
from bus.frame import FrameBatch
from skin.decode.decoder import Decoder
from topology import TopologyError

FRAMES, PERIOD_NS, TOLERANCE_NS = 13, 4_000_000, 170_000


@pytest.fixture(scope="module")
def small():
    """Fifteen units on one bus, and what is played of them."""
    skin = on_fewest_buses(5, 3, 250.0)
    return skin, simulate(skin)


@pytest.fixture
def good():
    """Ten cycles that are played in time and seen after 3 ms, of a run that began two earlier."""
    played = np.zeros(12, PLAYED)
    played["sync_ns"] = 1 + PERIOD_NS * np.arange(12)
    played["left_ns"] = played["sync_ns"] + 2_500_000
    seen = np.zeros(10, scale.SEEN)
    seen["cycle"] = np.arange(2, 12)
    seen["at_ns"] = played["sync_ns"][2:] + 3_000_000
    seen["shown"], seen["complete"] = FRAMES, 1
    return seen, played


def judge(seen, played):
    return scale.judge(seen, played, FRAMES, PERIOD_NS, TOLERANCE_NS)


def test_skins_take_as_many_buses_as_the_budget_asks():
    assert [len(on_fewest_buses(*shape, 250.0).buses) for shape in scale.SKINS.values()] == [
        1, 3, 14, 18
    ]  # fmt: skip
    with pytest.raises(TopologyError):
        strip(126, 10, 13, 250.0)
    fast = most_rows(scale.FAST_COLUMNS, scale.FAST_BUSES, scale.FAST_RATE_HZ)
    assert (fast.n, len(fast.buses)) == (80, 4)
    along = np.sort(np.unique(fast.position[1].round(6)))
    np.testing.assert_allclose(np.diff(along), 0.012, err_msg="the patches lie side by side")


def test_the_units_touch_and_come_back_to_where_they_began(small):
    skin, units = small
    assert units.counts.shape == (LAP, 6, 15)
    steps = np.abs(np.diff(units.counts[:, 1], axis=0, append=units.counts[:1, 1]))
    assert steps.max() < 6 * np.median(steps.max(axis=1)), "no jump at the end of a lap"
    assert [frames.shape for frames in units.frames] == [(LAP, len(skin.frames))]


def test_what_is_played_in_time_and_seen_is_neither_late_nor_lost(good):
    found = judge(*good)
    assert found.judged.all()
    assert not found.late.any()
    assert not found.lost.any()
    assert set(found.latency_ns) == {3_000_000}
    assert set(found.after_last_ns) == {500_000}


def test_a_cycle_that_the_units_sent_late_is_not_judged_nor_the_one_after_it(good):
    seen, played = good
    played["late_ns"][5] = TOLERANCE_NS + 1
    seen["shown"][3:5], seen["complete"][3] = 0, 0
    found = judge(seen, played)
    np.testing.assert_array_equal(np.flatnonzero(~found.judged), [3, 4])
    assert not found.late.any()
    assert not found.lost.any()
    played["late_ns"][5] = TOLERANCE_NS
    assert judge(seen, played).lost.sum() == 2 * FRAMES, "within the tolerance it is the host's"


@pytest.mark.parametrize("fault", ["without all units", "after the next SYNC", "some lost"])
def test_what_the_host_does_late_or_loses_is_counted(good, fault):
    seen, played = good
    if fault == "without all units":
        seen["complete"][4] = 0
    elif fault == "after the next SYNC":
        seen["at_ns"][4] += 1_000_001
    else:
        seen["shown"][4] -= 2
    found = judge(seen, played)
    assert np.flatnonzero(found.late).tolist() == ([] if fault == "some lost" else [4])
    assert found.lost.sum() == (2 if fault == "some lost" else 0)


def test_periods_that_the_host_left_out_are_late_and_lost_unless_units_held_it_up(good):
    seen, played = good
    kept = [0, 1, 2, 6, 7, 8, 9]
    for gone in (5, 6, 7):
        played[gone] = 0
    found = judge(seen[kept], played)
    np.testing.assert_array_equal(np.flatnonzero(found.late), [3, 4, 5])
    assert found.lost.sum() == 3 * FRAMES
    assert found.states.size == 7
    played["late_ns"][4] = TOLERANCE_NS + 1  # the cycle before them
    found = judge(seen[kept], played)
    np.testing.assert_array_equal(np.flatnonzero(~found.judged), [2, 3, 4, 5, 6])
    assert not found.late.any()
    assert not found.lost.any()


def test_a_cycle_asked_for_that_has_no_state_is_late_and_lost(good):
    seen, played = good
    found = judge(np.delete(seen, 4), played)
    assert np.flatnonzero(found.late).tolist() == [4]
    assert found.lost.sum() == FRAMES


def test_the_tail_says_what_was_in_it(good):
    seen = np.repeat(good[0][:1], 1000)
    seen["cycle"] = np.arange(1000)
    played = np.zeros(1000, PLAYED)
    played["sync_ns"] = 1 + PERIOD_NS * np.arange(1000)
    seen["at_ns"] = played["sync_ns"] + 3_000_000
    slow = {100: "page fault", 200: "wait", 300: "work", 400: None}
    for i, cause in slow.items():
        seen["at_ns"][i] += 500_000
        if cause == "work":
            seen["work_ns"][i] += 250_000
        elif cause:
            seen[cause][i:] += 250_000 if cause == "wait" else 1
    seen["wait"][500:] += 1  # of next to no length, in a cycle as long as others
    seen["log"][600:] += 3
    found = scale.tail(seen, judge(seen, played))
    assert found["p99"] == {"cycles": 4, "collector": 0, "page fault": 1, "log": 0, "switch": 0,
                            "wait": 1, "work": 1, "none": 1}  # fmt: skip
    assert found["others"]["cycles"] == 995
    assert found["others"]["log"] == 1


def test_cycles_that_others_disturbed_are_told_by_the_kernel(good):
    seen, _ = good
    seen["wait"][3:] += scale.WAIT_NS
    seen["wait"][5:] += scale.WAIT_NS - 1
    seen["switch"][7:] += 1
    assert np.flatnonzero(~scale.undisturbed(seen)).tolist() == [0, 3, 7]


def test_totals_count_collections_faults_and_log_records():
    with scale._Totals() as totals:
        before = totals()
        scale.gc.collect()
        np.ones(1 << 22)  # fresh pages
        logging.getLogger("skin").warning("counted")
        logging.getLogger("skin").debug("not on by default")
        after = totals()
    more = np.subtract(after, before)
    assert more[0] >= 1
    assert more[1] > 0
    assert more[2] == 1


def test_a_frame_that_is_dropped_or_forged_is_not_shown(small):
    """By what stands in the states, not by counters of the receiver."""
    skin, units = small
    cycle = np.arange(300, 310)
    temperature = Decoder(skin, {"temperature"})(units.counts).temperature[cycle % LAP]
    assert scale.shown(skin, units, cycle, temperature).tolist() == [len(skin.frames)] * 10
    temperature[3, 7] = np.nan
    temperature[5, 2] += 0.01
    assert scale.shown(skin, units, cycle, temperature).tolist() == [
        len(skin.frames) - (i in (3, 5)) for i in range(10)
    ]


def test_the_player_sends_every_frame_to_its_bus_not_before_its_time():
    skin = on_fewest_buses(21, 8, 250.0)
    units = simulate(skin)
    assert [frames.shape[1] for frames in units.frames] == [18, 16], "of unlike length"
    far, *near = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3))
    for sock in (far, *near):
        sock.bind(("127.0.0.1", 0))
    player = Player(skin, units.frames, [sock.getsockname()[1] for sock in near], 0)
    ends = [DatagramTransport(sock, "host", i) for i, sock in enumerate(near)]
    now_ns = time.time_ns()
    player.answer(3, now_ns - 5, now_ns, far.fileno())
    far.close()
    wire_ns = now_ns + player._first_ns + 18 * frame_ns(skin)
    skipped, (first_ns, due_ns, left_ns, late_ns) = player.played[:3], player.played[3]
    assert skipped == [(0, 0, 0, 0)] * 3
    assert (first_ns, due_ns) == (now_ns - 5, wire_ns)
    assert left_ns >= due_ns
    assert late_ns > 0
    for end, frames in zip(ends, units.frames, strict=True):
        batch = FrameBatch(64)
        end.receive(batch, 1.0)
        np.testing.assert_array_equal(batch.frames["data"], frames[3]["data"])
        each = now_ns + player._first_ns + frame_ns(skin) * np.arange(1, 1 + batch.count)
        assert (batch.frames["stamp_ns"] >= each).all()
        end.close()


@pytest.mark.parametrize("way", scale.WAYS)
def test_a_run_judges_what_it_has_played(small, way):
    row = json.loads(json.dumps(scale.measure(*small, way, 10, 60, None)))
    left_out = round(row["left_out"]["rate"] * row["periods"])
    assert row["cycles"] == row["periods"] - left_out == 60
    assert 0 <= row["late_periods"] <= row["judged"] <= row["periods"]
    assert row["cpu_share"] > 0.0
    assert row["contacts"] > 0


def test_table_shows_every_row_and_what_others_publish(monkeypatch):
    spread = {"p50": 2.5, "p99": 2.8, "p999": 3.5, "max": 4.0}
    tail = {"cycles": 30, **dict.fromkeys((*scale.CAUSES, "none"), 5)}
    row = {
        "periods": 10, "judged": 8, "late_periods": 2, "late": scale.rate(2, 8), "lost": 1,
        "cpu_share": 0.25, "latency_ms": spread, "after_last_ms": dict.fromkeys(spread),
        "work_us": spread,
        "undisturbed": {"cycles": 3, "latency_ms": spread, "after_last_ms": spread},
        "tail": {"p99": tail, "p99.9": tail, "others": tail},
    }  # fmt: skip
    monkeypatch.setattr(scale, "measure", lambda *_: row)
    monkeypatch.setattr(scale, "simulate", lambda _: None)
    figures = json.loads(json.dumps(scale.run(quick=False)))
    assert figures["lost_frames"] == 4
    assert figures["late"]["rate"] == 0.25
    assert figures["late"]["trials"] == 32
    assert figures["not_judged_share"] == pytest.approx(0.2)
    text = scale.table(figures)
    assert len(text.splitlines()) == 2 + 5 + 1 + 5 + 2 + 15 + 2
    assert "TUM" in text
