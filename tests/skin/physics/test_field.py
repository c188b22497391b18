"""The magnetic field of films against magnet theory, twice, and by its symmetry and scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import curve_fit
from scipy.spatial.transform import Rotation

from skin.errors import SkinError
from skin.physics import halbach, magnet
from skin.physics.fabrication import Fabrication
from skin.physics.film_table import TABLE_PATH, Film, load_film_table
from skin.physics.halbach import CHIP_AXES, HalbachField, crest_ut
from tests.fixtures.film import grains, sum_of_dipoles
from tests.naive.magnets import build_table, calibrated, film_field_ut, save
from topology import Topology, load

PALM = load("palm")
TABLE = load_film_table()
FILM = TABLE.film
DOWN = np.diag([1.0, -1.0, -1.0])
COOL = 25.0


def skin_of(position: np.ndarray, rotation: np.ndarray | None = None) -> Topology:
    """Units of the palm at other places, shape (3, n), and attitudes, shape (3, 3, n)."""
    n = position.shape[1]
    if rotation is None:
        rotation = np.repeat(DOWN[:, :, np.newaxis], n, axis=2)
    parameters = {
        name: np.repeat(values[..., :1], n, axis=-1) for name, values in PALM.parameters.items()
    }
    names = tuple(f"unit {i}" for i in range(n))
    return replace(
        PALM, unit_names=names, position=position, rotation=rotation, parameters=parameters
    )


def apart(n: int) -> Topology:
    """Units that do not feel each other."""
    return skin_of(np.stack([np.arange(n) * 1.0, np.zeros(n), np.zeros(n)]))


def field_of(field: HalbachField, displacement_mm, depth_mm, **more) -> np.ndarray:
    depth_mm = np.asarray(depth_mm, float)
    return field(np.asarray(displacement_mm, float), depth_mm, np.full_like(depth_mm, COOL), **more)


def radial_scan(lateral_mm: np.ndarray, depth_mm: float) -> np.ndarray:
    """Readings (3, p) of one perfect unit displaced along x."""
    displacement = np.stack([lateral_mm, np.zeros_like(lateral_mm)])
    return field_of(
        HalbachField(apart(lateral_mm.size)), displacement, np.full_like(lateral_mm, depth_mm)
    )


def random_films(n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacements up to 3.5 mm, depths -0.2 to 3.4 mm, tilts up to 4 degrees about each axis."""
    random = np.random.default_rng(seed)
    r, phi = 3.5 * np.sqrt(random.uniform(size=n)), random.uniform(0.0, 2.0 * np.pi, n)
    tilt = np.radians(random.uniform(-4.0, 4.0, (2, n)))
    return np.stack([r * np.cos(phi), r * np.sin(phi)]), random.uniform(-0.2, 3.4, n), tilt


def in_film(middle_mm: np.ndarray, tilt: np.ndarray, point_mm: np.ndarray):
    """Points (3, n) of unit frames in the frames of films, and the rotations of the films."""
    turn = Rotation.from_rotvec(np.stack([*tilt, np.zeros(tilt.shape[1])], axis=1))
    return turn.inv().apply((point_mm - middle_mm).T).T, turn


def exact_own(displacement, depth, tilt) -> np.ndarray:
    """Readings of perfect units, one by one from their magnets."""
    chip = np.zeros((3, depth.size))
    chip[2] = FILM.chip_mm
    points, turn = in_film(np.stack([*displacement, depth]), tilt, chip)
    return CHIP_AXES[:, np.newaxis] * turn.apply(film_field_ut(FILM, points).T).T


def check_table(n: int, seed: int) -> None:
    displacement, depth, tilt = random_films(n, seed)
    exact = exact_own(displacement, depth, tilt)
    read = field_of(HalbachField(apart(n)), displacement, depth, tilt_rad=tilt)
    error = np.linalg.norm(read - exact, axis=0)
    assert np.all(error < 1e-3 * np.linalg.norm(exact, axis=0))
    calibrated_range = (depth <= 2.0) & (np.hypot(*displacement) <= 2.5)
    assert np.all(error[calibrated_range] < 5e-5 * np.linalg.norm(exact, axis=0)[calibrated_range])


def two_units(offset_m, rotation: np.ndarray) -> Topology:
    """A unit at the origin and its neighbour."""
    position = np.stack([np.zeros(3), offset_m], axis=1)
    return skin_of(position, np.stack([DOWN, rotation], axis=2))


