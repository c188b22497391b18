"""The benchmark of scale counts what is lost, and asks for the buses that a check asks for."""

from __future__ import annotations

import dataclasses
import json
import time

import numpy as np
import pytest

from bus.linux import has_batches

if not has_batches():
    pytest.skip("needs a 64-bit Linux", allow_module_level=True)

from benchmarks import scale
from benchmarks.scale_units import LAP, most_rows, on_fewest_buses, simulate, strip
from skin.pipeline import Pipeline
from topology import TopologyError


@pytest.fixture(scope="module")
def small():
    """Fifteen units on one bus, and what is played of them."""
    skin = on_fewest_buses(5, 3, 250.0)
    return skin, simulate(skin)


def test_skins_take_as_many_buses_as_the_budget_asks():
    assert [len(on_fewest_buses(*shape, 250.0).buses) for shape in scale.SKINS.values()] == [
        1, 3, 14
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


@pytest.mark.parametrize("way", scale.WAYS)
def test_what_is_sent_is_shown(small, way, monkeypatch):
    monkeypatch.setattr(scale, "WARM_S", 0.1)
    row = scale.measure(*small, way, 0.4)
    frames = len(small[0].frames)
    assert row["cycles"] == row["periods"] - row["left_out"] == 100
    assert row["lost"] <= frames * row["left_out"], "only what a busy machine was not ready for"
    assert row["sent"] + 3 * row["late"] >= 100 * frames > 0
    assert row["cpu_share"] > 0.0


@pytest.mark.parametrize("way", ["process", "sockets"])
def test_a_host_too_slow_for_its_units_loses_what_it_never_asks_for(small, way, monkeypatch):
    monkeypatch.setattr(scale, "WARM_S", 0.1)
    state = Pipeline.state

    def slow(self, *given):
        time.sleep(0.03)
        return state(self, *given)

    monkeypatch.setattr(Pipeline, "state", slow)
    row = scale.measure(*small, way, 0.1)
    assert row["left_out"] >= 6 * row["cycles"], "a cycle takes 7.5 periods at least"
    unseen = row["lost"] + row["held_up"]  # those of units that a busy machine held up do not count
    assert unseen >= 0.5 * len(small[0].frames) * row["left_out"]
    assert row["periods"] >= row["late"] >= 0.5 * row["left_out"]


def test_a_frame_that_is_dropped_or_forged_is_counted(small, monkeypatch):
    """By what stands in the states, not by counters of the receiver."""
    skin, units = small
    monkeypatch.setattr(scale, "WARM_S", 0.1)
    played = scale._InProcess(units)
    send = played.ends[0].send

    def forget(records):
        if int(records["data"][0, 0]) == 60:
            units_sent = played._frames[0]
            played._frames = [np.delete(units_sent, 1, axis=1)]
            taken = send(records)
            played._frames = [units_sent]
            played._sent[-1] += 1
            return taken
        return send(records)

    monkeypatch.setattr(played.ends[0], "send", forget)
    with scale.product.open(skin, transports=played.ends) as live:
        seen = scale._watch(live, played, 20, 80)
    row = scale.judge(skin, units, seen, *played.tell())
    never = int(seen.left_out.sum())
    assert (row["lost"] - len(skin.frames) * never, row["late"] - never) == (1, 1)
    seen.temperature[50, 7] += 0.01
    assert scale.judge(skin, units, seen, *played.tell())["lost"] == row["lost"] + 1


def test_frames_that_the_units_held_up_are_nobodys_loss(small):
    skin, units = small
    expected = scale.Decoder(skin, {"temperature"})(units.counts).temperature
    seen = scale._Seen(10, skin.n)
    seen.number[:] = np.arange(1, 11)
    seen.temperature[:] = expected[1:11]
    seen.complete[:] = True
    sent = np.full(11, len(skin.frames))
    on_time = sent.copy()
    on_time[4] = 0
    seen.temperature[[3, 4, 7]] = np.nan
    seen.complete[[3, 4, 7]] = False
    row = scale.judge(skin, units, seen, sent, on_time)
    frames = len(skin.frames)
    expected = {"periods": 10, "left_out": 0, "late": 1, "sent": 10 * frames,
                "held_up": 2 * frames, "lost": frames}  # fmt: skip
    assert row == expected
    seen.left_out[[3, 4, 7]] = 1, 2, 3  # cycles 4 and 5 are held up
    left = {"periods": 16, "left_out": 6, "late": 4, "lost": 4 * frames}
    assert scale.judge(skin, units, seen, sent, on_time) == expected | left


def test_table_shows_every_row_and_what_others_publish(small, monkeypatch):
    monkeypatch.setattr(scale, "measure", lambda *_: dataclasses.asdict(_Row()))
    monkeypatch.setattr(scale, "simulate", lambda _: None)
    figures = json.loads(json.dumps(scale.run(quick=True)))
    assert figures["lost_frames"] == 9
    assert figures["late_share"] == 0.2
    assert figures["held_up_share"] == 0.1
    assert figures["cpu_share_1260"] == 0.25
    text = scale.table(figures)
    assert len(text.splitlines()) == 1 + 4 * 3 + 2
    assert "TUM" in text


@dataclasses.dataclass
class _Row:
    cycles: int = 10
    periods: int = 10
    left_out: int = 1
    late: int = 2
    lost: int = 1
    sent: int = 130
    held_up: int = 13
    cpu_share: float = 0.25
    cycle_ms: dict = dataclasses.field(default_factory=lambda: {"p50": 4, "p99": 5, "max": 6})
    work_us: dict = dataclasses.field(default_factory=lambda: {"p50": 40, "p99": 50, "max": 60})
