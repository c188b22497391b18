"""How far the pressure's centre is from that of the loads, of bodies that are made here."""

from __future__ import annotations

import numpy as np
import pytest

import tests.naive.contact as naive
from tests.fixtures.contact_features import contact_features

RADIUS, SIDE = 0.006, 7
AREA = np.pi * RADIUS**2
SEEN = 0.004
"""Share of the load from which on a unit is in the contact."""
CLASSES = {"one": (1, 1), "two": (2, 2), "three": (3, 3), "some": (4, 5), "many": (6, 12)}


def points_of(rng, bodies):
    """Loads and true centres of flat and round bodies of any widths, on round faces that touch."""
    position = naive.grid(SIDE, SIDE, 2.0 * RADIUS)
    across = ((np.arange(12) + 0.5) / 6.0 - 1.0) * RADIUS
    u, v = (each.ravel() for each in np.meshgrid(across, across))
    face = np.hypot(u, v) < RADIUS
    x, y = (position[a][:, np.newaxis] + each[face] for a, each in enumerate((u, v)))
    for body in range(bodies):
        half = 0.5 * np.sqrt(AREA) * rng.uniform(0.05, 4.0, 2)
        at = position[:2].mean(axis=1) + RADIUS * rng.uniform(-1.0, 1.0, 2)
        turn = rng.uniform(0.0, np.pi)
        a = (x - at[0]) * np.cos(turn) + (y - at[1]) * np.sin(turn)
        b = (y - at[1]) * np.cos(turn) - (x - at[0]) * np.sin(turn)
        inside = 1.0 - (a / half[0]) ** 2 - (b / half[1]) ** 2
        pressure = np.maximum(inside, 0.0) if body % 2 else (inside > 0.0) * 1.0
        load = pressure.sum(axis=1)
        if load.sum() > 0.0:
            centre = np.array([(pressure * x).sum(), (pressure * y).sum()]) / load.sum()
            yield position, load / load.sum(), centre


@pytest.fixture(scope="module")
def found():
    """Numbers of units, and errors and sigmas along both axes, mm, of contacts without noise."""
    rng, rows = np.random.default_rng(17), []
    for position, share, centre in points_of(rng, 1500):
        load = np.where(share > SEEN, share, 0.0)
        label = np.where(load > 0.0, 0, -1)
        force = np.zeros((3, load.size))
        force[2] = load
        contacts, _ = contact_features(
            label, force, 1e-6, position, naive.facing_down(load.size), AREA
        )
        sigma = np.sqrt(np.diag(contacts["centroid_covariance"][0]))[:2]
        off = contacts["centroid"][0, :2] - centre
        rows.append([np.count_nonzero(load), *(1e3 * off), *(1e3 * sigma)])
    return np.array(rows)


@pytest.mark.parametrize("few", CLASSES)
def test_the_centre_is_as_far_off_as_its_sigma_says(found, few):
    """Whatever the number of units. Flat and round bodies differ, so that errors are no normal
    ones."""
    low, high = CLASSES[few]
    found = found[(found[:, 0] >= low) & (found[:, 0] <= high)]
    off, sigma = found[:, 1:3], found[:, 3:]
    assert len(found) > 40
    assert 0.4 < np.mean(off**2) / np.mean(sigma**2) < 1.5
    assert 0.5 < np.mean(np.abs(off) <= sigma) < 0.92


def test_of_all_bodies_the_mean_square_is_the_variance(found):
    off, sigma = found[:, 1:3], found[:, 3:]
    assert np.mean(off**2) / np.mean(sigma**2) == pytest.approx(0.95, abs=0.2)
    assert 0.66 < np.mean(np.abs(off) <= sigma) < 0.82


def test_two_lone_touches_are_as_uncertain_together_as_each():
    """The total of contacts apart is that of their centres, not of a body that spans both."""
    position = naive.grid(1, 9, 2.0 * RADIUS)
    force = np.zeros((3, 9))
    force[2, [0, 8]] = 1.0, 3.0
    label = np.full(9, -1)
    label[[0, 8]] = 0, 1
    contacts, total = contact_features(label, force, 1e-6, position, naive.facing_down(9), AREA)
    each = contacts["centroid_covariance"][:, 0, 0]
    assert each == pytest.approx(AREA / 20.0, rel=1e-3)
    together = (1.0 * each[0] + 9.0 * each[1]) / 16.0
    assert total["centroid_covariance"][0, 0] == pytest.approx(together, rel=1e-3)
