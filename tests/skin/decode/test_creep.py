"""Forces that have not relaxed: against the integral itself, over gaps and starts, and on no unit
that has no terms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import detrend

from bus.status import Status
from skin.decode.decoder import Decoder
from skin.errors import OptionError
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import row_of, with_parameters
from tests.skin.decode.test_field_angle import counts_at

UNITS, RATE_HZ = 24, 50.0
WEIGHTS, TIMES_S = np.array([0.08, 0.05, 0.06]), np.array([0.1, 1.5, 20.0])
DIRECTION = np.linspace(-3.0, 3.0, UNITS)


def column(values):
    return np.asarray(values, float)[:, np.newaxis]


def creeping(normal=WEIGHTS, shear=0.7 * WEIGHTS, left=0.0, units=UNITS):
    """Units that relax; the last three of them do not."""
    own = np.arange(units) < units - 3
    return with_parameters(
        row_of(units, rate_hz=RATE_HZ),
        normal_creep_relative=column(normal) * own, normal_creep_s=column(TIMES_S),
        shear_creep_relative=column(shear) * own, shear_creep_s=column(TIMES_S),
        normal_creep_sigma_relative=left * own, shear_creep_sigma_relative=left * own,
    )  # fmt: skip


SKIN = creeping()
RELAXING = np.arange(UNITS) < UNITS - 3


def history(rng, cycles):
    """Depths and displacements (t, n) that change evenly from cycle to cycle, from rest."""
    corners = rng.uniform(0.0, 1.0, (cycles // 10 + 2, 2, UNITS))
    corners[:1] = 0.0
    at = np.arange(cycles) / 10.0
    low = at.astype(int)
    share = (at - low)[:, np.newaxis, np.newaxis]
    way = corners[low] * (1.0 - share) + corners[low + 1] * share
    return 1.5 * way[:, 0], 1.8 * way[:, 1]


def integral(time_s, elastic, weights, times_s):
    """F_e + sum of w_j integral exp(-(t - s) / T_j) dF_e, each piece in closed form."""
    slope = np.diff(elastic, axis=0) / np.diff(time_s)[:, None, None]
    total = elastic.copy()
    for i, now in enumerate(time_s):
        for weight, tau in zip(weights, times_s, strict=True):
            since = np.exp(-(now - time_s[: i + 1]) / tau)
            total[i] += weight * tau * np.einsum("s,san->an", np.diff(since), slope[:i])
    return total


def run(decoder, raw, gaps=None):
    """What single cycles show; `gaps` in periods before each."""
    found = []
    for i, counts in enumerate(raw):
        elapsed_s = None if gaps is None or i == 0 else gaps[i] / RATE_HZ
        found.append(decoder(counts, elapsed_s=elapsed_s).force.copy())
    return np.array(found)


@long_after_first("dtype", ["float32", "float64"])
def test_forces_are_those_of_the_integral(dtype):
    """On each axis, with gaps; units without terms bear the elastic force alone."""
    rng = np.random.default_rng(3)
    depth, reach = history(rng, 120)
    gaps = rng.choice([0.5, 1.0, 1.25, 3.0, 40.0], 120)
    raw = counts_at(SKIN, depth, reach, DIRECTION)
    plain = run(Decoder(SKIN, dtype=dtype, creep=False, sweeps=0, ambient=False), raw).astype(float)
    got = run(Decoder(SKIN, dtype=dtype, sweeps=0, ambient=False), raw, gaps)
    time_s = np.cumsum(gaps) / RATE_HZ
    tangential = integral(time_s, plain[:, :2], 0.7 * WEIGHTS, TIMES_S)
    normal = integral(time_s, plain[:, 2:], WEIGHTS, TIMES_S)
    expected = np.concatenate([tangential, normal], axis=1)
    close = 2e-6 if dtype == "float32" else 1e-9
    np.testing.assert_allclose(got[..., RELAXING], expected[..., RELAXING], atol=close * 10.0)
    assert np.abs(expected - plain)[..., RELAXING].max() > 0.2
    np.testing.assert_array_equal(got[..., ~RELAXING], plain[..., ~RELAXING].astype(dtype))


def test_without_terms_or_when_not_wanted_nothing_is_there():
    bare = row_of(UNITS, rate_hz=RATE_HZ)
    raw = counts_at(bare, 1.0, 1.0, DIRECTION)
    off = Decoder(SKIN, creep=False, sweeps=0, ambient=False)
    for decoder in (
        Decoder(bare, sweeps=0, ambient=False),
        off,
        Decoder(SKIN, {"temperature", "displacement"}, sweeps=0, ambient=False),
    ):
        assert decoder.creep is None
        assert not decoder.plan.creep
    np.testing.assert_array_equal(off(raw).force, Decoder(bare, sweeps=0, ambient=False)(raw).force)
    with pytest.raises(OptionError, match="creep: must be True or False; got 1"):
        Decoder(SKIN, creep=1, sweeps=0, ambient=False)


def test_a_run_that_starts_under_load_shows_what_it_cannot_know():
    """Anything from the elastic force to that of a fresh load is equally likely."""
    raw = counts_at(SKIN, 1.5, 1.0, DIRECTION)
    plain = Decoder(SKIN, creep=False, dtype="float64", sweeps=0, ambient=False)(raw)
    reading = Decoder(SKIN, dtype="float64", sweeps=0, ambient=False)(raw)
    fresh = WEIGHTS.sum()
    normal, elastic = reading.force[2, RELAXING], plain.force[2, RELAXING]
    np.testing.assert_allclose(normal, (1.0 + 0.5 * fresh) * elastic)
    # each term is spread evenly from 0 to w F, for itself
    spread = np.sqrt(np.sum(WEIGHTS**2) / 12.0) * elastic
    noise = plain.force_sigma[2, RELAXING]
    assert (reading.force_sigma[2, RELAXING] >= np.hypot(spread, noise)).all()
    decoder = Decoder(SKIN, dtype="float64", sweeps=0, ambient=False)
    for _ in range(4):
        later = decoder(raw, elapsed_s=5.0 * TIMES_S.max())
    np.testing.assert_allclose(later.force[2, RELAXING], elastic, rtol=1e-2)
    assert (later.force_sigma[2, RELAXING] < 1.2 * noise).all()


def test_sigma_holds_what_a_gap_hides():
    """A step somewhere in a gap: over even chances, the mean and the spread are those told."""
    weights, gap_s = np.array([0.3, 0.0, 0.0]), 0.25
    skin = creeping(weights, weights)
    raw = counts_at(skin, np.array([[0.0], [1.5]]), 0.0, DIRECTION)
    decoder = Decoder(skin, dtype="float64", sweeps=0, ambient=False)
    decoder(raw[0])
    reading = decoder(raw[1], elapsed_s=gap_s)
    elastic = Decoder(skin, creep=False, dtype="float64", sweeps=0, ambient=False)(raw[1])
    went = (
        elastic.force[2, 0]
        - Decoder(skin, creep=False, dtype="float64", sweeps=0, ambient=False)(raw[0]).force[2, 0]
    )

    def left(since_s):
        return 0.3 * went * np.exp(-since_s / TIMES_S[0])

    mean = quad(left, 0.0, gap_s)[0] / gap_s
    variance = quad(lambda s: (left(s) - mean) ** 2, 0.0, gap_s)[0] / gap_s
    assert reading.force[2, 0] == pytest.approx(elastic.force[2, 0] + mean, rel=1e-4)
    sharper = 1.0 + mean / went
    expected = np.hypot(sharper * elastic.force_sigma[2, 0], np.sqrt(variance))
    assert reading.force_sigma[2, 0] == pytest.approx(expected, rel=1e-3)


def test_sigma_holds_noise_and_what_the_terms_leave():
    """Noise of a reading counts as often as a sudden step does; what is left goes with the load."""
    skin, rng = creeping(left=0.05), np.random.default_rng(2)
    depth = np.append(0.0, np.ones(400))[:, np.newaxis]
    noisy = counts_at(skin, depth, depth, DIRECTION, noise=rng)
    exact = Decoder(creeping(), dtype="float64", sweeps=0, ambient=False)
    forces = run(exact, noisy)[100:, :, RELAXING]
    told = exact.reading.force_sigma[:, RELAXING]
    noise = detrend(forces, axis=0).std(axis=(0, 2))  # of what still relaxes
    np.testing.assert_allclose(noise, np.sqrt((told**2).mean(axis=1)), rtol=0.1)
    some, none = (
        Decoder(skin, dtype="float64", sweeps=0, ambient=False),
        Decoder(creeping(), dtype="float64", sweeps=0, ambient=False),
    )
    rested = counts_at(skin, depth[:1], depth[:1], DIRECTION)[0]  # nothing relaxes but the step
    for counts in (rested, noisy[1]):
        a, b = some(counts), none(counts)
    elastic = Decoder(skin, creep=False, dtype="float64", sweeps=0, ambient=False)(noisy[1]).force
    more = np.sqrt(a.force_sigma**2 - b.force_sigma**2)[:, RELAXING]
    np.testing.assert_allclose(more, 0.05 * np.abs(elastic[:, RELAXING]), rtol=1e-2, atol=1e-9)


def test_units_that_are_skipped_are_untouched_and_those_never_heard_begin_later():
    rows = np.array([[0.0], [1.5], [1.5], [0.0], [1.5]])
    raw = counts_at(SKIN, rows, 0.6 * rows, DIRECTION)
    whole, skipping = (
        Decoder(SKIN, sweeps=0, ambient=False),
        Decoder(SKIN, skip=True, sweeps=0, ambient=False),
    )
    shown = run(skipping, raw)
    assert np.isnan(shown[[0, 3], :2]).all()
    idle = skipping(raw[0])
    for name in ("tangential", "theta", "tangential_sigma", "theta_sigma"):
        assert np.isnan(getattr(idle, name)).all(), name
    assert np.isfinite(idle.force_sigma[2]).all()
    np.testing.assert_allclose(shown[[1, 2, 4], 2], run(whole, raw)[[1, 2, 4], 2], rtol=1e-6)
    np.testing.assert_allclose(
        shown[[1, 2, 4]], run(Decoder(SKIN, sweeps=0, ambient=False), raw)[[1, 2, 4]], atol=2e-2
    )
    late = Decoder(SKIN, sweeps=0, ambient=False)
    never = np.full(UNITS, Status.NEVER, np.uint16)
    assert np.isnan(late(raw[0], never).force).all()
    late(raw[1], never)
    np.testing.assert_array_equal(
        late(raw[1]).force, Decoder(SKIN, sweeps=0, ambient=False)(raw[1]).force
    )
