"""How healthy a skin is: what makes the panel amber, and what red."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bus.state import BusState
from skin.io.messages.record import BUS_STATES, COUNTERS
from skin.state import Status
from skin.view.health import AMBER, GREEN, RED, Health, flagged
from skin.view.snapshot import snapshot_dtype
from tests.naive.record import snapshots

N = 8


@pytest.fixture
def health():
    return Health(SimpleNamespace(
        unit_names=[f"u{i}" for i in range(N)], cycle_rate_hz=250.0, patch=np.arange(N) // 4,
        patch_names=("left", "right"),
    ))  # fmt: skip


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
    assert health.judged(record) == ([], [])
    assert GREEN in health.banner_html(record)


def test_units_of_a_blind_patch_are_counted_once(health):
    never = {f"u{i}": Status.NEVER for i in range(5)}
    record = fed(health, status=status_of(**never))
    assert health.judged(record) == (["left: no unit is valid"], ["1 more units not valid"])


@pytest.mark.parametrize(
    ("changes", "colour", "text"),
    [
        ({"status": status_of(u1=Status.NEVER)}, AMBER, "1 units not valid"),
        ({"status": status_of(u4=Status.NEVER, u5=Status.STALE, u6=Status.FROZEN, u7=Status.NEVER)},
         RED, "right: no unit is valid"),
        ({"lost": lambda k: 3 * k}, AMBER, "177 frames lost or wrong in 2 s"),
        ({"overruns": lambda k: k // 30}, AMBER, "1 periods left out in 2 s"),
        ({"hz": 200.0}, AMBER, "200 Hz of 250"),
        ({"hz": 140.0}, AMBER, "140 Hz of 250"),
        ({"hz": 90.0}, RED, "90 Hz of 250"),
        ({"whole": 0}, AMBER, "the wrench is not whole"),
        ({"untracked": 2}, AMBER, "2 contacts have no identity"),
    ],
)  # fmt: skip
def test_each_fault_has_its_colour_and_is_named(health, changes, colour, text):
    page = health.banner_html(fed(health, **changes))
    assert colour in page
    assert text in page


def test_losses_of_long_ago_no_longer_count(health):
    record = fed(health, 200, lost=lambda k: np.where(k > 20, 50, 0))
    assert health.judged(record) == ([], [])
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
    assert f"{late} periods left out in {named} s" in health.judged(record)[1]
    assert health.rates_hz()[0] == pytest.approx(10 / apart_s, rel=0.01)


def test_units_switched_off_are_no_fault_also_as_a_whole_patch(health):
    off = status_of(**{f"u{i}": Status.DISABLED for i in range(4)})
    assert health.judged(fed(health, status=off)) == ([], [])


def test_a_skin_that_has_stopped_is_red(health):
    record = fed(health)
    assert health.judged(record, silent_s=0.9) == ([], [])
    assert health.judged(record, silent_s=7.2) == (["no cycle for 7 s"], [])


def test_before_the_first_cycle_nothing_is_judged(health):
    record = snapshots(1, N)[0]
    record["cycle"], record["status"] = -1, int(Status.NEVER)
    assert health.judged(record) == ([], ["no cycle yet"])


def test_a_bus_that_is_off_is_red_and_one_with_errors_amber(health):
    dtype = snapshot_dtype(SimpleNamespace(n=N, buses=("a", "b"), robot=None), 16)
    record = np.zeros(1, dtype)[0]
    record["whole"] = 1
    for state, levels in (
        (BusState.ACTIVE, (0, 0)), (BusState.PASSIVE, (0, 1)), (BusState.BUS_OFF, (1, 0))
    ):  # fmt: skip
        record["bus_states"] = -1, BUS_STATES.index(state)
        assert tuple(map(len, health.judged(record))) == levels


def test_the_table_names_units_and_links_and_why():
    names, status = [f"a<b>{i}" for i in range(30)], np.zeros(30, np.uint16)
    status[3], status[10:] = int(Status.MAGNETIC_ANOMALY), int(Status.STALE | Status.UNTARED)
    patch = {"patch": np.zeros(30, int), "patch_names": ("skin",)}
    health = Health(SimpleNamespace(unit_names=names, cycle_rate_hz=250.0, **patch))
    records = snapshots(60, 30)
    records["stamp_ns"] = 10**18 + 40_000_000 * np.arange(60)
    records["cycles"], records["cycle"] = 10 * np.arange(60), 10 * np.arange(60)
    records["counters"][:, COUNTERS.index("data")] = 100 * np.arange(60)
    records["work_us"], records["status"] = np.arange(60), status
    records["test_ratio"] = np.nan
    records["test_ratio"][:, [3, 7]] = 3.456, 0.2
    for record in records:
        health.add(record)
    assert dict(health.rows(records[-1])) == {
        "units": "9 of 30 valid", "rate": "250 Hz of 250, 2500 frames/s", "losses": "none",
        "left out": "0 periods", "cycle time": "59 µs at most",
        "test ratio": "3.46 at most (a<b>3); 1 is the limit",
    }  # fmt: skip
    assert flagged(status, names, records[-1]["test_ratio"])[:2] == [
        ("a<b>3", "magnetic_anomaly, test ratio 3.46"), ("a<b>10", "stale")
    ]  # fmt: skip
    page = health.html(records[-1], [("thumb", "tip.stl: must be a mesh; got <none>")])
    for text in ("a&lt;b&gt;3", "and 9 more units", "link thumb", "got &lt;none&gt;"):
        assert text in page
