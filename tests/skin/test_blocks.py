"""Blocks hold what states show, to the bit, however they were made."""

from __future__ import annotations

import numpy as np
import pytest

import skin
from bus.frame import FRAME_DTYPE
from skin.blocks import CLOSED_BY
from skin.contact.record import CONTACT
from skin.state import Reading, if_wanted
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import frames_of
from tests.fixtures.logs import write

WANT = ("temperature", "force", "sigma", "wrench", "centroid", "contacts", "slip")


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """The same slide, whole and with what may happen to it."""
    folder = tmp_path_factory.mktemp("logs")
    frames = frames_of("palm", "slide", 600)
    frames["origin"] = 0
    cycle = np.cumsum(frames["id"] == 0x80)
    random = np.random.default_rng(1)
    lost = (random.random(frames.size) < 0.01) & (frames["id"] != 0x80)
    silent = (frames["id"] == frames["id"][3]) & (cycle > 100) & (cycle < 180)
    gap = (cycle > 400) & (cycle < 470)
    jitter = frames.copy()
    jitter["stamp_ns"] += random.integers(0, 3_000_000, frames.size)
    back = frames.copy()
    back["stamp_ns"][frames.size // 2 :] -= 3_600_000_000_000
    cases = {"whole": frames, "holed": frames[~(lost | silent | gap)], "jitter": jitter,
             "back": back}  # fmt: skip
    for name, some in cases.items():
        write(folder / f"{name}.log", some)
    return folder


def compare(log, **options):
    """Compare blocks with the states of the same log, value by value; contacts that were seen."""
    blocks = list(skin.decode_log("palm", log, **options).blocks(97))
    states = iter(skin.decode_log("palm", log, **options))
    seen = 0
    for block in blocks:
        for t in range(len(block)):
            state = next(states)
            assert (state.cycle, state.stamp_ns) == (block.cycle[t], block.stamp_ns[t])
            assert state.closed_by == CLOSED_BY[block.closed_by[t]]
            assert state.overruns == block.overruns[t]
            assert state.coverage == block.coverage[t]
            untracked = if_wanted(state, "untracked")
            assert (None if block.untracked is None else block.untracked[t]) == untracked
            same(block.totals[t], np.array(list(vars(state.counters).values())))
            for name in Reading.__slots__[:-2]:
                same(getattr(block.units, name), if_wanted(state.units, name), t)
            for name in ("wrench", "wrench_sigma", "centroid", "centroid_covariance", "label",
                         "slip", "sampled_ns"):  # fmt: skip
                same(getattr(block, name), if_wanted(state, name), t)
            if if_wanted(state, "contacts") is not None:
                found = block.contacts[block.contact_start[t] : block.contact_start[t + 1]]
                for record, contact in zip(found, state.contacts, strict=True):
                    for name in CONTACT.names:
                        same(record[name], contact.record[name])
                    seen += 1
    assert next(states, None) is None
    return seen


def same(block, state, t=None):
    if state is None:
        assert block is None
        return
    got = block if t is None else block[t]
    assert np.ascontiguousarray(got).tobytes() == np.ascontiguousarray(state).tobytes()


@long_after_first("name", ["whole", "holed", "jitter", "back"])
def test_blocks_are_the_states_of_the_log(logs, name):
    assert compare(logs / f"{name}.log", want=WANT) > 50


@long_after_first(
    "options",
    [
        {"want": "temperature"},
        pytest.param({"want": {"force"}, "auto_tare": False}, marks=pytest.mark.long),
        {"want": WANT, "auto_tare": False, "sweeps": 2},
        {"want": WANT, "auto_tare": False, "sweeps": 0},
        pytest.param({"want": WANT, "auto_tare": False, "ambient": False}, marks=pytest.mark.long),
        {"want": WANT, "auto_tare": False, "skip": True},
    ],
    ids=["temperature", "force", "two sweeps", "no sweeps", "no ambient", "skip"],
)
def test_blocks_are_the_states_whatever_is_decoded(logs, options):
    compare(logs / "whole.log", **options)


def test_blocks_are_the_states_with_shocks(logs):
    assert compare(logs / "whole.log", want=(*WANT, "shocks"), auto_tare=False) > 50


def test_a_unit_tells_the_identity_of_its_contact(logs):
    (block,) = skin.decode_log("palm", logs / "whole.log", want=WANT).blocks()
    t = int(np.flatnonzero(np.diff(block.contact_start))[0])
    touched = block.label[t] >= 0
    assert touched.any()
    first = block.contacts["id"][block.contact_start[t]]
    np.testing.assert_array_equal(block.contact_of_units[t], np.where(touched, first, 0))


def test_a_log_without_cycles_has_no_blocks(tmp_path):
    write(tmp_path / "empty.log", np.zeros(0, FRAME_DTYPE))
    assert list(skin.decode_log("palm", tmp_path / "empty.log").blocks()) == []
