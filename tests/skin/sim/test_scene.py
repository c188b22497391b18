"""Laws of the scene that is played where no other is asked for, on any skin, at any friction."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial import ConvexHull

from skin.sim.scenes.load import load_scene
from skin.sim.scenes.play import ScriptedScene
from skin.sim.truth import Truth
from topology import Topology, load

SKINS = ("palm", "fingertip", "strip", "hand")


@cache
def skin(name: str) -> Topology:
    return load(name)


def demo(name: str, **of_the_ball: object) -> ScriptedScene:
    """The scene with another ball."""
    script = load_scene("demo", skin(name))
    (ball,) = script.bodies
    return ScriptedScene(skin(name), replace(script, bodies=(replace(ball, **of_the_ball),)))


@cache
def history(name: str) -> tuple[Truth, ...]:
    """One stroke on every patch and one more, at 50 Hz."""
    topology = skin(name)
    scene = demo(name)
    seconds = 7.0 * (len(topology.patch_names) + 1)
    return tuple(scene.at(k / 50.0).copy() for k in range(int(50 * seconds)))


def stacked(truths: tuple[Truth, ...], name: str) -> np.ndarray:
    return np.stack([getattr(truth, name) for truth in truths])


@pytest.mark.parametrize("name", SKINS)
def test_centroid_is_within_the_hull_of_the_units(name: str) -> None:
    topology = skin(name)
    for truth in history(name)[::25]:
        loaded = truth.force[2] > 0.0
        assert np.isnan(truth.centroid).all() == (not loaded.any())
        if not loaded.any():
            continue
        points = topology.position[:, loaded]
        low, high = points.min(axis=1), points.max(axis=1)
        assert np.all(truth.centroid >= low - 1e-12)
        assert np.all(truth.centroid <= high + 1e-12)
        flat = points[:2].T
        if np.linalg.matrix_rank(flat - flat[0], tol=1e-6) == 2:
            hull = ConvexHull(flat).equations
            assert np.all(hull[:, :2] @ truth.centroid[:2] + hull[:, 2] <= 1e-9)


@pytest.mark.parametrize("name", SKINS)
def test_nothing_is_left_after_the_lift(name: str) -> None:
    scene = demo(name)
    for number in range(len(skin(name).patch_names)):
        assert scene.at(7.0 * number + 3.0).contact.any()
        truth = scene.at(7.0 * number + 6.0)
        assert not truth.contact.any()
        for array in (truth.depth_mm, truth.displacement_mm, truth.force, truth.wrench):
            assert np.all(array == 0.0)


@pytest.mark.parametrize("name", SKINS)
def test_the_default_stays_within_what_a_unit_can_measure(name: str) -> None:
    """No unit beyond 6 N and 2 mm, several loaded at once, every patch in its turn."""
    truths, topology = history(name), skin(name)
    force = stacked(truths, "force")
    lateral = np.hypot(*stacked(truths, "displacement_mm").transpose(1, 0, 2))
    assert 3.0 < force[:, 2].max() < 6.0
    assert force[:, 2].sum(axis=1).max() < 20.0
    assert 1.0 < lateral.max() < 2.0
    assert (force[:, 2] > 0.0).sum(axis=1).max() >= 3
    visited = topology.patch[stacked(truths, "contact").any(axis=0)]
    assert set(visited) == set(range(len(topology.patch_names)))


# -- time ------------------------------------------------------------------------------------------
