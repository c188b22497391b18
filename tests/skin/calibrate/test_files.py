"""Calibration files: what was fitted is what is loaded."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

import topology
from skin.calibrate.files import (
    carry_comments,
    parameter_values,
    read_calibration,
    write_calibration,
)
from skin.calibrate.fit import Fit, as_fit
from skin.errors import CalibrationError, OptionError
from tests.fixtures.topology import write_topology
from topology import THETA_KNOTS

UNITS, PATCH = 4, {"patch": "patch"}


def told(**values):
    """A fit of given values."""
    return as_fit({name: (value, 0.1) for name, value in values.items()})


def patch_of(folder, calibration):
    """A topology file of a row of units that names a calibration."""
    patch = (
        f'kind = "grid"\nrows = 1\ncolumns = {UNITS}\npitch_m = 0.012\nlayout = "f3t-fd16"\n'
        f'first_id = 0x100\ncalibration = "{calibration}"'
    )
    return write_topology(folder, bus="data_bitrate = 5_000_000\ncycle_rate_hz = 1.0", patch=patch)


def test_what_was_written_is_what_is_loaded(tmp_path):
    theta = {f"theta_correction_rad[{k}]": 0.01 * np.sin(k) for k in range(THETA_KNOTS)}
    given = {"frequency_rest_hz": 4512.123456789012, "shear_gain_per_mm": -1e-17}
    write_calibration(
        tmp_path / "row.toml",
        PATCH | {"date": "2026-03-01", "bench": 'a "cell", 25 °C \x7f \\ \n'},
        {"r0c2": [told(**given), told(**theta)], "r0c0": []},
    )  # fmt: skip
    file, plain = patch_of(tmp_path, "row.toml"), tmp_path / "plain.toml"
    plain.write_text(file.read_text().replace('calibration = "row.toml"', ""))
    p = topology.load(file).parameters
    for name, value in given.items():
        assert p[name][2] == value
    assert (p["theta_correction_rad"][:, 2] == list(theta.values())).all()
    nominal = topology.load(plain).parameters
    for name, value in p.items():
        assert (value[..., [0, 1, 3]] == nominal[name][..., [0, 1, 3]]).all(), name


def test_a_later_fit_stands_above_an_earlier_one(tmp_path):
    fits = [told(frequency_rest_hz=4000.0), told(frequency_rest_hz=4100.0)]
    write_calibration(tmp_path / "row.toml", PATCH, {"r0c1": fits})
    p = topology.load(patch_of(tmp_path, "row.toml")).parameters
    assert p["frequency_rest_hz"].tolist() == [4500.0, 4100.0, 4500.0, 4500.0]


def test_a_crest_before_the_end_of_the_range_ends_the_range(tmp_path):
    units = {f"r0c{i}": [told(field_wavenumber_rad_per_mm=k)] for i, k in enumerate((0.62, 0.64))}
    write_calibration(tmp_path / "row.toml", PATCH, units)
    p = topology.load(patch_of(tmp_path, "row.toml")).parameters
    assert p["tangential_max_mm"].tolist() == [2.5, 2.454, 2.5, 2.5]


def test_a_crest_at_the_end_of_the_range_leaves_the_range_alone(tmp_path):
    """A later fit of the range itself stands above the crest's."""
    (fit,) = [told(field_wavenumber_rad_per_mm=0.5 * np.pi / 2.5001)]
    assert "tangential_max_mm" not in parameter_values("r0c0", [fit], 2.5)
    assert parameter_values("r0c0", [fit], 2.6)["tangential_max_mm"] == pytest.approx(
        (2.5, 2.5 * 0.1 / (0.5 * np.pi / 2.5001))
    )
    own = told(tangential_max_mm=2.2)
    assert parameter_values("r0c0", [own, fit], 2.6)["tangential_max_mm"] == (2.2, 0.1)


def test_the_sigma_of_a_table_is_the_largest_of_its_entries():
    names = tuple(f"theta_correction_rad[{k}]" for k in reversed(range(THETA_KNOTS)))
    sigma = np.linspace(0.1, 0.4, THETA_KNOTS)
    fit = Fit(names, np.arange(float(THETA_KNOTS)), np.diag(sigma**2), 0.0 * sigma)
    value, largest = parameter_values("r0c0", [fit], 2.5)["theta_correction_rad"]
    assert value.tolist() == list(range(THETA_KNOTS))[::-1]
    assert largest == pytest.approx(0.4)


