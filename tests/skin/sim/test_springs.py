"""Springs of units by themselves against the elastic laws of `Elastic`, written from the other
side: forces of displacements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skin.physics.elastic import Elastic
from skin.sim.mechanics.springs import Faces, Springs, under
from tests.fixtures.decode import stiffening
from topology import Topology, load

SEEDS = st.integers(0, 2**32 - 1)
STICKS = 1e9


def pressed(skin: Topology, depth_mm: np.ndarray, soft: float = 0.0) -> np.ndarray:
    """Loads and the units' own depths, shape (2, n)."""
    out = np.zeros((2, skin.n))
    Springs.of(skin).press(depth_mm, out[0], out[1], body_mm_per_n=soft)
    return out


def dragged(
    skin: Topology, shift_mm: np.ndarray, load_n: np.ndarray, depth_mm: np.ndarray,
    friction: float, kinetic: float | None = None, soft: float = 0.0,
) -> Faces:  # fmt: skip
    """Faces that were unloaded, after a shift."""
    n = skin.n
    slower = np.full(n, friction if kinetic is None else kinetic)
    faces = Faces(
        shift_mm, load_n, depth_mm, np.full(n, friction), slower, np.zeros(n, bool),
        *(np.zeros((2, n)) for _ in range(4)),
    )  # fmt: skip
    Springs.of(skin).drag(faces, body_mm_per_n=soft)
    return faces


def length(vectors: np.ndarray) -> np.ndarray:
    return np.hypot(vectors[0], vectors[1])


@given(seed=SEEDS, name=st.sampled_from(("palm", "fingertip", "strip", "hand")))
def test_each_unit_bears_by_its_own_law(seed: int, name: str) -> None:
    rng, skin = np.random.default_rng(seed), load(name)
    gain = {"shear_gain_per_mm": rng.uniform(-0.1, 0.2, skin.n)}
    skin = stiffening(replace(skin, parameters=skin.parameters | gain), seed)
    elastic, depth_mm = Elastic(skin), rng.uniform(-1.0, 3.0, skin.n)
    load_n, own_mm = pressed(skin, depth_mm)
    np.testing.assert_allclose(own_mm, np.maximum(depth_mm, 0.0), atol=1e-12)
    np.testing.assert_allclose(load_n, elastic.normal(own_mm), atol=1e-12)
    shift_mm = rng.normal(0.0, 1.5, (2, skin.n))
    out = dragged(skin, shift_mm, load_n, own_mm, STICKS)
    held = load_n > 0.0
    assert not out.slipping.any()
    np.testing.assert_allclose(out.own_mm, shift_mm * held, atol=1e-12)
    force = elastic.tangential(length(shift_mm), own_mm) * held
    np.testing.assert_allclose(out.traction * length(shift_mm), shift_mm * force, atol=1e-12)


@given(seed=SEEDS, body=st.floats(0.0, 2.0), shear_body=st.floats(0.0, 2.0))
def test_a_soft_body_yields_in_series(seed: int, body: float, shear_body: float) -> None:
    """The unit takes what the body leaves, and both bear the same force."""
    rng, skin = np.random.default_rng(seed), stiffening(load("palm"), seed)
    elastic, depth_mm = Elastic(skin), rng.uniform(0.1, 3.0, skin.n)
    load_n, own_mm = pressed(skin, depth_mm, soft=body)
    np.testing.assert_allclose(own_mm + body * load_n, depth_mm, atol=1e-12)
    np.testing.assert_allclose(elastic.depth(load_n), own_mm, atol=1e-12)
    shift_mm = rng.normal(0.0, 2.0, (2, skin.n))
    out = dragged(skin, shift_mm, load_n, own_mm, STICKS, soft=shear_body)
    np.testing.assert_allclose(out.own_mm + shear_body * out.traction, shift_mm, atol=1e-12)
    np.testing.assert_allclose(
        elastic.displacement(length(out.traction), own_mm), length(out.own_mm), atol=1e-12
    )


@given(seed=SEEDS, slower=st.floats(0.3, 1.0))
def test_a_face_slips_along_its_force_from_the_static_limit_and_bears_kinetic_friction(
    seed: int, slower: float
) -> None:
    rng, skin = np.random.default_rng(seed), load("palm")
    load_n, own_mm = pressed(skin, rng.uniform(-0.3, 2.0, skin.n))
    shift_mm = rng.normal(0.0, 1.0, (2, skin.n))
    out = dragged(skin, shift_mm, load_n, own_mm, 0.4, 0.4 * slower)
    size, moving = length(out.traction), out.slipping
    wanted = Elastic(skin).tangential(length(shift_mm), own_mm)
    np.testing.assert_array_equal(moving, (wanted > 0.4 * load_n) & (load_n > 0.0))
    np.testing.assert_allclose(size[moving], 0.4 * slower * load_n[moving], rtol=1e-9)
    np.testing.assert_allclose(out.held_mm + out.slip_mm, shift_mm * (load_n > 0.0), atol=1e-9)
    assert np.all((out.traction * out.slip_mm).sum(axis=0) >= 0.0)


@given(seed=st.integers(0, 10_000))
def test_units_yield_to_forces_by_the_elastic_laws(seed: int) -> None:
    skin, rng = stiffening(load("palm"), seed), np.random.default_rng(seed)
    force = rng.uniform(-2.0, 8.0, (3, skin.n))
    force[:, 0] = 0.0
    depth_mm, moved_mm = np.empty(skin.n), np.empty((2, skin.n))
    under(Springs.of(skin), force, depth_mm, moved_mm)
    elastic = Elastic(skin)
    assert elastic.normal(depth_mm) == pytest.approx(np.maximum(force[2], 0.0), abs=1e-12)
    held = elastic.tangential(length(moved_mm), depth_mm)
    assert held == pytest.approx(length(force), abs=1e-12)
    assert moved_mm[0] * force[1] == pytest.approx(moved_mm[1] * force[0], abs=1e-12)
    assert np.sum(moved_mm * force[:2], axis=0).min() >= 0.0
