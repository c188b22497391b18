"""What a decoder that skips leaves out: never a unit that something presses."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest

import skin
from benchmarks import skip as benchmark
from benchmarks import timing
from bus.status import Status
from skin.decode.decoder import Decoder
from skin.options import Options
from tests.fixtures.decode import row_of
from tests.skin.decode.test_field_angle import counts_at


@pytest.mark.usefixtures("interpreted")
def test_only_temperatures_are_never_idle():
    skin = row_of(64, rate_hz=100.0)
    raw = counts_at(skin, np.zeros(64), 0.0, 0.0)
    for want, idle in (({"temperature"}, False), ({"force"}, True)):
        status = Decoder(skin, want, skip=True, sweeps=0, ambient=False)(raw).status
        assert (status & Status.IDLE != 0).tolist() == [idle] * 64


def test_a_live_skin_that_skips_tells_the_same_contacts():
    """Its ambient field is looked at less often: forces differ by a part of their noise."""
    shown = []
    for skip in (False, True):
        with skin.open("palm", simulate=True, pace=False, options=skin.Options(skip=skip)) as palm:
            states = itertools.islice(palm, 300)
            shown.append([
                (s.wrench.copy(), s.label.copy(), s.units.status.copy()) for s in states
            ])  # fmt: skip
    idle = False
    for (wrench, label, _), (skipped, same, status) in zip(*shown, strict=True):
        np.testing.assert_array_equal(label, same)
        np.testing.assert_allclose(skipped[:3], wrench[:3], atol=0.05)
        idle |= bool((status & Status.IDLE).any())
    assert idle
    assert shown[0][-1][0][2] < -1.0  # something is pressed in the end


@pytest.mark.long
def test_both_sides_of_the_benchmark_decode_each_cycle_as_often_as_a_skin_does(monkeypatch):
    monkeypatch.setattr(benchmark, "CYCLES", 6)
    decoded, run = [], Decoder.step

    def counted(self, *inputs, **options):
        decoded.append(self)
        run(self, *inputs, **options)

    monkeypatch.setattr(Decoder, "step", counted)
    plate = benchmark.plate(64)
    counts = benchmark.counts_of(plate, 0.25)
    sides, others = benchmark.sides_of(plate), benchmark.sides_of(plate)
    calls = benchmark.calls_of(sides, counts)
    assert [*calls] == ["default", "skip", "default decoding", "skip decoding"]
    for name, call in calls.items():
        skips, one = name.startswith("skip"), others[name]
        decoded.clear()
        call()
        taken = len(decoded)
        decoded.clear()
        if name.endswith("decoding"):
            assert sides[name].plan == Decoder(plate, sweeps=1, ambient=True, skip=skips).plan
            for cycle in counts:
                one(cycle)
            told = sides[name].reading, one.reading
        else:
            assert sides[name].pipeline.options == Options(skip=skips)
            for cycle in counts:
                one.pipeline.state(one.load(cycle))
            told = sides[name].pipeline.decoder.reading, one.pipeline.decoder.reading
        assert taken == len(decoded) >= len(counts) == 6, name
        np.testing.assert_array_equal(told[0].force, told[1].force)


@pytest.mark.long
def test_the_benchmark_compares_what_it_times(monkeypatch):
    monkeypatch.setattr(benchmark, "SIZES", (64,))
    monkeypatch.setattr(benchmark, "SHARES", (0.0, 1.0))
    monkeypatch.setattr(benchmark, "SINGLE", ("temperature",))
    monkeypatch.setattr(timing, "ROUNDS", 2)
    figures = json.loads(json.dumps(benchmark.run(quick=True)))
    shares = figures["sizes"]["64"]["shares"]
    assert shares["0"]["idle"] > 0.8
    assert shares["100"]["idle"] == 0.0
    assert shares["100"]["off_n"] == 0.0
    assert 0.0 < shares["0"]["off_n"] < 0.05  # within what a unit at rest reads by noise
    assert "default us" in benchmark.table(figures)
    assert figures["idle_ratio"] == figures["idle_ratio_64"] == shares["0"]["ratio"] > 0.0
    monkeypatch.setattr(benchmark, "_differ", lambda told, left_out: 3)
    with pytest.raises(AssertionError, match="3 values"):
        benchmark.run(quick=True)
