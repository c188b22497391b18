"""A channel that lies: found within the delay that the docs state, and no healthy unit with it."""

from __future__ import annotations

import pytest

from benchmarks.channels import TRIALS, measure, motion, play
from topology import load

FOUND = {
    # of exact units: channel, fault: longest delay in ms, force in newton that passes until then
    ("gel", "stuck"): (450, 0.01),
    ("gel", "stuck, last bit turns"): (450, 0.01),
    ("frequency", "stuck"): (200, 0.8),
    ("frequency", "stuck, last bit turns"): (204, 0.8),
    ("frequency", "stuck, noise goes on"): (1000, 0.9),
    ("frequency", "3 % too low"): (1200, 0.7),
    ("frequency", "3 % too high"): (1200, 0.7),
    ("bx", "stuck"): (200, 0.15),
    ("by", "stuck"): (200, 0.15),
    ("bz", "stuck"): (200, 0.15),
    ("bz", "turned round"): (1000, 5.0),
}
PASSES = {("hall_temperature", "stuck"): 0.005, ("gel", "5 % too high"): 0.005}
"""Faults that nothing finds, and the force that they cost."""


@pytest.fixture(scope="module")
def sound():
    skin = load("palm").exact()
    counts = motion(skin, 700, seed=11)
    return skin, counts, play(skin, counts)


def test_healthy_units_are_not_flagged(sound):
    assert not sound[2].status.any()


@pytest.mark.long
@pytest.mark.parametrize(("channel", "fault"), [*FOUND, *PASSES])
def test_a_channel_that_lies_is_found_in_time_or_costs_little(channel, fault, sound):
    (trial,) = (one for one in TRIALS if (one.channel, one.fault) == (channel, fault))
    row = measure(sound[0], trial, *sound[1:])
    if (channel, fault) in PASSES:
        assert row["passes_n"] < PASSES[channel, fault]
        assert row["valid_share"] > 0.99
        return
    delay_ms, force = FOUND[channel, fault]
    assert row["units_found"] == row["units"]
    assert row["delay_ms_max"] <= delay_ms
    assert row["passes_n"] < force


@pytest.mark.parametrize("channel", ["gel", "frequency", "bz"])
def test_nominal_units_are_watched_as_exact_ones_where_a_channel_stands_still(channel):
    skin = load("palm")
    counts = motion(skin, 400, seed=12)
    (trial,) = (one for one in TRIALS if (one.channel, one.fault) == (channel, "stuck"))
    row = measure(skin, trial, counts, play(skin, counts))
    assert row["units_found"] == row["units"]
    assert row["delay_ms_max"] <= (450 if channel == "gel" else 204)
