"""The decoding benchmark runs, and its peers decode the same thing."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from benchmarks import decode, peers_bare, timing
from benchmarks.peers_bare import Bare
from benchmarks.peers_decode import ROWS, array_of, counts_of, exact, numpy_decode
from skin.decode.decoder import Decoder

needs_compiler = pytest.mark.skipif(
    peers_bare.compiler() is None, reason="needs a C compiler: apt-get install gcc"
)


@pytest.mark.usefixtures("interpreted")
def test_benchmark_gives_errors_beside_times(monkeypatch):
    monkeypatch.setattr(decode, "SIZES", (48,))
    monkeypatch.setattr(decode, "CALIBRATED", 96)
    monkeypatch.setattr(decode, "LATTICE", 4)
    monkeypatch.setattr(decode, "CYCLES", 64)
    monkeypatch.setattr(timing, "ROUNDS", 2)
    figures = json.loads(json.dumps(decode.run(quick=True)))
    for name in ("bare_ratio", "bare_ratio_default", "ns_per_unit_calibrated", "ns_per_unit_full",
                 "numpy_ratio", "literal_ratio"):  # fmt: skip
        assert figures[name] > 0.0, name
    found = figures["sizes"]["48"]
    limits = {"numpy": 1e-9, "paper": 2e-3, "float64": 1e-9, "float32": 2e-5}
    for name, row in found["decoders"].items():
        assert row["error_n"] <= limits[name.split()[0]], name
        assert row["ns_per_unit"] >= row["ns_fastest"] > 0.0
    assert all(row["error_n"] <= 2e-5 for row in figures["calibrated"].values())
    text = decode.table(figures)
    assert all(name in text for name in (*found["decoders"], *figures["calibrated"]))


@needs_compiler
@pytest.mark.usefixtures("interpreted")
def test_bare_arithmetic_gives_what_the_decoder_gives():
    """Units of the benchmark, whose every parameter that the C reads differs here."""
    skin = array_of(96, alike=False)
    rng = np.random.default_rng(5)
    turned = {
        "field_xx": 1.05, "field_xy": 0.03, "field_yx": -0.02, "field_yy": 0.97,
        "hall_offset_x_ut": 150.0, "hall_offset_y_ut": -90.0, "hall_gain_per_k": 1e-3,
        "film_drift_per_k": -1.1e-3, "field_growth_per_mm": 0.41,
    }  # fmt: skip
    turned["gel_current_20c_ua"] = skin.parameters["gel_current_20c_ua"]
    varied = {name: value * rng.uniform(0.98, 1.02, skin.n) for name, value in turned.items()}
    skin = dataclasses.replace(skin, parameters=skin.parameters | varied)
    counts = counts_of(skin, most=0.8)
    reading = Decoder(
        skin,
        {"temperature", "force"},
        "sine",
        "float64",
        consistency=False,
        sweeps=0,
        ambient=False,
    )(counts)
    got = Bare(skin)(counts)
    np.testing.assert_allclose(got[0], reading.temperature, atol=1e-4)
    np.testing.assert_allclose(got[1:], reading.force, atol=2e-5)


@needs_compiler
def test_to_load_the_bare_arithmetic_leaves_the_processor_as_it_was():
    """Denormal numbers are numbers yet: what else runs in the process counts on them."""
    Bare(array_of(16, alike=False))
    assert np.float64(5e-324) * np.float64(1.0) > 0.0
    assert np.nextafter(np.float32(0.0), np.float32(1.0)) * np.float32(2.0) > 0.0


@needs_compiler
def test_bare_arithmetic_takes_whole_blocks_alone():
    with pytest.raises(SystemExit, match="multiple of 16 units; got 50"):
        Bare(array_of(50, alike=False))


def test_without_a_compiler_nothing_is_said_of_the_processor(monkeypatch):
    monkeypatch.setattr(peers_bare.shutil, "which", lambda command: None)
    peers_bare._kernel.cache_clear()
    assert peers_bare.compiler() is None
    with pytest.raises(SystemExit, match="bare: must have a C compiler"):
        Bare(array_of(16, alike=False))


def test_a_ratio_is_of_rounds_that_took_turns():
    """A slow spell that hits both of a round is in neither."""
    spell = np.linspace(1.0, 9.0, 15)
    one, other = (timing.Timed(0.0, 0.0, factor * spell) for factor in (3.0, 2.0))
    assert timing.ratio(one, other) == pytest.approx((1.5, 1.5, 1.5))
    value, low, high = timing.ratio(timing.Timed(0.0, 0.0, np.arange(1.0, 16.0)),
                                    timing.Timed(0.0, 0.0, np.ones(15)))  # fmt: skip
    assert (value, low, high) == (8.0, 4.0, 12.0)


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
