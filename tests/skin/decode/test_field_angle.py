"""R from the angle of the field: against 40 digits, its laws, its end, what it does not feel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.status import Status
from skin.decode.decoder import Decoder
from skin.decode.model import field_angle_ends
from skin.errors import CalibrationError, OptionError
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import (
    amplitude_of,
    angle_of,
    any_counts,
    calibrated,
    row_of,
    with_parameters,
)

seeds = st.integers(0, 2**32 - 1)
dtypes = st.sampled_from(["float32", "float64"])


def angled(skin, **options):
    return Decoder(skin, None, "field-angle", **{"sweeps": 0, "ambient": False} | options)


def counts_at(skin, depth, reach, direction, temperature=25.0, gain=1.0, noise=None):
    """Counts of units displaced by `reach`, by their own tables; all shapes (..., n)."""
    p = skin.parameters
    depth, reach, direction = np.broadcast_arrays(depth, reach, direction)
    angle = angle_of(skin, np.maximum(reach, 1e-9), depth)
    strength = (
        gain
        * amplitude_of(skin, depth)
        * np.sin(p["field_wavenumber_rad_per_mm"] * np.maximum(reach, 1e-9))
    )
    current = p["gel_current_20c_ua"] * p["gel_current_ratio"] ** ((temperature - 20.0) / 60.0)
    rows = (
        current, p["frequency_rest_hz"] - p["frequency_slope_hz_per_mm"] * depth,
        strength * np.cos(direction), strength * np.sin(direction), strength / np.tan(angle),
        temperature,
    )  # fmt: skip
    values = np.stack(np.broadcast_arrays(*rows), axis=-2)
    if noise is not None:
        still, field = np.zeros(depth.shape), p["field_noise_ut"] + np.zeros(depth.shape)
        frequency = p["frequency_noise_hz"] + still
        gel = p["gel_noise_relative"] * values[..., 0, :]
        sigma = np.stack([gel, frequency, field, field, field, still], axis=-2)
        values = values + sigma * noise.standard_normal(values.shape)
    return np.rint((values - skin.offset) / np.where(skin.wired, skin.scale, np.inf)).astype(
        np.int16
    )


# -- its end ---------------------------------------------------------------------------------------


@long_after_first("dtype", ["float32", "float64"])
def test_r_grows_to_its_end_and_stays_there(dtype):
    """From straight up through the horizon to straight down, a field of one strength."""
    skin = row_of(1)
    angle = np.linspace(0.0, np.pi, 2001)
    raw = np.repeat(counts_at(skin, [1.0], [0.0], [0.0])[np.newaxis], angle.size, axis=0)
    raw[:, 2, 0], raw[:, 4, 0] = np.rint(6000 * np.sin(angle)), np.rint(6000 * np.cos(angle))
    got = angled(skin, dtype=dtype, consistency=False)(raw)
    reach = got.displacement_mm[:-1, 0, 0]  # at the very end there is no direction
    angle = angle[:-1]
    assert np.all(np.diff(reach) >= -1e-3)
    flags = got.status[:-1, 0]
    np.testing.assert_array_equal(flags & Status.EXTRAPOLATED != 0, reach > 3.0)
    ended = angle > field_angle_ends(skin)[0][0] + 1e-3
    assert np.all(flags[ended] & Status.SATURATED)
    assert not np.any(flags[angle < field_angle_ends(skin)[0][0] - 1e-3] & Status.SATURATED)
    sigma = got.displacement_sigma_mm[:-1, 0, 0]
    assert np.all(np.diff(sigma[ended]) >= -1e-3)
    assert sigma[-1] > 1.0
    assert np.isfinite(got.displacement_sigma_mm).all()


@pytest.mark.long
@given(seeds, dtypes)
def test_no_integer_makes_a_nan(seed, dtype):
    skin = calibrated(row_of(48), seed % 5, turn_rad=0.5)
    got = angled(skin, dtype=dtype)(any_counts(skin, 20, seed))
    for name in ("temperature", "force", "tangential", "theta", "displacement_mm", "field_ut",
                 "temperature_sigma", "force_sigma", "tangential_sigma", "theta_sigma",
                 "displacement_sigma_mm"):  # fmt: skip
        assert np.isfinite(getattr(got, name)).all(), name


# -- which estimator -------------------------------------------------------------------------------


def test_the_estimator_is_that_of_the_wire_and_of_the_tables():
    assert Decoder(row_of(2), sweeps=0, ambient=False).estimator == "field-angle"
    untold = with_parameters(row_of(2), field_angle_mm=np.zeros((16, 2)))
    assert Decoder(untold, sweeps=0, ambient=False).estimator == "sine"
    assert not Decoder(untold, sweeps=0, ambient=False).plan.consistency
    with pytest.raises(CalibrationError, match=r"row/r0c0: field_angle_mm: must be .*; got none"):
        Decoder(untold, estimator="field-angle", sweeps=0, ambient=False)
    with pytest.raises(OptionError, match="row/r0c0: must have 'field_angle_mm' for consistency"):
        Decoder(untold, consistency=True, sweeps=0, ambient=False)


def test_a_table_that_ends_early_is_refused():
    table = row_of(2).parameters["field_angle_mm"].copy()
    table[4, 1] -= 2.0
    with pytest.raises(CalibrationError, match="row/r0c1: field_angle_mm: must be a polynomial "):
        Decoder(
            with_parameters(row_of(2), field_angle_mm=table),
            estimator="field-angle",
            sweeps=0,
            ambient=False,
        )
