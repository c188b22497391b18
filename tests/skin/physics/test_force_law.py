"""The law by its meaning: two lines that meet, found by interpolation, differences and sums."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.compiled.jit import compiled
from skin.physics import force_law
from skin.physics.elastic import Elastic
from tests.fixtures.decode import calibrated, row_of

FAR = 50.0
laws = st.tuples(st.floats(0.1, 10.0), st.floats(0.1, 5.0), st.floats(0.1, 10.0))


def lines(x, below, knee, beyond):
    """The law as a polygon, from far below zero to far beyond the knee."""
    top = below * knee + beyond * (FAR - knee)
    return np.interp(x, [-FAR, 0.0, knee, FAR], [-FAR * below, 0.0, below * knee, top])


@given(law=laws)
def test_force_follows_two_lines_that_meet(law):
    below, knee, beyond = law
    x = np.linspace(-2.0, 10.0, 121)
    np.testing.assert_allclose(force_law.force(x, *law), lines(x, *law), rtol=1e-11, atol=1e-12)
    found = force_law.force_with_added(x, below, knee, beyond - below)
    np.testing.assert_allclose(found, lines(x, *law), rtol=1e-11, atol=1e-11)


@given(law=laws)
def test_inverse_undoes_the_force(law):
    x = np.linspace(-2.0, 10.0, 121)
    np.testing.assert_allclose(force_law.inverse(lines(x, *law), *law), x, rtol=1e-11, atol=1e-11)


@given(law=laws, x=st.floats(-2.0, 10.0))
def test_slope_is_what_the_force_changes_by(law, x):
    step = 1e-6
    if abs(x - law[1]) <= step:
        return
    change = (lines(x + step, *law) - lines(x - step, *law)) / (2.0 * step)
    assert force_law.slope(x, *law) == pytest.approx(change, rel=1e-6)


@given(law=laws, y=st.floats(0.0, 20.0))
def test_energy_is_the_area_under_the_inverse(law, y):
    below, knee, beyond = law
    at_knee = below * knee
    points = np.linspace(0.0, y, 2001)
    inverse = np.interp(points, [0.0, at_knee, at_knee + FAR * beyond], [0.0, knee, knee + FAR])
    if y < at_knee + FAR * beyond:
        area = np.trapezoid(inverse, points)
        found = force_law.inverse_integral(y, *law)
        assert found == pytest.approx(area, rel=1e-5, abs=1e-9)


@given(law=laws, x=st.floats(0.01, 10.0), angle=st.floats(-3.0, 3.0))
def test_secant_and_slope_are_the_jacobian_of_a_vector(law, x, angle):
    below, knee, beyond = law
    if abs(x - knee) < 1e-4:
        return

    def push(way):
        length = np.hypot(*way)
        return lines(length, *law) / length * way

    along = np.array([np.cos(angle), np.sin(angle)])
    secant, steeper = force_law.secant(x * x, below, knee, beyond - below)
    expected = np.stack([(push(x * along + d) - push(x * along - d)) / 2e-6
                         for d in 1e-6 * np.eye(2)], axis=1)  # fmt: skip
    found = secant * np.eye(2) + steeper * np.outer(along, along)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * max(below, beyond))


def all_python(x, laws, out):
    for i in range(x.size):
        below, knee, beyond = laws[0, i], laws[1, i], laws[2, i]
        out[0, i] = force_law.force(x[i], below, knee, beyond)
        out[1, i] = force_law.force_with_added(x[i], below, knee, beyond)
        out[2, i] = force_law.slope(x[i], below, knee, beyond)
        out[3, i] = force_law.inverse(x[i], below, knee, beyond)
        out[4, i] = force_law.stiffening(x[i], below, knee)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_kernels_and_arrays_have_the_same_numbers_to_the_bit(dtype):
    rng = np.random.default_rng(3)
    x, law = rng.uniform(-2.0, 10.0, 999).astype(dtype), rng.uniform(0.1, 5.0, (3, 999))
    law = law.astype(dtype)
    out = np.empty((5, 999), dtype)
    compiled(all_python, cache=False)(x, law, out)
    expected = (
        force_law.force(x, *law), force_law.force_with_added(x, *law), force_law.slope(x, *law),
        force_law.inverse(x, *law), force_law.stiffening(x, *law[:2]),
    )  # fmt: skip
    np.testing.assert_array_equal(out, np.array(expected))


def test_laws_by_frequency_and_displacement_are_those_of_the_elastic_unit():
    skin = calibrated(row_of(8), seed=5)
    p, elastic = skin.parameters, Elastic(skin)
    slope = p["frequency_slope_hz_per_mm"]
    depth = np.linspace(0.0, 3.0, 40)[:, np.newaxis] + np.zeros(skin.n)
    push = elastic.normal(depth)
    np.testing.assert_allclose(force_law.normal_law(p, depth * slope), push, rtol=1e-12)
    np.testing.assert_allclose(force_law.normal_fall(p, push), depth * slope, atol=1e-9)
    at_reference = elastic.tangential(depth, p["field_reference_mm"])
    np.testing.assert_allclose(force_law.shear_law(p, depth), at_reference, rtol=1e-12, atol=1e-15)
    steep = (force_law.shear_law(p, depth + 1e-7) - force_law.shear_law(p, depth)) / 1e-7
    np.testing.assert_allclose(force_law.shear_slope(p, depth), steep, rtol=1e-5)
