"""Friction cone, margin and grip force against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.slip import SlipSettings
from skin.contact.stream import ContactStream
from skin.contact.wrench import tangential_demand
from tests.fixtures.contact_features import contact_features


def torsion_arm(load, position):
    """Arm of a contact of units that face +z."""
    n = load.size
    force = np.array([np.zeros(n), np.zeros(n), load])
    (contact,), _ = contact_features(
        np.zeros(n, int), force, 0.0, position, naive.facing_down(n), 1e-6
    )
    return contact["arm"]


@pytest.mark.parametrize("radius", [0.005, 0.02])
def test_arm_of_even_pressure_is_that_of_a_disc(radius):
    # A disc under even pressure bears friction x load x 2/3 of its radius.
    x, y = np.meshgrid(*(np.linspace(-radius, radius, 401),) * 2)
    inside = x**2 + y**2 <= radius**2
    position = np.array([x[inside], y[inside], np.zeros(inside.sum())])
    arm = torsion_arm(np.ones(inside.sum()), position)
    assert arm == pytest.approx(2.0 / 3.0 * radius, rel=5e-3)


def test_contacts_tell_margin_and_grip_force_of_the_friction_they_are_given():
    position = naive.grid(5, 5)
    stream = ContactStream(
        position, naive.facing_down(25), 1e-4, *neighbour_graph(position, 0.0125),
        want={"slip"}, slip=SlipSettings(friction=0.6, safety=1.5),
    )  # fmt: skip
    rng = np.random.default_rng(1)
    force = rng.uniform(0.5, 1.5, (3, 25)) * [[0.1], [0.05], [1.0]]
    for number in range(1, 4):
        (contact,) = stream.update(force, 0.01, 0.2 * force, 0.01, stamp_ns=number * 4_000_000)
    arm = naive.torsion_arm(force[2], position, contact.normal)
    least = np.hypot(contact.shear, contact.torsion / arm) / 0.6
    assert contact.arm == pytest.approx(arm)
    assert contact.friction == 0.6
    assert contact.margin == pytest.approx(1.0 - least / contact.load)
    assert contact.grip_force == pytest.approx(1.5 * least)


def test_the_demand_is_on_an_ellipsoid_and_a_point_bears_no_torsion():
    assert tangential_demand(3.0, 0.04, 0.01) == pytest.approx(5.0)
    assert tangential_demand(3.0, 0.04, 0.0) == 3.0
