"""The harness of damaged logs finds what a reader does wrong, and nothing else."""

from __future__ import annotations

import random

import pytest

from benchmarks.readers import SEEDS, results
from benchmarks.readers_damage import WAYS


@pytest.mark.parametrize(
    ("plant", "expected"),
    [("", "whole"), ("wrong", "wrong"), ("lost", "wrong"), ("crash", "crash"), ("hang", "hang")],
)
def test_a_planted_fault_is_found(plant, expected, tmp_path):
    raw = (SEEDS / "seed.log").read_bytes()
    found = results("ours", "log", [("no damage", raw, list(range(72)))], tmp_path, plant)
    assert [outcome for outcome, _ in found] == [expected]


@pytest.mark.parametrize("suffix", ["log", "asc", "trc", "blf"])
def test_each_kind_of_damage_is_read_whole_or_told(suffix, tmp_path):
    raw, chance = (SEEDS / f"seed.{suffix}").read_bytes(), random.Random(11)
    files = [(way, *damage(suffix, raw, chance)) for way, damage in WAYS[suffix].items()]
    found = [outcome for outcome, _ in results("ours", suffix, files, tmp_path)]
    assert set(found) <= {"whole", "told"}
    assert "told" in found
