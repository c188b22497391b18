"""R from the angle of the field: the preset of the unit model is what magnet theory gives."""

from __future__ import annotations

import numpy as np
import pytest

from skin.calibrate.field_angle import angle_powers, angle_slope, field_angle
from tests.fixtures.decode import posed, row_of, strokes
from topology import UnitModel

TABLE = np.array(UnitModel().field_angle_mm)


def scanned(poses):
    return posed(row_of(1), *poses, noise=False)[0][:, 2:5, 0]


def test_the_preset_of_the_unit_model_is_what_magnet_theory_gives():
    table = np.reshape(UnitModel().field_angle_mm, (4, 4))
    depth, displacement, direction = strokes(np.linspace(0.0, 2.5, 26), np.linspace(0.0, 3.0, 31))
    angle = field_angle(scanned((depth, displacement, direction)))
    powers = angle[:, None] ** np.arange(1, 8, 2)
    found = np.einsum("ti,ij,tj->t", powers, table, np.vander(depth, 4, increasing=True))
    assert np.abs(found - displacement).max() < 0.8e-3


def test_the_powers_are_odd_in_the_angle_and_those_of_the_table():
    angle, depth = 1.1, 0.7
    total = sum(
        TABLE[4 * i + j] * angle ** (2 * i + 1) * depth**j for i in range(4) for j in range(4)
    )
    one, other = angle_powers(np.array([angle, -angle]), np.full(2, depth)) @ TABLE
    assert one == pytest.approx(total, rel=1e-12)
    assert other == -one


def test_the_slope_is_the_derivative_of_the_displacement():
    depth = np.repeat(np.linspace(0.0, 2.0, 5), 20)
    angle = np.tile(np.linspace(0.05, 1.4, 20), 5)
    step = 1e-6
    beyond = angle_powers(angle + step, depth) - angle_powers(angle - step, depth)
    slope = angle_slope(TABLE.reshape(4, 4), angle, depth)
    np.testing.assert_allclose(slope, beyond @ TABLE / (2.0 * step), rtol=1e-7)


def test_displacement_grows_with_the_angle_all_over_the_range():
    for depth in np.linspace(0.0, 2.0, 21):
        displacement = np.linspace(0.0, 3.0, 301)
        angle = field_angle(scanned((np.full(301, depth), displacement, 0.0)))
        assert (np.diff(angle_powers(angle, np.full(301, depth)) @ TABLE) > 0.0).all()


def test_the_direction_of_the_scan_does_not_matter():
    depth, displacement, direction = strokes(np.linspace(0.0, 2.0, 5), np.linspace(0.0, 3.0, 7))
    one = field_angle(scanned((depth, displacement, direction)))
    other = field_angle(scanned((depth, displacement, direction + 2.0)), direction + 2.0)
    np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-5)
