"""How healthy a skin is: what makes the panel amber, and what red."""

from __future__ import annotations

import numpy as np
import pytest

from bus.state import BusState
from skin.io.messages.record import BUS_STATES, COUNTERS
from skin.state import Status
from skin.view.health import AMBER, GREEN, RED, Health, Level
from tests.naive.record import snapshots

N = 8


@pytest.fixture
def health():
    return Health([f"u{i}" for i in range(N)], 250.0, np.arange(N) // 4, ("left", "right"))


def fed(health, count=60, hz=250.0, **changes):
    """The newest of two seconds of snapshots of a sound skin, with changes as functions of k."""
    records = snapshots(count, N)
    k = np.arange(count)
    records["stamp_ns"] = 10**18 + k * 33_333_333
    records["cycle"] = records["cycles"] = np.round(k * hz / 30.0)
    records["whole"] = 1
    for name, values in changes.items():
        if name in COUNTERS:
            records["counters"][:, COUNTERS.index(name)] = values(k)
        else:
            records[name] = values(k) if callable(values) else values
    for record in records:
        health.add(record)
    return records[-1]


def status_of(**units):
    status = np.zeros(N, np.uint16)
    for name, flag in units.items():
        status[int(name[1:])] = int(flag)
    return status


def test_a_sound_skin_is_good(health):
    record = fed(health)
    assert health.judged(record) == (Level.GOOD, [])
    assert GREEN in health.banner_html(record)


def test_units_of_a_blind_patch_are_counted_once(health):
    never = {f"u{i}": Status.NEVER for i in range(5)}
    assert health.judged(fed(health, status=status_of(**never)))[1] == [
        (Level.POOR, "left: no unit is valid"), (Level.IMPAIRED, "1 more units not valid")
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "level", "text"),
    [
        ({"status": status_of(u1=Status.NEVER)}, Level.IMPAIRED, "1 of 8 units not valid"),
        ({"status": status_of(u4=Status.NEVER, u5=Status.STALE, u6=Status.FROZEN, u7=Status.NEVER)},
         Level.POOR, "right: no unit is valid"),
        ({"lost": lambda k: 3 * k}, Level.IMPAIRED, "177 frames lost or wrong in 2 s"),
        ({"overruns": lambda k: k // 30}, Level.IMPAIRED, "1 periods left out in 2 s"),
        ({"hz": 200.0}, Level.IMPAIRED, "200 Hz of 250"),
        ({"hz": 90.0}, Level.POOR, "90 Hz of 250"),
        ({"whole": 0}, Level.IMPAIRED, "the wrench is not whole"),
    ],
)  # fmt: skip
def test_each_fault_has_its_level_and_is_named(health, changes, level, text):
    record = fed(health, **changes)
    worst, found = health.judged(record)
    assert worst == level
    assert text in [one for _, one in found]
    page = health.banner_html(record)
    assert {Level.IMPAIRED: AMBER, Level.POOR: RED}[level] in page
    assert text in page


def test_losses_of_long_ago_no_longer_count(health):
    record = fed(health, 200, lost=lambda k: np.where(k > 20, 50, 0))
    assert health.judged(record)[0] == Level.GOOD
    assert ("losses", "lost 50") in health.rows(record)


@pytest.mark.parametrize(
    ("apart_s", "late", "named"), [(0.02, 196, "2"), (0.3, 180, "1.8"), (5.0, 500, "5")]
)
def test_losses_are_those_of_the_time_that_is_named(health, apart_s, late, named):
    """Of a loop that is slow, or of a clock that was set within."""
    records = snapshots(200, N)
    k = np.arange(200)
    records["stamp_ns"] = 10**18 + np.round(1e9 * apart_s * k) + 10**17 * (k > 100)
    records["cycles"] = records["cycle"] = 10 * k
    records["overruns"] = np.round(100 * apart_s * k)
    records["whole"] = 1
    for record in records:
        health.add(record)
    assert f"{late} periods left out in {named} s" in [why for _, why in health.judged(record)[1]]
    assert health.rates_hz()[0] == pytest.approx(10 / apart_s, rel=0.01)


def test_units_switched_off_are_no_fault_also_as_a_whole_patch(health):
    off = status_of(**{f"u{i}": Status.DISABLED for i in range(4)})
    assert health.judged(fed(health, status=off)) == (Level.GOOD, [])
    off[4] = int(Status.NEVER)
    assert health.judged(fed(health, status=off))[1] == [(Level.IMPAIRED, "1 of 4 units not valid")]


def test_a_skin_that_has_stopped_is_red_and_a_recording_that_has_ended_is_not(health):
    record = fed(health)
    assert health.judged(record, silent_s=0.9)[0] == Level.GOOD
    level, found = health.judged(record, silent_s=7.2)
    assert (level, found) == (Level.POOR, [(Level.POOR, "no cycle for 7 s")])
    assert health.judged(record, silent_s=0.0)[0] == Level.GOOD


def test_before_the_first_cycle_nothing_is_judged(health):
    record = snapshots(1, N)[0]
    record["cycle"], record["status"] = -1, int(Status.NEVER)
    assert health.judged(record) == (Level.IMPAIRED, [(Level.IMPAIRED, "no cycle yet")])


def test_a_bus_that_is_off_is_red_and_one_with_errors_amber(health):
    from types import SimpleNamespace

    from skin.view.snapshot import snapshot_dtype

    dtype = snapshot_dtype(SimpleNamespace(n=N, buses=("a", "b"), robot=None), 16)
    record = np.zeros(1, dtype)[0]
    record["whole"] = 1
    for state, level in (
        (BusState.ACTIVE, Level.GOOD), (BusState.PASSIVE, Level.IMPAIRED),
        (BusState.BUS_OFF, Level.POOR),
    ):  # fmt: skip
        record["bus_states"] = -1, BUS_STATES.index(state)
        assert health.judged(record)[0] == level


def test_faults_of_links_are_listed(health):
    page = health.html(fed(health), [("thumb", "tip.stl: must be a mesh; got <none>")])
    assert "link thumb" in page
    assert "got &lt;none&gt;" in page
