"""What a scene needs, and no more: the plan, blocks skipped, backgrounds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.status import Status
from skin.decode.decoder import Decoder
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import calibrated, row_of, sensible_counts
from tests.skin.decode.test_field_angle import counts_at

seeds = st.integers(0, 2**32 - 1)
FIELDS = ("temperature", "force", "tangential", "theta", "displacement_mm", "field_ut",
          "force_sigma", "displacement_sigma_mm", "tangential_sigma", "theta_sigma")  # fmt: skip
TANGENTIAL = (("tangential", None), ("theta", None), ("force", slice(0, 2)), ("field_ut", None),
              ("displacement_mm", slice(0, 2)), ("force_sigma", slice(0, 2)),
              ("tangential_sigma", None), ("theta_sigma", None))  # fmt: skip


def scene(n, seed, cycles=24, quiet=0.6):
    """Presses that come and go over stretches of units, with a held count now and then."""
    rng = np.random.default_rng(seed)
    skin = row_of(n, rate_hz=100.0)
    time = np.arange(cycles)[:, np.newaxis]
    middle = rng.uniform(0, n) + rng.uniform(-1.0, 1.0) * time
    wide = rng.uniform(2.0, 30.0)
    depth = 1.5 * np.maximum(1.0 - np.abs(np.arange(n) - middle) / wide, 0.0)
    depth = np.where(time % 9 < quiet * 9, 0.0, depth)
    raw = counts_at(skin, depth, 1.2 * depth, np.full(depth.shape, rng.uniform(-3.0, 3.0)))
    raw[:, 0] += rng.integers(-20, 20, (cycles, n)).astype(np.int16)
    for t in range(1, cycles):
        if rng.random() < 0.3:
            raw[t] = raw[t - 1]
    status = np.where(rng.random((cycles, n)) < 0.02, Status.LATE, 0).astype(np.uint16)
    status[: cycles // 3, :3] = Status.NEVER
    return skin, raw, status


# -- skipping --------------------------------------------------------------------------------------


@pytest.mark.long
@settings(max_examples=20)
@given(seeds, st.sampled_from([5, 64, 128, 150, 300]), st.sampled_from(["sine", "field-angle"]))
def test_skipping_changes_no_bit_of_what_it_shows(seed, n, estimator):
    """Cycle by cycle against the full pass; what is idle is NaN where it was not looked at."""
    assert idle_beside_full(*scene(n, seed), estimator) > 0


@long_after_first(("n", "seed"), [(20, 1), (20, 2), (40, 3), (150, 4)])
def test_a_few_cycles_skip_as_many_do(n, seed):
    """Of one group of units, of some, and of more than a block."""
    idle_beside_full(*scene(n, seed, cycles=10), "field-angle")


def idle_beside_full(skin, raw, status, estimator):
    """How often a unit was idle, in cycles that are compared with the full pass."""
    skipping = Decoder(skin, None, estimator, skip=True, sweeps=0, ambient=False)
    full = Decoder(skin, None, estimator, sweeps=0, ambient=False)
    idle = 0
    for counts, flags in zip(raw, status, strict=True):
        some, every = skipping(counts, flags), full(counts, flags)
        resting = some.status & Status.IDLE != 0
        idle += resting.sum()
        seen = ~resting & (flags & Status.NEVER == 0)
        for name in FIELDS:
            a, b = getattr(some, name), getattr(every, name)
            assert a[..., seen].tobytes() == b[..., seen].tobytes(), name
        np.testing.assert_array_equal(some.status[seen], every.status[seen])
        np.testing.assert_array_equal(some.valid, every.valid | (resting & some.valid))
        np.testing.assert_array_equal(some.temperature, every.temperature)
        np.testing.assert_array_equal(some.force[2], every.force[2])
        np.testing.assert_array_equal(some.displacement_sigma_mm[2], every.displacement_sigma_mm[2])
        for name, rows in TANGENTIAL:
            values = getattr(some, name)
            assert np.isnan((values if rows is None else values[rows])[..., resting]).all()
        limit = 2.9 * 6.01 / 900.0 + 1e-3
        assert np.all(every.displacement_mm[2][resting] <= limit)
    return idle


def test_idle_is_not_untouched_and_not_invalid():
    skin = row_of(16, rate_hz=100.0)
    raw = counts_at(skin, np.zeros(16), 0.0, 0.0)
    reading = Decoder(skin, skip=True, sweeps=0, ambient=False)(raw)
    assert reading.status.tolist() == [Status.IDLE] * 16
    assert reading.valid.all()
    assert np.isnan(reading.force[:2]).all()
    assert np.isfinite(reading.force[2]).all()
    pressed = counts_at(skin, np.where(np.arange(16) == 3, 0.1, 0.0), 0.0, 0.0)
    assert not Decoder(skin, skip=True, sweeps=0, ambient=False)(pressed).status.any()


# -- background ------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("estimator", ["sine", "field-angle"])
def test_a_background_is_taken_off_the_counts(dtype, estimator, request):
    """Counts that are higher by whole steps, and a background that the chip reads as that."""
    if estimator == "sine":
        request.getfixturevalue("interpreted")
    skin = calibrated(row_of(50), seed=5)
    raw = sensible_counts(skin, 3, 6, most=0.8)
    steps = np.random.default_rng(7).integers(-60, 60, (4, 50))
    moved = raw.copy()
    moved[:, 1] -= steps[0].astype(np.int16)
    moved[:, 2:5] += steps[1:].astype(np.int16)
    warmer = skin.scale[5] * raw[:, 5] + skin.offset[5] - skin.parameters["hall_reference_c"]
    background = np.tile(steps * skin.scale[1:5], (3, 1, 1))
    background[:, 1:] /= (1.0 + skin.parameters["hall_gain_per_k"] * warmer)[:, np.newaxis]
    background = background.astype(dtype)
    plain = Decoder(skin, None, estimator, dtype=dtype, sweeps=0, ambient=False)(raw)
    taken = Decoder(skin, None, estimator, dtype=dtype, sweeps=0, ambient=False)(
        moved, None, background
    )
    limit = 2e-5 if dtype == "float32" else 1e-9
    for name in ("force", "displacement_mm", "tangential"):
        assert np.abs(getattr(plain, name) - getattr(taken, name)).max() <= limit, name
    assert np.abs(plain.field_ut - taken.field_ut).max() <= (1e-2 if dtype == "float32" else 1e-8)
    live = Decoder(skin, None, estimator, dtype=dtype, sweeps=0, ambient=False)
    for t in range(3):
        one = live(moved[t], None, background[t])
        np.testing.assert_array_equal(one.force, taken.force[t])
