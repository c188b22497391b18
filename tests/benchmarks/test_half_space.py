"""The half space against closed forms: Boussinesq, Hertz, Cattaneo-Mindlin, Reissner."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import half_space as room
from benchmarks.half_space import HalfSpace, influence
from skin.errors import SkinError
from skin.physics.elastic import Elastic
from skin.sim.mechanics.springs import Faces, Springs
from tests.naive.mechanics import held_tractions, line_integral_rectangle, linear_contact, square
from topology import load

SEEDS = st.integers(0, 2**32 - 1)
SKINS = ("palm", "fingertip", "strip", "hand")


@cache
def exact(name: str, modulus_pa: float = 6e5) -> HalfSpace:
    """A half space under a built-in skin, whose sweeps leave next to nothing."""
    foundation = HalfSpace.of(load(name), modulus_pa)
    foundation.tolerance = 1e-11
    return foundation


def pressed(foundation: HalfSpace, depth_mm: np.ndarray, soft: float = 0.0) -> np.ndarray:
    """Loads and the units' own depths, shape (2, n)."""
    out = np.zeros((2, foundation.n))
    foundation.press(depth_mm, out[0], out[1], body_mm_per_n=soft)
    return out


@dataclass
class Dragged:
    """State and outcome of `HalfSpace.drag`."""

    slipping: np.ndarray
    traction: np.ndarray
    own_mm: np.ndarray
    held_mm: np.ndarray
    slip_mm: np.ndarray

    @classmethod
    def at_rest(cls, n: int) -> Dragged:
        return cls(np.zeros(n, bool), *(np.zeros((2, n)) for _ in range(4)))

    def on(
        self,
        foundation: HalfSpace,
        shift_mm: np.ndarray,
        load_n: np.ndarray,
        depth_mm: np.ndarray,
        static: float = 0.5,
        kinetic: float | None = None,
        soft: float = 0.0,
    ) -> Dragged:
        """Carry all faces on by a shift, shape (2, n) or (2, 1)."""
        n = foundation.n
        faces = Faces(
            self.held_mm + shift_mm,
            load_n,
            depth_mm,
            np.full(n, static),
            np.full(n, static if kinetic is None else kinetic),
            self.slipping,
            self.traction,
            self.own_mm,
            self.held_mm,
            self.slip_mm,
        )
        foundation.drag(faces, body_mm_per_n=soft)
        return self


def rigid(n: int) -> Springs:
    """Units that do not yield by themselves: nothing but the half space gives way."""
    law = np.outer([1e12, 1.0, 0.0, 0.0], np.ones(n))
    return Springs(law, law, np.zeros(n), np.zeros(n))


def length(vectors: np.ndarray) -> np.ndarray:
    return np.hypot(vectors[0], vectors[1])


# -- influence -------------------------------------------------------------------------------------


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
def test_influence_is_the_sum_over_the_square(poisson: float) -> None:
    """Boussinesq's and Cerruti's point forces, summed over the face of the unit that presses."""
    position = np.array([[0.0, 0.007, 0.0, -0.02], [0.0, 0.002, 0.012, 0.01], [0.0] * 4])
    rotation = np.repeat(np.eye(3)[..., np.newaxis], 4, axis=2)
    side, modulus = 0.01, 1e6
    normal, shear = influence(
        position, rotation, np.full(4, side**2), modulus_pa=modulus, poisson=poisson
    )
    g = modulus / (2.0 * (1.0 + poisson))
    for i in range(4):
        for j in range(4):
            x, y = position[:2, i] - position[:2, j]
            whole, xx, yy, xy = line_integral_rectangle(x, y, 0.5 * side)
            scale = 1e3 / (2.0 * np.pi * g * side**2)
            got = normal[i, j], shear[i, j], shear[4 + i, 4 + j], shear[i, 4 + j]
            expected = (1 - poisson) * whole + poisson * np.array([whole, xx, yy, xy])
            expected[0] -= poisson * whole
            expected[3] = poisson * xy
            np.testing.assert_allclose(got, scale * expected, rtol=3e-3, atol=1e-9)


@pytest.mark.parametrize("name", SKINS)
def test_what_is_pushed_at_one_unit_is_felt_at_another_alike(name: str) -> None:
    """Betti, and work is never gained; patches do not feel each other."""
    skin = load(name)
    foundation, n = exact(name), skin.n
    for matrix in (foundation.normal, foundation.shear):
        np.testing.assert_array_equal(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix)[0] > 0.0
    apart = skin.patch[:, np.newaxis] != skin.patch
    assert np.all(foundation.normal[apart] == 0.0)
    assert np.all(
        foundation.shear.reshape(2, n, 2, n)[:, apart.nonzero()[0], :, apart.nonzero()[1]] == 0.0
    )
    assert np.all(foundation.normal >= 0.0)