def stray_at_first(topology: Topology, displacement, depth, fabrication=None) -> np.ndarray:
    """What the film of unit 1 does to unit 0, shape (3,)."""
    displacement, depth = np.asarray(displacement, float), np.asarray(depth, float)
    together = HalbachField(topology, fabrication=fabrication)
    alone = HalbachField(topology, fabrication=fabrication, reach_m=0.0)
    difference = field_of(together, displacement, depth) - field_of(alone, displacement, depth)
    return difference[..., 0]


# -- the table against the magnets ----------------------------------------------------------------


def test_the_table_is_within_a_thousandth_of_the_magnets():
    check_table(150, seed=1)


def test_the_table_is_refused_where_it_is_not_within_a_thousandth():
    """Just above its least distance from the film it holds, up to 4 mm aside; below, it is lost."""
    random, n = np.random.default_rng(6), 60
    r, phi = 4.0 * np.sqrt(random.uniform(size=n)), random.uniform(0.0, 2.0 * np.pi, n)
    displacement, flat = np.stack([r * np.cos(phi), r * np.sin(phi)]), np.zeros((2, n))
    deepest = FILM.chip_mm - TABLE.nearest_mm
    assert deepest > 3.5 + 4.0 * np.sin(np.radians(1.0))  # the deepest press, and a tilted film
    depth = deepest - random.uniform(0.0, 0.05, n)
    exact, field = exact_own(displacement, depth, flat), HalbachField(apart(n))
    error = np.linalg.norm(field_of(field, displacement, depth) - exact, axis=0)
    assert np.all(error < 1e-3 * np.linalg.norm(exact, axis=0))
    depth[7] = deepest + 1e-6
    with pytest.raises(SkinError, match=r"^unit 7: .* less than 3\.75 mm deep; got"):
        field_of(field, displacement, depth)


@pytest.mark.long
def test_the_table_is_within_a_thousandth_of_the_magnets_at_many_points():
    for seed in range(20):
        check_table(1000, seed)


@pytest.mark.long
def test_the_shipped_table_is_what_its_command_computes():
    again = build_table(calibrated(Film()))
    assert again.film.remanence_t == pytest.approx(FILM.remanence_t, rel=1e-12)
    for name in ("near", "far"):
        ours, theirs = getattr(again, name), getattr(TABLE, name)
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-6 * np.abs(theirs).max())


def test_stray_fields_on_a_bent_skin_are_within_a_thousandth_of_the_magnets():
    random = np.random.default_rng(3)
    points, readings, rotations = [], [], []
    for _ in range(60):
        turn = Rotation.from_rotvec(random.uniform(-0.5, 0.5, 3)).as_matrix() @ DOWN
        offset = random.uniform([0.0115, -0.004, -0.004], [0.022, 0.004, 0.004])
        (dx, dy), depth, tilt = (values[..., 0] for values in random_films(1, random.integers(999)))
        displacement = np.array([[0.0, dx], [0.0, dy]]) * 0.7
        depth = 0.6 * max(depth, 0.0)
        field = (
            HalbachField(two_units(offset, turn)),
            HalbachField(two_units(offset, turn), reach_m=0.0),
        )
        tilts = np.array([[0.0, tilt[0]], [0.0, tilt[1]]])
        with_it, without = (
            field_of(each, displacement, [0.0, depth], tilt_rad=tilts)[:, 0] for each in field
        )
        readings.append(with_it - without)
        chip = np.array([0.0, 0.0, -(FILM.middle_mm + FILM.chip_mm)]) - 1e3 * offset
        middle = np.array([*displacement[:, 1], FILM.middle_mm + depth])
        local, tilted = in_film(middle[:, None], tilt[:, None], (turn.T @ chip)[:, None])
        points.append(local[:, 0])
        rotations.append(DOWN.T @ turn @ tilted.as_matrix()[0])
    exact = film_field_ut(FILM, np.array(points).T).T
    exact = CHIP_AXES * np.einsum("nab,nb->na", np.array(rotations), exact)
    error = np.linalg.norm(np.array(readings) - exact, axis=1)
    assert np.all(error < 1e-3 * np.linalg.norm(exact, axis=1))


