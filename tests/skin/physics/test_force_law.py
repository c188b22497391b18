"""The law by its meaning: two lines that meet and a cube, found by interpolation, differences and
sums."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from skin.physics import force_law
from skin.physics.elastic import Elastic
from tests.fixtures.decode import calibrated, row_of, with_parameters

FAR = 50.0
laws = st.tuples(
    st.floats(0.1, 10.0), st.floats(0.1, 5.0), st.floats(0.0, 10.0),
    st.one_of(st.just(0.0), st.floats(1e-6, 10.0)),
)  # fmt: skip


def pushed(x, soft, knee, stiffer, cubic):
    """A polygon from far below zero to far beyond the knee, and the cube on top of it."""
    top = soft * FAR + stiffer * (FAR - knee)
    lines = np.interp(x, [-FAR, knee, FAR], [-FAR * soft, soft * knee, top])
    return lines + np.where(x > knee, cubic * np.abs(x - knee) ** 3, 0.0)


@given(law=laws)
def test_force_follows_two_lines_that_meet_and_a_cube(law):
    x = np.linspace(-2.0, 10.0, 121)
    np.testing.assert_allclose(force_law.force(x, law), pushed(x, *law), rtol=1e-11, atol=1e-11)


@given(law=laws)
@example((0.109375, 0.5, 0.0, 5.0))
@example((0.1, 0.1, 0.0, 10.0))
def test_inverse_undoes_the_force(law):
    x = np.linspace(-2.0, 10.0, 121)
    np.testing.assert_allclose(force_law.inverse(pushed(x, *law), law), x, rtol=1e-9, atol=1e-9)


@given(law=laws, x=st.floats(-2.0, 10.0))
def test_slope_is_what_the_force_changes_by(law, x):
    step = 1e-6
    if abs(x - law[1]) <= step:
        return
    change = (pushed(x + step, *law) - pushed(x - step, *law)) / (2.0 * step)
    assert force_law.slope(x, law) == pytest.approx(change, rel=1e-5)


@given(law=laws, x=st.floats(0.0, 10.0))
def test_energy_is_the_area_under_the_force(law, x):
    points = np.linspace(0.0, x, 4001)
    area = np.trapezoid(pushed(points, *law), points)
    assert force_law.energy(x, law) == pytest.approx(area, rel=1e-5, abs=1e-9)


@given(law=laws, compliance=st.floats(0.0, 2.0), factor=st.floats(0.1, 5.0))
def test_a_compliance_in_series_adds_what_it_yields_and_a_factor_scales_the_force(
    law, compliance, factor
):
    x = np.linspace(-2.0, 10.0, 121)
    both = force_law.force(x, force_law.in_series(law, compliance))
    np.testing.assert_allclose(both, x + compliance * pushed(x, *law), rtol=1e-11, atol=1e-11)
    found = force_law.force(x, force_law.scaled(law, factor))
    np.testing.assert_allclose(found, factor * pushed(x, *law), rtol=1e-11, atol=1e-11)


def test_laws_by_frequency_and_displacement_are_those_of_the_elastic_unit():
    skin = with_parameters(
        calibrated(row_of(8), seed=5), normal_cubic_n_per_hz3=2e-9, shear_cubic_n_per_mm3=0.4
    )
    p, elastic = skin.parameters, Elastic(skin)
    slope = p["frequency_slope_hz_per_mm"]
    depth = np.linspace(0.0, 3.0, 40)[:, np.newaxis] + np.zeros(skin.n)
    push = pushed_of_fall(p, depth * slope)
    np.testing.assert_allclose(elastic.normal(depth), push, rtol=1e-12)
    np.testing.assert_allclose(elastic.depth(push), depth, atol=1e-9)
    beyond = np.maximum(depth - p["shear_break_mm"], 0.0)
    shear = p["shear_soft_n_per_mm"] * depth + p["shear_stiff_n_per_mm"] * beyond + 0.4 * beyond**3
    found = elastic.tangential(depth, p["field_reference_mm"])
    np.testing.assert_allclose(found, shear, rtol=1e-12, atol=1e-15)


def pushed_of_fall(p, fall_hz):
    """Normal force at a fall of the frequency, with a cube of 2e-9 N/Hz³."""
    beyond = np.maximum(fall_hz - p["normal_break_hz"], 0.0)
    steep = p["normal_stiff_n_per_hz"] - p["normal_soft_n_per_hz"]
    return p["normal_soft_n_per_hz"] * fall_hz + steep * beyond + 2e-9 * beyond**3