# -- the half space: closed forms ------------------------------------------------------------------

MODULUS_PA, RADIUS_M, CONTACT_M, ACROSS = 1e6, 0.1, 0.01, 40
"""A sphere of this radius, pressed into a circle of this radius, this many units across."""


@cache
def half_space(poisson: float, across: int) -> tuple[np.ndarray, HalfSpace, float]:
    """Positions, shape (2, n), a pure half space under all of the circle, and the pitch."""
    pitch = 2.0 * CONTACT_M / across
    line = np.arange(-across // 2 - 1, across // 2 + 2) * pitch
    points = np.stack([axis.ravel() for axis in np.meshgrid(line, line, [0.0])])
    points = points[:, np.hypot(points[0], points[1]) < 1.06 * CONTACT_M]
    n = points.shape[1]
    rotation = np.repeat(np.diag([1.0, -1.0, -1.0])[..., np.newaxis], n, axis=2)
    matrices = influence(
        points, rotation, np.full(n, pitch**2), modulus_pa=MODULUS_PA, poisson=poisson
    )
    return points[:2], HalfSpace(rigid(n), *matrices), pitch


@cache
def hertz(poisson: float, across: int) -> np.ndarray:
    """Loads under the sphere."""
    points, foundation, _ = half_space(poisson, across)
    depth = (CONTACT_M**2 - 0.5 * (points**2).sum(axis=0)) / RADIUS_M
    return pressed(foundation, 1e3 * depth)[0]


def hertz_load(poisson: float) -> float:
    return 4.0 / 3.0 * MODULUS_PA / (1.0 - poisson**2) * CONTACT_M**3 / RADIUS_M


def mindlin_mm(share: float, load_n: float, friction: float, poisson: float) -> float:
    """Displacement under the tangential force share * friction * load (Cattaneo, Mindlin)."""
    g = MODULUS_PA / (2.0 * (1.0 + poisson))
    scale = 3.0 * friction * load_n / (16.0 * CONTACT_M) * (2.0 - poisson) / g
    return 1e3 * scale * (1.0 - (1.0 - share) ** (2.0 / 3.0))


def circle(faces: np.ndarray, pitch: float) -> float:
    """Radius of the circle that has the area of the faces."""
    return float(np.sqrt(faces.sum() / np.pi) * pitch)


def round_the_middle(points: np.ndarray) -> np.ndarray:
    """Ways of the faces when the body turns by 1 rad: their y is -y of the points."""
    return np.stack([-points[1], -points[0]])


def test_hertz() -> None:
    points, _, pitch = half_space(0.5, ACROSS)
    load_n, expected = hertz(0.5, ACROSS), hertz_load(0.5)
    assert load_n.sum() == pytest.approx(expected, rel=0.002)
    assert circle(load_n > 0.0, pitch) == pytest.approx(CONTACT_M, rel=0.01)
    r2 = (points**2).sum(axis=0) / CONTACT_M**2
    peak = 1.5 * expected / (np.pi * CONTACT_M**2) * pitch**2
    inner = r2 < 0.9**2
    np.testing.assert_allclose(load_n[inner], peak * np.sqrt(1.0 - r2[inner]), rtol=0.02)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
@pytest.mark.parametrize(("poisson", "across"), [(0.3, 20), (0.5, ACROSS)])
def test_cattaneo_and_mindlin(share: float, poisson: float, across: int) -> None:
    """Tangential force, stick radius and rim slip under a shift, in one step."""
    friction = 0.5
    points, foundation, pitch = half_space(poisson, across)
    load_n, total = hertz(poisson, across), hertz_load(poisson)
    shift = mindlin_mm(share, total, friction, poisson)
    out = Dragged.at_rest(foundation.n).on(
        foundation, np.array([[shift], [0.0]]), load_n, np.zeros(foundation.n), friction
    )
    assert out.traction[0].sum() == pytest.approx(share * friction * total, rel=0.005)
    stuck = (load_n > 0.0) & ~out.slipping
    radius = CONTACT_M * (1.0 - share) ** (1.0 / 3.0)
    assert circle(stuck, pitch) == pytest.approx(radius, rel=0.02)
    r = np.hypot(*points)
    assert r[stuck].max() < radius + 1.5 * pitch
    assert r[out.slipping].min() > radius - 1.5 * pitch
    assert np.all(length(out.traction) <= friction * load_n * (1.0 + 1e-12))


@pytest.mark.parametrize(("poisson", "across"), [(0.3, 20), (0.5, ACROSS)])
def test_a_flat_circular_punch(poisson: float, across: int) -> None:
    """Pressed 2 a E* d (Boussinesq), shifted 8 G a s / (2 - ν), turned 16 G a³ φ / 3 (Reissner)."""
    points, foundation, pitch = half_space(poisson, across)
    n, g = foundation.n, MODULUS_PA / (2.0 * (1.0 + poisson))
    under = np.hypot(*points) <= CONTACT_M
    a = circle(under, pitch)
    load_n, _ = pressed(foundation, np.where(under, 1.0, -1.0))
    plane = MODULUS_PA / (1.0 - poisson**2)
    assert load_n.sum() == pytest.approx(2.0 * a * plane * 1e-3, rel=0.02)
    bond, still = load_n * 1e6, np.zeros(n)
    out = Dragged.at_rest(n).on(foundation, np.array([[1.0], [0.0]]), bond, still)
    assert out.traction[0].sum() == pytest.approx(8.0 * g * a * 1e-3 / (2.0 - poisson), rel=0.02)
    around = round_the_middle(points)
    out = Dragged.at_rest(n).on(foundation, 1e3 * 0.01 * around, bond, still)
    moment = np.vdot(out.traction, around)
    assert moment == pytest.approx(16.0 / 3.0 * g * a**3 * 0.01, rel=0.04)


# -- the half space: laws --------------------------------------------------------------------------


@settings(max_examples=20)
@given(seed=SEEDS, name=st.sampled_from(SKINS), soft=st.sampled_from((0.0, 0.5)))
def test_faces_that_bear_load_meet_the_body_and_the_others_are_clear(
    seed: int, name: str, soft: float
) -> None:
    rng, skin = np.random.default_rng(seed), load(name)
    foundation, elastic = exact(name, 2e5), Elastic(skin)
    depth_mm = rng.uniform(-1.0, 3.0) + rng.normal(0.0, 1.0, skin.n)
    load_n, own_mm = pressed(foundation, depth_mm, soft)
    surface = elastic.depth(load_n) + soft * load_n + foundation.normal @ load_n
    bears = load_n > 0.0
    assert np.all(load_n >= 0.0)
    np.testing.assert_allclose(own_mm, elastic.depth(load_n), atol=1e-12)
    np.testing.assert_allclose(surface[bears], depth_mm[bears], atol=1e-8)
    assert np.all(surface[~bears] >= depth_mm[~bears] - 1e-8)


@settings(max_examples=20)
@given(seed=SEEDS, side=st.integers(1, 7))
def test_loads_are_those_of_least_squares_without_negative_numbers(seed: int, side: int) -> None:
    rng, skin = np.random.default_rng(seed), square(side)
    normal, shear = influence(skin.position, skin.rotation, skin.area, modulus_pa=3e5)
    foundation = HalfSpace(rigid(skin.n), normal, shear, tolerance=1e-12)
    depth_mm = rng.normal(0.3, 1.0, skin.n)
    load_n, _ = pressed(foundation, depth_mm)
    np.testing.assert_allclose(load_n, linear_contact(normal, depth_mm), atol=1e-8)


@settings(max_examples=10)
@given(seed=SEEDS, side=st.integers(1, 4))
def test_tractions_are_those_of_least_energy_within_the_coulomb_circles(
    seed: int, side: int
) -> None:
    rng, skin = np.random.default_rng(seed), square(side)
    normal, shear = influence(skin.position, skin.rotation, skin.area, modulus_pa=3e5)
    foundation = HalfSpace(rigid(skin.n), normal, shear, tolerance=1e-12)
    depth_mm = rng.uniform(0.1, 1.0, skin.n)
    load_n, _ = pressed(foundation, depth_mm)
    shift_mm = rng.normal(0.0, 0.3, (2, skin.n))
    out = Dragged.at_rest(skin.n).on(foundation, shift_mm, load_n, np.zeros(skin.n))
    expected = held_tractions(foundation.shear, shift_mm, 0.5 * load_n, rounds=5000)
    np.testing.assert_allclose(out.traction, expected, atol=1e-6)


# -- the rest --------------------------------------------------------------------------------------


def test_compiled_and_plain_python_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    skin = load("fingertip")
    rng = np.random.default_rng(5)
    depth_mm, shift_mm = rng.uniform(-0.5, 2.0, skin.n), rng.normal(0.0, 0.5, (2, skin.n))

    def everything() -> list[np.ndarray]:
        found = []
        foundation = HalfSpace.of(skin)
        load_n, own_mm = pressed(foundation, depth_mm)
        out = Dragged.at_rest(skin.n).on(foundation, shift_mm, load_n, own_mm, 0.5, 0.3)
        found += [foundation.normal, foundation.shear, load_n, own_mm, *vars(out).values()]
        return found

    compiled = everything()
    for name in ("_press", "_drag"):
        monkeypatch.setattr(room, name, getattr(room, f"{name}_python"))
    for a, b in zip(compiled, everything(), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_what_cannot_carry_is_refused() -> None:
    with pytest.raises(SkinError, match=r"^shear: must be positive definite; got .* of -1 mm/N"):
        HalfSpace(rigid(1), np.eye(1), np.diag([1.0, -1.0]))