def test_errors_of_fabrication_are_those_of_the_magnets():
    n = 24
    made = Fabrication.draw(n, seed=5)
    displacement, depth, _ = random_films(n, seed=6)
    displacement, depth = 2.5 / 3.5 * displacement, 2.0 / 3.4 * np.abs(depth)
    chip = np.zeros((3, n))
    chip[2] = FILM.chip_mm
    points, turn = in_film(np.stack([*(displacement + made.centre_mm), depth]), made.tilt_rad, chip)
    exact = [
        film_field_ut(
            FILM, points[:, i : i + 1],
            sector_angle_rad=made.sector_angle_rad[i], sector_strength=made.sector_strength[i],
        )[:, 0]
        for i in range(n)
    ]  # fmt: skip
    exact = CHIP_AXES[:, np.newaxis] * turn.apply(np.array(exact)).T
    perfect = field_of(HalbachField(apart(n)), displacement, depth)
    read = field_of(HalbachField(apart(n), fabrication=made), displacement, depth)
    wrong = np.linalg.norm(exact - perfect, axis=0)
    assert np.all(np.linalg.norm(read - exact, axis=0) < 0.01 * wrong)
    assert np.median(wrong / np.linalg.norm(exact, axis=0)) > 0.01


@pytest.mark.parametrize("far_mm", [60.0, 300.0, 1500.0])
def test_far_away_a_film_is_its_grains_and_in_the_end_one_dipole(far_mm):
    topology = two_units([1e-3 * far_mm, 0.0, 0.0], DOWN)
    displacement, depth = np.zeros((2, 2)), np.zeros(2)
    with_it, without = HalbachField(topology, reach_m=2.0), HalbachField(topology, reach_m=0.0)
    stray = field_of(with_it, displacement, depth) - field_of(without, displacement, depth)
    point = np.array([-far_mm, 0.0, FILM.chip_mm])
    exact = CHIP_AXES * sum_of_dipoles(point[:, np.newaxis], *grains(FILM))[:, 0]
    assert np.linalg.norm(stray[:, 0] - exact) < 0.01 * np.linalg.norm(exact)
    if far_mm > 1000.0:
        moment = 1e8 * grains(FILM)[1].sum(axis=1)  # µT mm³
        r = np.linalg.norm(point)
        dipole = (3.0 * point * (point @ moment) / r**2 - moment) / r**3
        assert np.linalg.norm(stray[:, 0] - CHIP_AXES * dipole) < 0.01 * np.linalg.norm(dipole)


# -- Maxwell --------------------------------------------------------------------------------------


# -- the film of the paper ------------------------------------------------------------------------


def test_the_lateral_field_is_a_sine_that_crests_at_the_end_of_the_range():
    lateral = np.linspace(0.0, 2.5, 26)
    for depth in (0.0, 0.5, 1.0, 1.5, 2.0):
        read = radial_scan(lateral, depth)
        (amplitude, k), _ = curve_fit(
            lambda r, a, k: a * np.sin(k * r), lateral, read[0], p0=(5000.0, 0.6)
        )
        assert np.abs(read[0] - amplitude * np.sin(k * lateral)).max() < 0.0015 * amplitude
        assert 0.62 < k < 0.64
        assert 1.5 < read[2, 0] / amplitude < 1.8
    assert crest_ut(np.array([2.0]))[0] == pytest.approx(11073.0, rel=1e-3)
    assert 0.18 < FILM.remanence_t < 0.22


@pytest.mark.parametrize(
    ("pitch_m", "static", "moving"), [(0.012, 0.14, 0.28), (0.015, 0.06, 0.064)]
)
def test_crosstalk_is_as_large_as_the_pitch_says(pitch_m, static, moving):
    """A neighbour's lateral field, at rest and what it changes at most, as shares of M0(H = 0)."""
    topology = two_units([pitch_m, 0.0, 0.0], DOWN)
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    displacement = np.zeros((angle.size, 2, 2))
    displacement[:, :, 1] = 2.5 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    depth = np.tile([0.0, 2.0], (angle.size, 1))
    at_rest = stray_at_first(topology, np.zeros((2, 2)), np.zeros(2))
    change = stray_at_first(topology, displacement, depth) - at_rest
    amplitude = crest_ut(np.zeros(1))[0]
    assert np.hypot(*at_rest[:2]) / amplitude == pytest.approx(static, rel=0.12)
    assert np.hypot(*change[:, :2].T).max() / amplitude == pytest.approx(moving, rel=0.12)


# -- symmetry and scale ---------------------------------------------------------------------------


