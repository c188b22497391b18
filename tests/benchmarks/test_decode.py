"""The decoding benchmark runs, and its peers decode the same thing."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import decode, timing
from benchmarks.peers_decode import ROWS, array_of, counts_of, exact, numpy_decode
from skin.state import UNIT_WANTS


@pytest.mark.usefixtures("interpreted")
def test_benchmark_gives_errors_beside_times(monkeypatch):
    monkeypatch.setattr(decode, "SIZES", (48,))
    monkeypatch.setattr(decode, "CALIBRATED", 96)
    monkeypatch.setattr(decode, "LATTICE", 4)
    for quantities in ("NINE", "LIVE"):  # all of them: kernels that other tests have as well
        monkeypatch.setattr(decode, quantities, set(UNIT_WANTS))
    monkeypatch.setattr(timing, "ROUNDS", 2)
    figures = json.loads(json.dumps(decode.run(quick=True)))
    for name in ("copy_floor_ratio", "ns_per_unit_calibrated", "ns_per_unit_full", "numpy_ratio",
                 "literal_ratio"):  # fmt: skip
        assert figures[name] > 0.0, name
    found = figures["sizes"]["48"]
    limits = {"numpy": 1e-9, "paper": 2e-3, "float64": 1e-9, "float32": 2e-5}
    for name, row in found["decoders"].items():
        assert row["error_n"] <= limits[name.split()[0]], name
        assert row["ns_per_unit"] >= row["ns_fastest"] > 0.0
    assert all(row["error_n"] <= 2e-5 for row in figures["calibrated"].values())
    text = decode.table(figures)
    assert all(name in text for name in (*found["decoders"], *figures["calibrated"]))


def test_repeated_array_keeps_every_unit_on_its_wire():
    skin = array_of(150, alike=False)
    slots = skin.frames.units[skin.frames.units >= 0]
    np.testing.assert_array_equal(np.sort(slots), np.arange(150))


def test_numpy_is_the_model_in_float64():
    skin = array_of(64, alike=False)
    counts = counts_of(skin)
    units = np.arange(0, 64, 9)
    truth = exact(skin, counts, units)
    assert truth.shape == (len(ROWS), units.size)
    np.testing.assert_allclose(numpy_decode(skin, counts)[:, units], truth, atol=1e-11)


def test_both_estimators_are_told_of_one_displacement():
    """The counts of the benchmark are of units whose field agrees with both laws."""
    skin = array_of(64, alike=False)
    units = np.arange(0, 64, 7)
    one, other = (exact(skin, counts_of(skin), units, name) for name in ("sine", "field-angle"))
    np.testing.assert_allclose(one[1:5], other[1:5], atol=0.06)
    assert np.abs(one[4] - other[4]).max() > 0.0
    assert one[4] == pytest.approx(other[4], abs=0.06)