def test_what_was_written_is_read_as_the_same_fits(tmp_path):
    """Indented or not, with a sigma or without; of a table the largest."""
    given = {"frequency_rest_hz": (4480.0, 1.5), "field_sigma_ut": (30.0, np.nan)}
    table = {f"theta_correction_rad[{k}]": (0.1 * k, 0.2) for k in range(THETA_KNOTS)}
    fits = [as_fit(given), as_fit(table)]
    write_calibration(tmp_path / "row.toml", PATCH, {"r0c1": fits, "r0c 2": fits[:1]})
    text = (tmp_path / "row.toml").read_text()
    (tmp_path / "row.toml").write_text(text.replace("\n", "\n  "))
    _, units = read_calibration(tmp_path / "row.toml")
    assert list(units) == ["r0c1", "r0c 2"]
    known = {}
    for fit in units["r0c1"]:
        assert fit.covariance.shape == 2 * (len(fit.names),)
        known |= dict(zip(fit.names, zip(fit.values, fit.sigma, strict=True), strict=True))
    assert known == pytest.approx({name: pytest.approx(v, nan_ok=True)
                                   for name, v in (given | table).items()})  # fmt: skip
    assert [fit.names for fit in units["r0c 2"]] == [(name,) for name in given]
    assert read_calibration(None) == ({}, {})


def test_what_was_measured_of_units_stands_in_a_table_of_its_own(tmp_path):
    measured = {"r0c1": {"force_rmse_n": 0.01, "cycles": 40}}
    file = tmp_path / "row.toml"
    write_calibration(file, PATCH | {"tared": ["r0c0", "r0c2"], "measured": measured}, {})
    found = tomllib.loads(file.read_text())
    assert found["measured"] == measured
    assert found["tared"] == ["r0c0", "r0c2"]


REFUSED = {
    "not finite": (
        told(hall_gain_per_k=np.nan),
        CalibrationError,
        "patch/r0c1: hall_gain_per_k: must be finite; got nan",
    ),
    "not in the model": (
        told(frequency_rest_h=1.0),
        OptionError,
        "(nearest: 'frequency_rest_hz')",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_written_leaves_the_old_file_as_it_was(case, tmp_path):
    fit, error, message = REFUSED[case]
    file = tmp_path / "row.toml"
    file.write_text("old")
    with pytest.raises(error) as caught:
        write_calibration(file, PATCH, {"r0c0": [told(frequency_rest_hz=1.0)], "r0c1": [fit]})
    assert str(caught.value).endswith(message)
    assert file.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["row.toml"]


def test_a_write_that_fails_midway_leaves_nothing_behind(tmp_path, monkeypatch):
    file = tmp_path / "row.toml"
    old = 'format = 1\npatch = "patch"\n'
    file.write_text(old)

    def full(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OSError, match="no space"):
        write_calibration(file, PATCH, {})
    assert file.read_text() == old
    assert [path.name for path in tmp_path.iterdir()] == ["row.toml"]


# -- comments --------------------------------------------------------------------------------------

BEFORE = """# The left hand, second film.
# Do not mix up with the right one.
format = 1
patch = "palm"  # on the left wrist

[units.r0c0]  # glued anew
# slower since the fall
frequency_rest_hz = 451000.0  # ± 3.0
theta_correction_rad = [
    0.1, # inside of a value
    0.2,
]
note = "a # that is none"  # by eye

# spare
[units."r 1"]
x = 1

units.gone.y = 2
# the end
"""
AFTER = """format = 1
patch = "palm"

[units.r0c0]
frequency_rest_hz = 450990.0  # ± 0.5
theta_correction_rad = [0.1, 0.2]
note = "a # that is none"

[units."r 1"]
x = 1
"""
TOLD = """# The left hand, second film.
# Do not mix up with the right one.
format = 1
patch = "palm"  # on the left wrist

[units.r0c0]  # glued anew
# slower since the fall
frequency_rest_hz = 450990.0  # ± 0.5
theta_correction_rad = [0.1, 0.2]
note = "a # that is none"  # by eye

# spare
[units."r 1"]
x = 1
# the end
"""


def test_comments_stay_at_their_keys_and_values_are_the_new_ones():
    found = carry_comments(BEFORE, AFTER)
    assert found == TOLD
    assert tomllib.loads(found) == tomllib.loads(AFTER)
    assert carry_comments(found, AFTER) == found
