"""Laws that are not the decoder's are what they are called, and are decoded with what is told."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.integrate import quad

from benchmarks import foreign
from benchmarks import foreign_laws as laws
from benchmarks.accuracy_skin import differing, square
from skin.physics.elastic import Elastic


def energy(above):
    """Yeoh's energy over C1 at I1 - 3."""
    return sum(c * above**power for power, c in enumerate(laws.YEOH, start=1))


@pytest.mark.parametrize("strain", [0.05, 0.3, 0.8])
def test_stresses_are_slopes_of_the_energy(strain):
    """The work of the stress is the energy: I1 - 3 is γ² in shear, λ² + 2 / λ - 3 along an axis."""
    work, _ = quad(laws.yeoh_shear, 0.0, strain)
    assert work == pytest.approx(energy(strain**2), rel=1e-9)
    pressed = 1.0 - 0.5 * strain
    work, _ = quad(laws.yeoh_uniaxial, pressed, 1.0)
    assert work == pytest.approx(energy(pressed**2 + 2.0 / pressed - 3.0), rel=1e-9)


def test_a_layer_that_is_thick_against_its_contact_is_indented_as_hertz_has_it():
    """F = 4/3 E / (1 - ν²) sqrt(R) δ^(3/2), ν = 1/2."""
    depth = np.array([1e-6, 1e-5])
    hertz = 4.0 / 3.0 / 0.75 * np.sqrt(laws.INDENTER_MM) * depth**1.5
    np.testing.assert_allclose(laws.indentation(depth), hertz, rtol=3e-3)
    assert (
        laws.indentation(np.array([1.0, 2.0])) > 1.5 * hertz[1] * (1e5 ** np.array([1.5, 1.5]))
    ).all()


def test_the_gel_is_linear_in_one_over_the_kelvin_above_vogels():
    temperature, ratio = np.linspace(20.0, 80.0, 7), 12.0
    share = laws.vogel(temperature, ratio)
    assert share[[0, -1]] == pytest.approx([1.0, ratio])
    inverse = 1.0 / (temperature + 273.15 - laws.VOGEL_K)
    slopes = np.diff(np.log(share)) / np.diff(inverse)
    np.testing.assert_allclose(slopes, slopes[0], rtol=1e-9)
    # and is no exponential by some degrees
    exponential = 12.0 ** ((temperature - 20.0) / 60.0)
    assert np.abs(np.log(share / exponential)).max() * 60.0 / np.log(ratio) > 2.0


def test_a_parasitic_capacitance_bends_the_fall():
    rest, compression = 4500.0, np.linspace(0.0, 0.4, 5)
    found = laws.loaded(rest, compression)
    capacitance = 1.0 / (1.0 - compression) + laws.PARASITIC
    np.testing.assert_allclose(found, rest * (1.0 + laws.PARASITIC) / capacitance, rtol=1e-12)
    chord = found[0] + (found[-1] - found[0]) * compression / compression[-1]
    assert 5.0 < np.abs(found - chord).max() < 30.0


@pytest.mark.parametrize("stretch", [1.0, laws.STRETCH])
def test_a_stretched_exponential_has_the_mean_delay_that_is_asked_for(stretch):
    delay, _ = quad(lambda t: 1.0 - laws.relaxed(np.array(t), 7.0, stretch), 0.0, np.inf, limit=500)
    assert delay == pytest.approx(7.0, rel=1e-4)


def test_the_tables_of_forces_meet_the_units_own_at_two_millimetres():
    true = differing(square(2, 0.012), seed=3)
    table, own = laws.Hyperelastic(true), Elastic(true)
    np.testing.assert_allclose(table.normal(np.full(4, 2.0)), own.normal(2.0))
    np.testing.assert_allclose(
        table.tangential(np.full(4, 2.0), np.ones(4)), own.tangential(2.0, 2.0)
    )
    gap = [table.normal(np.full(4, h))[0] - own.normal(h)[0] for h in (0.3, 1.0)]
    assert max(np.abs(gap)) > 0.05


@pytest.fixture(scope="module")
def figures():
    return foreign.run(quick=True)


@pytest.mark.long
def test_the_decoders_own_laws_leave_noise_alone_and_keep_the_share(figures):
    """800 displacements and forces, 400 depths: three sigma of a share are 5 and 7 %."""
    for row in figures["cases"]["the decoder's own"].values():
        assert row["rms"]["T"] < 0.1
        assert row["rms"]["H"] < 9.0
        for part, held in row["held"].items():
            assert 0.6 < held < 0.77, part


@pytest.mark.long
@pytest.mark.parametrize(
    ("case", "part"), [("gel", "T"), ("capacitor", "H"), ("capacitor", "Fz"),
                       ("force", "Fz")]
)  # fmt: skip
def test_other_laws_show_in_what_they_are_of_and_in_its_sigma(figures, case, part):
    own, other = (figures["cases"][name]["field-angle"] for name in ("the decoder's own", case))
    # 400 readings: three sigma of a ratio of two root mean squares are 15 %
    assert other["rms"][part] > 1.15 * own["rms"][part]
    # what calibration cannot follow is told: without that, hardly any error would be held
    assert 0.3 < other["held"][part] < 0.95


@pytest.mark.long
def test_the_displacement_does_not_feel_gel_and_force(figures):
    own = figures["cases"]["the decoder's own"]["field-angle"]["rms"]["dx, dy"]
    for case in ("gel", "force"):
        assert figures["cases"][case]["field-angle"]["rms"]["dx, dy"] < 1.1 * own


@pytest.mark.long
def test_a_film_that_lags_otherwise_shows_with_the_sine_and_not_with_the_angle(figures):
    first, stretched = figures["lag"].values()
    assert stretched["sine"]["um_rms"] > 1.2 * first["sine"]["um_rms"]
    assert stretched["field-angle"]["um_rms"] < 0.3 * stretched["sine"]["um_rms"]


@pytest.mark.long
def test_figures_are_plain_and_shown(figures):
    json.dumps(figures)
    text = foreign.table(figures)
    assert all(name in text for name in figures["cases"])