def test_the_field_is_proportional_to_the_films_strength():
    strip = load("strip")
    displacement, depth, _ = random_films(strip.n, seed=9)
    displacement *= 0.7
    weaker = {
        **strip.parameters,
        "field_amplitude_ut": 0.5 * strip.parameters["field_amplitude_ut"],
    }
    read = field_of(HalbachField(strip), displacement, depth)
    half = field_of(HalbachField(replace(strip, parameters=weaker)), displacement, depth)
    np.testing.assert_allclose(half, 0.5 * read, rtol=1e-12)

    drift = strip.parameters["film_drift_per_k"][0]
    warm = HalbachField(strip)(displacement, depth, np.full(strip.n, COOL + 40.0))
    np.testing.assert_allclose(warm, (1.0 + 40.0 * drift) * read, rtol=1e-12)


def test_stray_fields_decay_with_distance_and_end_at_the_reach():
    strays = [
        stray_at_first(two_units([d, 0.0, 0.0], DOWN), np.zeros((2, 2)), np.zeros(2))
        for d in (0.012, 0.015, 0.020, 0.025, 0.029, 0.031)
    ]
    sizes = np.linalg.norm(strays, axis=1)
    assert np.all(np.diff(sizes) < 0.0)
    assert sizes[-1] == 0.0 < sizes[-2]


# -- the code -------------------------------------------------------------------------------------


def test_a_film_without_errors_is_the_same_without_the_kernel():
    table, rng = load_film_table(), np.random.default_rng(3)
    points = rng.uniform([[-12.0], [-12.0], [-1.0]], [[12.0], [12.0], [9.0]], (3, 2000))
    units = halbach._units(table, Fabrication.perfect(1, table.film.sectors))
    compiled = np.empty((2000, 3))
    ours = np.zeros(2000, np.int32), np.ascontiguousarray(points.T)
    magnet.film_fields(halbach._tables(), units, *ours, compiled)
    assert 100 < np.isnan(compiled[:, 0]).sum() < 1000
    np.testing.assert_allclose(table.perfect_ut(points), compiled.T, rtol=1e-5, atol=1e-2)


@pytest.mark.parametrize(
    ("displacement", "depth"), [(0.0, 4.5), (7.0, 4.0), (np.nan, 0.0), (0.0, np.nan), (0.0, np.inf)]
)
def test_a_film_out_of_range_is_an_error_and_not_a_number(displacement, depth):
    moved, pressed = np.zeros((2, 3)), np.zeros(3)
    moved[0, 1], pressed[1] = displacement, depth
    with pytest.raises(
        SkinError, match="unit 1: displacement_mm, depth_mm: must be finite and keep"
    ):
        field_of(HalbachField(apart(3)), moved, pressed)


def test_units_inside_each_other_are_an_error():
    topology = two_units([0.001, 0.0, -0.0057], DOWN)
    with pytest.raises(
        SkinError, match="unit 0: must keep its chip clear of its neighbours' films"
    ):
        field_of(HalbachField(topology), np.zeros((2, 2)), np.zeros(2))


def test_fabrication_of_other_units_is_an_error():
    with pytest.raises(SkinError, match="fabrication: must be of 3 units, as the topology; got 2"):
        HalbachField(apart(3), fabrication=Fabrication.perfect(2))


@given(seed=st.integers(0, 2**32), n=st.integers(1, 20))
def test_errors_of_fabrication_stay_within_their_tolerances(seed, n):
    made = Fabrication.draw(n, seed)
    assert made.sector_angle_rad.shape == made.sector_strength.shape == (n, FILM.sectors)
    assert np.abs(np.degrees(made.sector_angle_rad)).max() <= 2.0
    assert np.abs(made.sector_strength - 1.0).max() <= 0.05 + 1e-12
    assert np.abs(made.centre_mm).max() <= 0.1
    assert np.abs(np.degrees(made.tilt_rad)).max() <= 1.0
    again = Fabrication.draw(n + 1, seed)
    assert np.array_equal(again.tilt_rad[:, :n], made.tilt_rad)
    assert not np.array_equal(Fabrication.draw(n, seed + 1).tilt_rad, made.tilt_rad)


def test_the_shipped_table_is_written_as_it_was_read(tmp_path):
    save(TABLE, tmp_path / "film.npz")
    with np.load(tmp_path / "film.npz") as ours, np.load(TABLE_PATH) as shipped:
        assert {*ours} == {*shipped} - {"amplitude_ut", "source"}
        for name in ours:
            np.testing.assert_array_equal(ours[name], shipped[name])
