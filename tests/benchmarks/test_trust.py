"""The plant of the benchmark `trust` against closed forms, and a short round of it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import trust_bodies, trust_fast, trust_film, trust_liars, trust_plant, trust_skin
from benchmarks.trust_bodies import Body, pressed
from benchmarks.trust_cover import _covered
from benchmarks.trust_film import DRAWN, STRONG, WEAK, Film, field_of, grains, sum_of_dipoles
from benchmarks.trust_plant import BX, BZ, FREQUENCY, GEL, Plant, Touch, Units, turning
from benchmarks.trust_skin import Player, Skin, shape_of
from tests.house.imports import imports_of


def pad(*, alone: bool = False, seed: int = 3) -> Plant:
    nominal = shape_of("pad")
    return Plant(nominal, Units.drawn(nominal, seed), alone=alone)


# -- films -----------------------------------------------------------------------------------------


def test_a_dipole_has_its_field_on_the_axis_and_beside_it():
    moment = np.array([[0.0], [0.0], [2.0]])  # A m²
    points = np.array([[0.0, 30.0], [0.0, 0.0], [20.0, 0.0]])
    seen = sum_of_dipoles(points, np.zeros((3, 1)), moment)
    axis = 1e6 * 1e-7 * 2.0 * 2.0 / 0.020**3
    aside = -1e6 * 1e-7 * 2.0 / 0.030**3
    assert seen == pytest.approx(np.array([[0.0, 0.0], [0.0, 0.0], [axis, aside]]))


def test_a_film_without_wave_is_a_magnetised_disc():
    """On its axis, the difference of two solenoid terms: Br / 2 (cos of the near and far face)."""
    disc = Film(wavelength_mm=1e9)
    z = np.array([3.0, 5.0, 9.0])
    points = np.stack([0.0 * z, 0.0 * z, z])
    ends = [z + side * 0.5 * disc.thickness_mm for side in (1.0, -1.0)]
    far, near = (end / np.hypot(end, disc.radius_mm) for end in ends)
    expected = 1e6 * disc.remanence_t / 2.0 * (far - near)
    assert sum_of_dipoles(points, *grains(disc))[2] == pytest.approx(expected, rel=5e-3)


@pytest.mark.long
def test_the_table_of_a_film_is_the_sum_of_its_dipoles():
    rng = np.random.default_rng(4)
    angle = rng.uniform(-np.pi, np.pi, 60)
    for reach, heights in ((3.0, (1.6, 5.0)), (12.0, (4.0, 11.0)), (30.0, (13.0, 30.0))):
        radius, z = reach * np.sqrt(rng.random(60)), rng.uniform(*heights, 60)
        points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z])
        exact = sum_of_dipoles(points, *grains(DRAWN))
        # 12 mm of it are a harmonic of the sectors' number
        assert np.abs(field_of(DRAWN, points) - exact).max() < 3e-3 * np.abs(exact).max() + 1.0


def test_the_drawn_film_has_the_figures_of_the_model():
    """`M0 sin(kR)` within 0.2 %, k of 0.62 to 0.63 / mm, growth of 0.73 / mm, 11 073 µT."""
    away, crests = np.linspace(0.1, 2.5, 25), []
    for depth in (0.0, 2.0):
        up = np.full(25, DRAWN.up_mm - depth)
        seen = field_of(DRAWN, np.stack([away, 0.0 * away, up]))[0]
        trials = []
        for k in np.linspace(0.60, 0.66, 61):
            wave = np.sin(k * away)
            crest = wave @ seen / (wave @ wave)
            trials.append((float(np.abs(crest * wave - seen).max() / crest), k, crest))
        miss, k, crest = min(trials)
        assert miss < 2e-3
        assert 0.62 <= k <= 0.635
        crests.append(crest)
    assert crests[1] == pytest.approx(11073.0, rel=2e-3)
    assert 0.5 * np.log(crests[1] / crests[0]) == pytest.approx(0.73, abs=0.01)


def test_the_other_films_stray_as_much_as_is_said():
    def share(film: Film) -> float:
        points = np.array([[0.0, 12.0], [0.0, 0.0], [film.up_mm, film.up_mm]])
        own, stray = sum_of_dipoles(points, *grains(film)).T
        return float(np.linalg.norm(stray) / own[2])

    assert share(STRONG) / share(DRAWN) == pytest.approx(1.27, abs=0.01)
    assert share(WEAK) / share(DRAWN) == pytest.approx(0.76, abs=0.01)


# -- units -----------------------------------------------------------------------------------------


def test_counts_are_the_laws_of_the_paper():
    plant = pad(alone=True)
    n = plant.n
    touch = Touch(np.array([np.zeros(n), np.full(n, 0.6), np.full(n, 2.0)]), np.zeros((3, 2, n)))
    values = plant.values(touch, warm_c=np.array([[20.0], [80.0], [50.0]]) * np.ones(n))
    gel = values[:, GEL] / plant.true["gel_current_20c_ua"]
    ratio = plant.true["gel_current_ratio"]
    assert gel == pytest.approx(np.stack([np.ones(n), ratio, np.sqrt(ratio)]))
    fall = values[0, FREQUENCY] - values[:, FREQUENCY]
    assert fall[2] == pytest.approx(2.0 * plant.true["frequency_slope_hz_per_mm"])
    counts = plant.quantised(values)
    back = plant.topology.scale * counts + plant.topology.offset
    assert np.abs(back - values)[:, GEL : BZ + 1].max() <= 0.5 * plant.topology.scale.max()


def test_forces_and_their_inverses_agree_and_have_the_papers_values():
    plant = pad()
    depth, length = np.linspace(0.0, 2.0, 9)[:, np.newaxis], np.linspace(0.0, 2.5, 9)[:, np.newaxis]
    assert plant.depth_at(plant.normal_n(depth)) == pytest.approx(depth * np.ones(plant.n))
    assert plant.length_at(plant.shear_n(length)) == pytest.approx(length * np.ones(plant.n))
    nominal = shape_of("palm")
    exact = Plant(nominal, Units(dict(nominal.parameters), np.ones(64), np.zeros((3, 64))))
    assert exact.normal_n(np.array([2.0]))[0] == pytest.approx(7.2)
    assert exact.shear_n(np.array([2.0]))[0] == pytest.approx(1.0)


def test_a_moved_film_changes_its_neighbours_as_its_dipoles_say():
    plant = pad()
    touch = Touch.none(1, plant.n)
    touch.depth_mm[0, 5], touch.moved_mm[0, :, 5] = 1.5, (0.8, -0.6)
    change = plant.film_field(touch) - plant.film_field(Touch.none(1, plant.n))
    place, moment = grains(DRAWN)
    between = plant.topology.rotation[:, :, 5].T @ (
        1e3 * (plant.topology.position[:, 6] - plant.topology.position[:, 5])
    )
    away = between + np.array([0.0, 0.0, DRAWN.up_mm])
    points = np.stack([away, away - [0.8, -0.6, 1.5]], axis=1)
    rest, moved = sum_of_dipoles(points, place, moment).T
    expected = plant.strength[5] * (moved - rest) * [-1.0, -1.0, 1.0]
    assert change[0, :, 6] == pytest.approx(expected, rel=0.02, abs=2.0)


def test_a_hand_that_turns_sees_the_world_turn_back():
    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    seen = turning(np.array([0.0, 0.5 * np.pi, np.pi]), z, 50.0 * x + 20.0 * z)
    assert seen == pytest.approx(np.array([[50, 0, 20], [0, -50, 20], [-50, 0, 20]]), abs=1e-9)


def test_a_field_of_the_world_reads_the_same_at_chips_that_look_the_same_way():
    plant = pad()
    world = np.array([[30.0, -20.0, 10.0]])
    more = plant.values(Touch.none(1, plant.n), world_ut=world) - plant.values(
        Touch.none(1, plant.n)
    )
    here = plant.topology.rotation[:, :, 0].T @ world[0]
    expected = (here * [-1.0, -1.0, 1.0])[:, np.newaxis] * np.ones(plant.n)
    assert more[0, BX : BZ + 1] == pytest.approx(expected)


# -- bodies ----------------------------------------------------------------------------------------


def test_a_flat_punch_over_all_presses_every_unit_alike():
    plant = pad()
    found = pressed(plant, Body("punch", 500.0), 5, np.zeros(2), 0.3, 8.0)
    assert np.ptp(found.depth_mm) < 1e-9
    assert found.load_n == pytest.approx(8.0, rel=1e-6)
    assert plant.normal_n(found.depth_mm).sum() == pytest.approx(8.0, rel=1e-6)


def test_a_sphere_is_as_deep_as_its_cap():
    """Below its lowest point it is deeper than `r²/2R` beside it, to the fourth order."""
    plant = pad()
    found = pressed(plant, Body("sphere", 200.0), 5, np.zeros(2), 0.0, 20.0)
    away = 1e3 * np.linalg.norm(plant.topology.position.T - plant.topology.position[:, 5], axis=1)
    less = found.depth_mm[5] - found.depth_mm
    touched = found.depth_mm > 0.2
    assert less[touched] == pytest.approx(200.0 - np.sqrt(200.0**2 - away[touched] ** 2), rel=0.02)
    assert touched.sum() > 4


def test_a_body_between_two_pads_presses_the_one_that_it_goes_into():
    nominal = shape_of("gripper")
    plant = Plant(nominal, Units.drawn(nominal, 0))
    found = pressed(plant, Body("edge", 0.5), 3, np.zeros(2), 0.4, 1.0)
    assert found.load_n == pytest.approx(1.0, rel=1e-6)
    assert not found.depth_mm[nominal.patch != nominal.patch[3]].any()


def test_the_centre_of_pressure_follows_a_body_within_a_face():
    plant = pad()
    here = plant.topology.position[:, 5]
    for aside in (np.array([2.0, 0.0]), np.array([0.0, -2.0])):
        found = pressed(plant, Body("sphere", 4.0), 5, aside, 0.0, 0.3)
        moved = 1e3 * plant.topology.rotation[:, :2, 5].T @ (found.centre - here)
        assert moved @ aside > 0.25 * aside @ aside


# -- scores and a short round ----------------------------------------------------------------------


def test_a_right_sigma_has_a_right_coverage_and_one_of_zero_has_none():
    rng = np.random.default_rng(5)
    rows = [(SimpleNamespace(session=i), rng.standard_normal(6), np.ones(6)) for i in range(400)]
    found = _covered(rows)
    assert found["share"] == pytest.approx(0.683, abs=found["interval"] * 1.5)
    assert found["chi_span"][0] < 1.0 < found["chi_span"][1]
    none = _covered([(rows[0][0], np.ones(6), np.zeros(6))] * 3)
    assert none["share"] == 0.0
    assert "chi_square" not in none


@pytest.fixture(scope="module")
def skin() -> Skin:
    """A pad whose units are known exactly, so that no bench is needed."""
    nominal = shape_of("pad").exact()
    units = Units(dict(nominal.parameters), np.ones(16), np.zeros((3, 16)))
    return Skin(Plant(nominal, units), nominal)


def test_the_product_reads_the_forces_of_the_plant(skin):
    touch = Touch.none(700, skin.n)
    touch.depth_mm[450:], touch.moved_mm[450:, 0] = 1.0, 0.5
    true = skin.plant.forces(touch)[-1]
    states = Player(skin.known, want={"wrench"}).play(
        skin.plant.counts(touch, np.random.default_rng(6))
    )
    late = np.mean([s.units.force.copy() for i, s in enumerate(states) if i >= 500], axis=0)
    assert np.abs(late - true).max() < 0.05
    assert skin.plant.wrench(true[np.newaxis])[0, 2] == pytest.approx(-true[2].sum())


def test_a_round_presses_each_unit_once_and_leaves_it(skin):
    touch, presses = trust_fast._round(skin, 1.0, 0, np.random.default_rng(7))
    assert sorted(each.unit for each in presses) == list(range(skin.n))
    assert (np.count_nonzero(touch.depth_mm, axis=1) <= 1).all()
    for each in presses:
        assert touch.depth_mm[each.first : each.end, each.unit].max() > 0.3
        assert touch.depth_mm[each.end - 1, each.unit] == 0.0


def test_a_liar_changes_its_own_channels_from_its_moment_on(skin):
    touch = Touch(np.ones((6, skin.n)), 0.5 * np.ones((6, 2, skin.n)))
    honest = skin.plant.values(touch)
    for kind in trust_liars.KINDS[1:5]:
        changed = trust_liars.lying(skin.plant, honest.copy(), kind, 3, 2) != honest
        assert not changed[:2].any()
        assert changed[2:, :, 3].any(axis=1).all()
        assert not np.delete(changed, 3, axis=2).any()


def test_the_plant_stands_on_no_part_of_simulator_or_decoder():
    def imported(module) -> set[str]:
        return {found.module for found in imports_of(Path(module.__file__))}

    for module in (trust_film, trust_plant, trust_bodies):
        assert not {name for name in imported(module) if name.startswith(("skin", "bus"))}
    assert not {name for name in imported(trust_skin) if name.startswith("skin.sim")}
