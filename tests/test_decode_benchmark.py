"""The decoding benchmark runs, and its peers decode the same thing."""

from __future__ import annotations

import json

import numpy as np

from benchmarks import decode
from benchmarks.peers_decode import ROWS, array_of, counts_of, exact, numpy_decode


def test_benchmark_gives_errors_beside_times(monkeypatch):
    monkeypatch.setattr(decode, "SIZES", (48,))
    figures = decode.run(quick=True)
    found = json.loads(json.dumps(figures))["sizes"]["48"]
    assert {"numpy_ratio", "literal_ratio", "copy_floor_ratio"} <= set(found)
    limits = {"numpy": 1e-9, "paper": 2e-3, "float64": 1e-9, "float32": 2e-5}
    for name, row in found["decoders"].items():
        assert row["error_n"] <= limits[name.split()[0]], name
        assert row["ns_per_unit"] > 0.0
    text = decode.table(figures)
    assert all(name in text for name in found["decoders"])


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
